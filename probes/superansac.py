"""SupeRANSAC, through pysuperansac. It reports its iterations; local optimisation is switched off.

Its samplers are set to the uniform one: the default, PROSAC, needs an order of quality.
"""

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
from ransac_fix.audit.worker.planted import CENTRE, FOCAL, Planted

_SIZE = 1200.0
_CAMERA = np.array([[FOCAL, 0, CENTRE], [0, FOCAL, CENTRE], [0, 0, 1]])


def _entry_points(superansac: Any) -> list[EntryPoint | Unmeasured]:
    untouched = superansac.RANSACSettings()

    def options(settings: Settings | None, threshold: float) -> Any:
        chosen = superansac.RANSACSettings()
        chosen.inlier_threshold = threshold
        chosen.sampler = superansac.SamplerType.Uniform
        chosen.scoring = superansac.ScoringType.RANSAC
        chosen.local_optimization = superansac.LocalOptimizationType.Nothing
        chosen.final_optimization = superansac.LocalOptimizationType.Nothing
        if settings is not None:
            chosen.min_iterations = 0
            chosen.max_iterations = settings.max_trials
            chosen.confidence = settings.confidence
        return chosen

    def outcome(found: Any, n: int) -> Outcome:
        inliers = np.zeros(n, dtype=bool)
        inliers[np.asarray(found[-3], dtype=np.int64)] = True
        return Outcome(inliers if inliers.any() else None, int(found[-1]))

    def homography(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = superansac.estimateHomography(
            np.hstack([planted.x, planted.y]),
            [_SIZE] * 4,
            config=options(settings, planted.threshold),
        )
        return outcome(found, planted.n_samples)

    def fundamental(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = superansac.estimateFundamentalMatrix(
            np.hstack([planted.x, planted.y]),
            [_SIZE] * 4,
            config=options(settings, planted.threshold),
        )
        return outcome(found, planted.n_samples)

    def essential(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = superansac.estimateEssentialMatrix(
            np.hstack([planted.x, planted.y]),
            _CAMERA,
            _CAMERA,
            [_SIZE] * 4,
            config=options(settings, planted.threshold),
        )
        return outcome(found, planted.n_samples)

    def rigid(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = superansac.estimateRigidTransform(
            np.hstack([planted.x, planted.y]),
            [_SIZE] * 6,
            config=options(settings, planted.threshold),
        )
        return outcome(found, planted.n_samples)

    defaults = Defaults(
        float(untouched.confidence),
        min_trials=int(untouched.min_iterations),
        max_trials=int(untouched.max_iterations),
        max_trials_name="max_iterations",
    )
    return [
        EntryPoint(name, problem, k, run, defaults, counted=True, repeatable=False, spare=spare)
        for name, problem, k, run, spare in (
            ("estimateHomography", "homography", 4, homography, 1),
            ("estimateFundamentalMatrix", "fundamental", 7, fundamental, 2),
            ("estimateEssentialMatrix", "essential", 5, essential, 2),
            ("estimateRigidTransform", "rigid3d", 3, rigid, 1),
        )
        if hasattr(superansac, name)
    ]


PROBE = Probe("superansac", "pysuperansac", ("pysuperansac",), _entry_points)
