"""SupeRANSAC. It reports its iterations; its generator is seeded anew in every call.

The sampler of release 1.0 draws from n + 1 indices: its range ends at n, included. One row beyond
the data is read for it, so that a share of k/(n+1) of the samples is void.

It draws again, without counting an iteration, where a sample is refused or gives no model. Its
scoring, its sampler and its local optimisation are replaced by the plain ones: with the default
sampler (PROSAC) the order of the measurements is a ranking.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import Planted, plant

# Side of the images in pixels: beyond every planted one.
_SIDE = 1500.0
# Runs of one trial on measurements that all agree, and how many of them find the model wherever
# samples lie within the data: a few give no model.
_RUNS = 200
_ALL = 180


def _entry_points(pysuperansac: Any) -> list[EntryPoint | Unmeasured]:
    untouched = pysuperansac.RANSACSettings()
    defaults = Defaults(
        float(untouched.confidence),
        min_trials=int(untouched.min_iterations),
        max_trials=int(untouched.max_iterations),
        max_trials_name="max_iterations",
    )

    def options(planted: Planted, settings: Settings | None) -> Any:
        # A new object each time: some functions change the threshold in the one they are given.
        chosen = pysuperansac.RANSACSettings()
        chosen.inlier_threshold = planted.threshold
        chosen.scoring = pysuperansac.ScoringType.RANSAC
        chosen.sampler = pysuperansac.SamplerType.Uniform
        chosen.local_optimization = pysuperansac.LocalOptimizationType.Nothing
        chosen.final_optimization = pysuperansac.LocalOptimizationType.Nothing
        if settings is not None:
            chosen.min_iterations = 0
            chosen.max_iterations = settings.max_trials
            chosen.confidence = settings.confidence
        return chosen

    def outcome(found: Any, n: int) -> Outcome:
        indices, trials = found[-3], int(found[-1])
        inliers = np.zeros(n, dtype=bool)
        inliers[np.asarray(indices, dtype=int)] = True
        return Outcome(inliers if inliers.any() else None, trials)

    def pairs(planted: Planted) -> Any:
        return np.ascontiguousarray(np.hstack([planted.x, planted.y]))

    def homography(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = pysuperansac.estimateHomography(
            pairs(planted), [_SIDE] * 4, [], options(planted, settings)
        )
        return outcome(found, planted.n_samples)

    def rigid(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = pysuperansac.estimateRigidTransform(
            pairs(planted), [_SIDE] * 6, [], options(planted, settings)
        )
        return outcome(found, planted.n_samples)

    def entry_point(name: str, problem: str, k: int, run: Any, spare: int = 1) -> EntryPoint:
        return EntryPoint(
            f"{name}(Uniform)",
            problem,
            k,
            run,
            defaults,
            counted=True,
            repeatable=False,
            spare=spare,
        )

    others = ("estimateFundamentalMatrix", "estimateEssentialMatrix", "estimateAbsolutePose")
    found = _found_at_once(homography)
    if found < _ALL:
        why = (
            f"of {_RUNS} runs of one trial on five measurements that all agree only {found} found "
            "the model: its sampler draws from n + 1 indices, of which the last lies beyond the "
            "data, and what a sample with that one gives is not defined"
        )
        names = ("estimateHomography", *others, "estimateRigidTransform")
        return [Unmeasured(name, why) for name in names]
    return [
        entry_point("estimateHomography", "homography", 4, homography),
        entry_point("estimateRigidTransform", "rigid3d", 3, rigid),
        *(Unmeasured(name, "no release has a sampler that could be measured") for name in others),
    ]


def _found_at_once(run: Callable[[Planted, Settings | None, int], Outcome]) -> int:
    """Count the runs of one trial that find a model with which all measurements agree."""
    found = 0
    for seed in range(_RUNS):
        planted = plant("homography", 5, 5, 1, 0, seed)
        found += planted.group_of(run(planted, Settings(1, 0.99), seed).inliers) is not None
    return found


PROBE = Probe("superansac", "pysuperansac", ("pysuperansac",), _entry_points)
