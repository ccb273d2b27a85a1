"""Theia, through pyTheia. It reports its iterations; its generator cannot be seeded from Python."""

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


def _entry_points(pytheia: Any) -> list[EntryPoint | Unmeasured]:
    sfm = pytheia.sfm
    correspondence = pytheia.matching.FeatureCorrespondence
    untouched = pytheia.solvers.RansacParameters()

    def parameters(planted: Planted, settings: Settings | None, scale: float) -> Any:
        chosen = pytheia.solvers.RansacParameters()
        chosen.error_thresh = (planted.threshold * scale) ** 2
        if settings is not None:
            chosen.min_iterations = 0
            chosen.max_iterations = settings.max_trials
            chosen.failure_probability = 1.0 - settings.confidence
        return chosen

    def matches(planted: Planted, calibrated: bool) -> Any:
        x, y = planted.x, planted.y
        if calibrated:
            x, y = (x - CENTRE) / FOCAL, (y - CENTRE) / FOCAL
        return [correspondence(sfm.Feature(a), sfm.Feature(b)) for a, b in zip(x, y, strict=True)]

    def outcome(found: Any, n: int) -> Outcome:
        success, summary = found[0], found[-1]
        inliers = np.zeros(n, dtype=bool)
        inliers[list(summary.inliers)] = True
        return Outcome(inliers if success else None, int(summary.num_iterations))

    def image_to_image(name: str, calibrated: bool) -> Any:
        function = getattr(sfm, name)

        def run(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
            scale = 1 / FOCAL if calibrated else 1.0
            found = function(
                parameters(planted, settings, scale),
                sfm.RansacType.RANSAC,
                matches(planted, calibrated),
            )
            return outcome(found, planted.n_samples)

        return run

    def plane(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
        found = sfm.EstimateDominantPlaneFromPoints(
            parameters(planted, settings, 1.0), sfm.RansacType.RANSAC, list(planted.x)
        )
        return outcome(found, planted.n_samples)

    defaults = Defaults(
        1.0 - float(untouched.failure_probability),
        min_trials=int(untouched.min_iterations),
        max_trials=int(untouched.max_iterations),
        max_trials_name="max_iterations",
    )
    entry_points: list[EntryPoint | Unmeasured] = [
        EntryPoint(
            name,
            problem,
            k,
            image_to_image(name, calibrated),
            defaults,
            counted=True,
            repeatable=False,
            spare=spare,
            typical_trials=typical_trials,
        )
        for name, problem, k, calibrated, spare, typical_trials in (
            ("EstimateHomography", "homography", 4, False, 1, 40),
            ("EstimateFundamentalMatrix", "fundamental", 8, False, 2, 80),
            ("EstimateEssentialMatrix", "essential", 5, True, 2, 80),
            ("EstimateRelativePose", "essential", 5, True, 2, 80),
        )
        if hasattr(sfm, name)
    ]
    if hasattr(sfm, "EstimateDominantPlaneFromPoints"):
        entry_points.append(
            EntryPoint(
                "EstimateDominantPlaneFromPoints",
                "plane",
                3,
                plane,
                defaults,
                counted=True,
                repeatable=False,
            )
        )
    return entry_points


PROBE = Probe("theia", "pytheia", ("pytheia",), _entry_points)
