"""A user's own RANSAC, wrapped so that it is measured like a library."""

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Settings
from ransac_fix.audit.worker.planted import Planted, plant
from ransac_fix.audit.worker.streams import LARGEST_CONFIDENCE
from ransac_fix.errors import RansacFixError

# Runs that are repeated, on so many problems: by chance all agree once in 10^8 times.
_PROBLEMS, _REPEATS = 3, 10
_LOW = 0.1
# The minimal samples of the planted problems.
SAMPLE_SIZES = {
    "line": 2,
    "plane": 3,
    "plane_patch": 3,
    "circle": 3,
    "line3d": 2,
    "sphere": 4,
    "translation": 1,
    "similarity": 2,
    "affine": 3,
    "homography": 4,
    "segments": 4,
    "fundamental": 7,
    "essential": 5,
    "absolute_pose": 3,
    "absolute_position": 2,
    "rotation": 2,
    "translation_direction": 2,
    "translation3d": 1,
    "rigid3d": 3,
    "similarity3d": 3,
    "affine3d": 4,
}


def entry_point(
    function: Callable[..., Any],
    *,
    problem: str,
    sample_size: int | None = None,
    name: str | None = None,
    typical_trials: int = 40,
) -> EntryPoint:
    """Wrap a function as an entry point.

    Parameters
    ----------
    function : callable
        ``function(x, y, *, threshold, max_trials, confidence, seed)``, or one without a seed or
        without a number of trials; it returns the inliers as a boolean mask over the measurements
        or None, or such a mask and the number of trials.
    problem : str
        The planted problem it can solve; key of `SAMPLE_SIZES`.
    sample_size : int, optional
        k, 1 to 20, where it is not that of the problem's usual minimal solver.
    name : str, optional
        For the report.
    typical_trials : int, optional
        How many trials a run may take, 10 to 1000: lower for a slow function.

    Returns
    -------
    EntryPoint

    Raises
    ------
    RansacFixError
        If the problem is unknown, a number is out of range or the function returns something else.
    """
    if problem not in SAMPLE_SIZES:
        raise RansacFixError(f"unknown problem {problem!r}: use one of {', '.join(SAMPLE_SIZES)}")
    k = SAMPLE_SIZES[problem] if sample_size is None else sample_size
    for argument, value, low, high in (
        ("sample_size", k, 1, 20),
        ("typical_trials", typical_trials, 10, 1000),
    ):
        if not low <= value <= high:
            raise RansacFixError(f"{argument} must be from {low} to {high}, not {value!r}")
    qualified = str(getattr(function, "__qualname__", type(function).__name__))
    title = name or qualified.rpartition("<locals>.")[2]

    seeded, budget = (_takes(function, name) for name in ("seed", "max_trials"))

    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        assert settings is not None
        options = {"seed": seed} if seeded else {}
        if budget:
            options["max_trials"] = settings.max_trials
        found = function(
            planted.x,
            planted.y,
            threshold=planted.threshold,
            confidence=settings.confidence,
            **options,
        )
        return _outcome(found, planted.n_samples, title)

    tried = plant(problem, 2 * k + 4, k + 1, 1, 0, 0)
    first = run(tried, Settings(20, 0.9), 0)
    # Solvers that give several models meet further measurements by chance.
    spare = 2 if problem in ("fundamental", "essential") else 1
    return EntryPoint(
        title,
        problem,
        k,
        run,
        counted=first.trials is not None,
        seeded=seeded,
        budget=budget,
        repeatable=_repeatable(run, problem, k, budget=budget),
        typical_trials=typical_trials,
        spare=spare,
    )


def _takes(function: Callable[..., Any], name: str) -> bool:
    """Whether a function has a parameter of this name."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return True
    return any(
        one.kind is one.VAR_KEYWORD or (one.name == name and one.kind is not one.POSITIONAL_ONLY)
        for one in parameters
    )


def _repeatable(
    run: Callable[[Planted, Settings | None, int], Outcome],
    problem: str,
    sample_size: int,
    *,
    budget: bool,
) -> bool:
    """Whether the same arguments give the same outcome, of trials that hit every second time."""
    # Without a budget a low confidence ends runs early.
    confidence = LARGEST_CONFIDENCE if budget else _LOW
    n = sample_size + 3
    trials = max(1, round(0.7 * math.comb(n, sample_size) / (sample_size + 1)))
    for seed in range(_PROBLEMS):
        planted = plant(problem, n, sample_size + 1, 1, 0, seed)
        groups = {
            planted.group_of(run(planted, Settings(trials, confidence), seed).inliers)
            for _ in range(_REPEATS)
        }
        if len(groups) > 1:
            return False
    return True


def _outcome(found: Any, n: int, title: str) -> Outcome:
    trials = None
    if isinstance(found, tuple) and len(found) == 2:
        found, count = found
        trials = int(count)
    if found is None:
        return Outcome(None, trials)
    mask = np.asarray(found)
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise RansacFixError(
            f"{title} must return a boolean mask of shape ({n},), or one and the number of "
            f"trials, not {type(found).__name__} of shape {mask.shape} and type {mask.dtype}"
        )
    return Outcome(mask, trials)
