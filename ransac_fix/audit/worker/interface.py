"""What a probe file provides: how to run one library's RANSAC on a planted problem.

A probe is one file that ends in a ``PROBE``. It is loaded inside the worker, after which its
library may be imported; nothing but numpy, the library and this package may be used there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from ransac_fix.audit.worker.planted import Planted


@dataclass(frozen=True)
class Settings:
    """What the measurement asks of one run, everything else being set out of the way.

    Attributes
    ----------
    max_trials : int
        The budget. No floor on trials may be active and any multiplier must be 1.
    confidence : float
        s, in (0, 1).
    """

    max_trials: int
    confidence: float


@dataclass(frozen=True)
class Outcome:
    """What one run found.

    Attributes
    ----------
    inliers : ndarray of bool, shape (n,), or None
        The measurements that agree with the model returned; None where there was no model.
    trials : int or None
        The number of trials run, for a library that reports it or lets them be counted.
    """

    inliers: NDArray[np.bool_] | None
    trials: int | None = None


@dataclass(frozen=True)
class Defaults:
    """What a library does when its user sets nothing.

    Attributes
    ----------
    confidence : float
        s; 1.0 where the library's default never stops early on its own account.
    min_trials : int
        The floor on the number of trials.
    max_trials : int or None
        The cap on it; None where there is none.
    multiplier : float
        Factor on the number of trials the rule asks for.
    max_trials_name : str
        How the cap is spelt in a call, for advice.
    """

    confidence: float
    min_trials: int = 0
    max_trials: int | None = None
    multiplier: float = 1.0
    max_trials_name: str = "max_trials"


@dataclass(frozen=True)
class EntryPoint:
    """One function a user calls, with one choice of method.

    Attributes
    ----------
    name : str
        As a user writes it, e.g. ``"findHomography(RANSAC)"``.
    problem : str
        The planted problem to solve; a key of ``planted.PROBLEMS`` or ``planted.RIG_PROBLEMS``.
    sample_size : int
        k as documented. The measurement also tries others.
    run : callable
        ``run(planted, settings, seed) -> Outcome``. ``settings`` is None for a run at the
        library's defaults.
    defaults : Defaults or None
        None where the library asks its user for every value.
    counted : bool
        ``Outcome.trials`` is filled in.
    seeded : bool
        ``seed`` changes the random stream; otherwise only the order of the measurements does.
    repeatable : bool
        Whether the same arguments give the same outcome. Otherwise the trials must be counted, or
        only what many runs return shows the rule.
    typical_trials : int
        How many trials a measured run should take: lower for slow libraries.
    fewest_samples : int
        Measurements below which the function does something else.
    spare : int
        By how much the groups planted exceed a sample: more where samples give several models,
        which meet further measurements by chance.
    verifying : int
        How many of a sample only choose among the models that the others give.
    size_seen : bool
        ``run`` raises where a sample does not hold ``sample_size`` measurements.
    budget : bool
        Whether ``Settings.max_trials`` has an effect. Otherwise runs of one trial are asked for by
        the lowest confidence, at which any rule ends a run after its first model.
    n_strata : int
        Strata of the planted problems, such as the cameras of a rig (``Planted.strata``), for a
        function that knows them.
    draws : callable or None
        ``draws(n, count, seed)`` returns the samples that a run on n measurements draws, shape
        ``(count, k)``, for a library whose sampler can be watched; then few runs show its law.
    """

    name: str
    problem: str
    sample_size: int
    run: Callable[[Planted, Settings | None, int], Outcome]
    defaults: Defaults | None = None
    counted: bool = False
    seeded: bool = True
    repeatable: bool = True
    typical_trials: int = 80
    fewest_samples: int = 0
    spare: int = 1
    verifying: int = 0
    size_seen: bool = False
    budget: bool = True
    n_strata: int = 1
    draws: Callable[[int, int, int], NDArray[np.int64]] | None = None


@dataclass(frozen=True)
class Unmeasured:
    """An entry point that has no stopping rule to measure, or shows none.

    Attributes
    ----------
    name : str
        As a user writes it.
    reason : str
        Why, in one line.
    """

    name: str
    reason: str


@dataclass(frozen=True)
class Probe:
    """One library.

    Attributes
    ----------
    system : str
        Name in ``systems.toml``.
    module : str
        The module imported; its absence means the library is not installed.
    distributions : tuple of str
        Distributions that may provide it, for the version.
    entry_points : callable
        ``entry_points(module)`` returns the entry points, the one users call most first.
    one_cpu : bool
        Keep the process on one CPU, for libraries whose threads race and cannot be told not to.
    find : callable or None
        For what is not a Python module: returns the library in place of ``module``, with its
        release as ``__version__``, or None where it is not installed.
    preload : callable or None
        Returns a shared library that must be loaded before everything else, or None: the worker is
        then started again with it.
    """

    system: str
    module: str
    distributions: tuple[str, ...]
    entry_points: Callable[[Any], list[EntryPoint | Unmeasured]]
    one_cpu: bool = False
    find: Callable[[], Any] | None = None
    preload: Callable[[], Path | None] | None = None
