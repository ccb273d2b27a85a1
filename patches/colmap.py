"""COLMAP, through pycolmap, up to 3.11.1; exact since 3.12.0, where nothing is changed.

Up to 3.11.1 the rule is compiled in and assumes p**k, so the estimators of one model are
wrapped: see `ransac_fix.patching.missing`. The missing trials are drawn by setting both bounds
on trials; the generator goes on from call to call, so they are fresh samples, and a program that
calls ``pycolmap.set_random_seed`` still repeats. The model with more inliers is kept. Samples
are distinct and uniform.

The promise is the caller's ``confidence``, once: COLMAP's defaults of many trials at least, and
of three times what its rule says, mostly keep it already. ``max_num_trials`` and what
``min_inlier_ratio`` makes of it are the limits.

``estimate_sim3d_robust`` of 3.11.1 returns a transform and no inliers: they are counted as COLMAP
does, points that it moves to within ``max_error`` of their match.

Passed through untouched: ``estimate_absolute_pose`` while it tries focal lengths, and what runs
RANSAC inside a larger computation (two-view geometry, triangulation, the mapper).
"""

import copy
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.behaviour import assumed_probability
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import (
    Attempt,
    Promise,
    complete,
    missing_trials,
    own_function,
    slack,
)

__all__ = ["PATCH"]


@dataclass(frozen=True, slots=True)
class _Estimator:
    """One function: the size of its samples, and its options."""

    sample_size: int
    position: int
    kind: str = "RANSACOptions"


_POSE = "AbsolutePoseEstimationOptions"
_ESTIMATORS = {
    "estimate_homography_matrix": _Estimator(4, 2),
    "estimate_fundamental_matrix": _Estimator(7, 2),
    "estimate_essential_matrix": _Estimator(5, 4),
    "estimate_absolute_pose": _Estimator(3, 3, _POSE),
    "estimate_and_refine_absolute_pose": _Estimator(3, 3, _POSE),
    "estimate_sim3d_robust": _Estimator(3, 2),
}


# Their runs cannot be seen from outside.
_INSIDE = (
    "estimate_two_view_geometry",
    "estimate_calibrated_two_view_geometry",
    "estimate_generalized_absolute_pose",
    "estimate_and_refine_generalized_absolute_pose",
    "estimate_generalized_relative_pose",
    "estimate_affine2d_robust",
    "estimate_rigid3d_robust",
    "estimate_triangulation",
    "verify_matches",
    "geometric_verification",
    "guided_geometric_verification",
    "match_exhaustive",
    "match_image_pairs",
    "match_sequential",
    "match_spatial",
    "match_vocabtree",
    "incremental_mapping",
    "hierarchical_mapping",
    "global_mapping",
)


def _rule(ratio: float, sample_size: int, confidence: float, multiplier: float) -> float:
    """Return what COLMAP's own rule asks for at a ratio of inliers."""
    chance = ratio**sample_size
    if chance >= 1:
        return 1
    if chance <= 0 or confidence >= 1:
        return math.inf
    return math.ceil(math.log1p(-confidence) / math.log1p(-chance) * multiplier)


def _wrap(module: Any, original: Callable[..., Any], estimator: _Estimator) -> Callable[..., Any]:
    """Return the exact estimator."""
    k, position = estimator.sample_size, estimator.position
    defaults = getattr(module, estimator.kind)()

    def exact(*args: Any, **kwargs: Any) -> Any:
        result = original(*args, **kwargs)
        given = args[position] if len(args) > position else kwargs.get("estimation_options")
        options = defaults if given is None else given
        if isinstance(options, dict):
            options = copy.deepcopy(defaults)
            options.mergedict(given)
        if getattr(options, "estimate_focal_length", False):
            return result
        ransac = options.ransac if estimator.kind == _POSE else options
        n_samples = len(args[0] if args else next(iter(kwargs.values())))
        if result is None or n_samples <= k:  # without a model it has run to its limit
            return result
        confidence, multiplier = ransac.confidence, ransac.dyn_num_trials_multiplier
        limit = min(
            ransac.max_num_trials, _rule(ransac.min_inlier_ratio, k, confidence, multiplier)
        )

        def count(found: Any) -> int:
            if found is None:
                return 0
            if isinstance(found, dict):
                return int(found["num_inliers"])
            points = {**dict(zip(("src", "tgt"), args, strict=False)), **kwargs}
            return _moved_close(found, points["src"], points["tgt"], ransac.max_error)

        n_inliers = count(result)
        rule = _rule(n_inliers / n_samples, k, confidence, multiplier)
        trials = min(max(rule, ransac.min_num_trials), limit)
        if not missing_trials(n_inliers, n_samples, k, confidence, trials, limit, slack()):
            return result

        def run(trials: int, _round: int) -> Attempt[Any]:
            settings = copy.deepcopy(options)
            bounds = settings.ransac if estimator.kind == _POSE else settings
            bounds.min_num_trials = bounds.max_num_trials = trials
            if len(args) > position:
                again = original(*args[:position], settings, *args[position + 1 :], **kwargs)
            else:
                again = original(*args, **{**kwargs, "estimation_options": settings})
            return Attempt(again, count(again), trials)

        return complete(
            Attempt(result, n_inliers, trials),
            Promise(n_samples, k, confidence, limit),
            run,
        )

    return exact


def _moved_close(transform: Any, source: Any, target: Any, max_error: float) -> int:
    """Return how many points a transform moves to within a distance of their match."""
    import numpy as np

    matrix = transform.matrix()
    off = np.asarray(source) @ matrix[:, :3].T + matrix[:, 3] - np.asarray(target)
    return int(np.count_nonzero(np.einsum("ij,ij->i", off, off) <= max_error**2))


def _originals(module: ModuleType) -> dict[str, tuple[Callable[..., Any], _Estimator]]:
    """Return the estimators, if they are as they are known to be."""
    originals = {}
    for name, estimator in _ESTIMATORS.items():
        original = own_function(module, name)
        if original is None or "estimation_options" not in (original.__doc__ or ""):
            raise PatchNotApplicable(f"pycolmap has no {name} that takes estimation_options")
        originals[name] = original, estimator
    return originals


def _wrapped(module: ModuleType) -> tuple[Replacement, ...]:
    return tuple(
        Replacement(holder=module, name=name, exact=_wrap(module, original, estimator))
        for name, (original, estimator) in _originals(module).items()
    )


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the estimators, where their rule assumes p**k."""
    originals = _originals(module)
    assumed = _measured(module, originals["estimate_homography_matrix"][0])
    if assumed is None:
        raise PatchNotApplicable("estimate_homography_matrix follows neither rule")
    return () if assumed == "exact" else _wrapped(module)


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: the estimators, and functions with RANSAC inside."""
    inside = [
        Replacement(holder=module, name=name, exact=original)
        for name in _INSIDE
        if (original := own_function(module, name)) is not None
    ]
    return (*_wrapped(module), *inside)


def _measured(module: Any, estimate: Callable[..., Any]) -> str | None:
    """Return the probability that the rule assumes.

    In a thread of its own: there the generator is another one, and the program's is left alone.
    """
    options = module.RANSACOptions()
    options.max_error, options.min_inlier_ratio = 0.05, 1e-6
    options.min_num_trials, options.dyn_num_trials_multiplier = 0, 1.0
    if hasattr(options, "random_seed"):
        options.random_seed = 1
    found: list[str | None] = []

    def count(x: Any, y: Any, trials: int, confidence: float) -> int:
        module.set_random_seed(1)
        options.max_num_trials, options.confidence = trials, confidence
        result = estimate(x, y, options)
        return 0 if result is None else int(result["num_inliers"])

    thread = threading.Thread(target=lambda: found.append(assumed_probability(count, 4)))
    thread.start()
    thread.join()
    return found[0] if found else None


PATCH = LibraryPatch(
    system="colmap",
    requirements=("pycolmap>=3.11.1,<=4.2.1",),
    modules=("pycolmap",),
    plan=plan,
    observe=observe,
    wraps=True,
)
