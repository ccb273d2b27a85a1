"""kornia-rs: `homography`, `fundamental` (eight points) and `essential` in `kornia_rs.ransac`.

The rule is compiled in and assumes p**k, so the functions are wrapped: see
`ransac_fix.patching.wrapping`. They report their iterations. The missing ones are drawn with
another seed and a confidence of 1, which runs all of them; the model with the higher score is
kept. The score is the number of inliers, which is quicker to read than the list of them. Samples
are distinct and uniform. Nothing is optimised beside the trials, so that a second run costs what
they do, and the first one is not asked for more than its caller did.

Passed through untouched: the estimators of `kornia_rs.k3d`, which report neither iterations nor
the confidence they work with.
"""

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import own_function
from ransac_fix.patching.wrapping import seeded

__all__ = ["PATCH"]

_NAMES = ("matches", "threshold", "max_iters", "confidence", "seed")
_DEFAULTS = {"max_iters": 1000, "confidence": 0.999, "seed": None}
_SAMPLE_SIZES = {"homography": 4, "fundamental": 8, "essential": 5}


def _read(result: Any, _n_samples: int, _confidence: float, _limit: float) -> tuple[int, int]:
    return int(result.score), result.num_iters


def _wrap(original: Callable[..., Any], sample_size: int) -> Callable[..., Any]:
    """Return the exact function."""
    return seeded(
        original,
        _NAMES,
        _DEFAULTS,
        sample_size,
        points="matches",
        confidence="confidence",
        read=_read,
    )


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: the three functions."""
    home = getattr(module, "ransac", None)
    if not isinstance(home, ModuleType):
        raise PatchNotApplicable("kornia_rs has no module ransac")
    originals = {}
    for name in _SAMPLE_SIZES:
        original = own_function(home, name)
        if original is None:
            raise PatchNotApplicable(f"kornia_rs.ransac has no {name}")
        signature = getattr(original, "__text_signature__", None) or ""
        found = tuple(part.partition("=")[0].strip() for part in signature[1:-1].split(","))
        if found != _NAMES:
            raise PatchNotApplicable(
                f"kornia_rs.ransac.{name} takes {', '.join(found)} and not {', '.join(_NAMES)}"
            )
        originals[name] = original
    return tuple(
        Replacement(holder=home, name=name, exact=_wrap(original, _SAMPLE_SIZES[name]))
        for name, original in originals.items()
    )


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the three functions, where their rule assumes p**k."""
    wrapped = observe(module)
    homography = own_function(wrapped[0].holder, "homography")
    assert homography is not None
    return () if _is_exact(homography) else wrapped


def _is_exact(homography: Callable[..., Any]) -> bool:
    """Return whether the rule is exact: kornia-rs says how many iterations it ran."""
    import numpy as np

    rng = np.random.default_rng(0)
    n_samples, n_inliers, confidence = 20, 9, 0.99
    x = rng.uniform(0, 1000, (n_samples, 2))
    y = x + rng.uniform(-100, 100, x.shape)
    y[:n_inliers] = x[:n_inliers] + np.array([10.0, 20.0])
    setting = n_inliers, n_samples, 4, confidence
    laws = {False: approximate_required_trials(*setting), True: required_trials(*setting)}
    for seed in range(40):
        result = homography(np.hstack([x, y]), 1e-3, 1000, confidence, seed)
        for exact, trials in laws.items():
            if sum(result.inliers) == n_inliers and math.fabs(result.num_iters - trials) <= 2:
                return exact
    raise PatchNotApplicable("kornia_rs.ransac.homography follows neither rule")


PATCH = LibraryPatch(
    system="kornia-rs",
    requirements=("kornia_rs==0.2.0",),
    modules=("kornia_rs",),
    plan=plan,
    observe=observe,
    wraps=True,
    counts_trials=True,
)
