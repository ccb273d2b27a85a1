"""kornia-rs: the two-view estimators of ``kornia_rs.ransac``, which report their iterations."""

import inspect
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


def _entry_points(kornia_rs: Any) -> list[EntryPoint | Unmeasured]:
    ransac = getattr(kornia_rs, "ransac", None)
    if ransac is None:
        return [Unmeasured("ransac", "this release has no ransac module")]

    def bound(name: str, calibrated: bool) -> Any:
        function = getattr(ransac, name)

        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            matches, threshold = np.hstack([planted.x, planted.y]), planted.threshold
            if calibrated:
                # The threshold is one for squares: left as it is, clutter agrees now and then.
                matches, threshold = (matches - CENTRE) / FOCAL, (threshold / FOCAL) ** 2
            options: dict[str, Any] = {}
            if settings is not None:
                options["max_iters"] = settings.max_trials
                options["confidence"] = settings.confidence
            found = function(matches, threshold, seed=seed, **options)
            inliers = np.asarray(found.inliers, dtype=bool).reshape(-1)
            return Outcome(inliers if inliers.any() else None, int(found.num_iters))

        return run

    def defaults(name: str) -> Defaults:
        parameters = inspect.signature(getattr(ransac, name)).parameters
        return Defaults(
            float(parameters["confidence"].default),
            max_trials=int(parameters["max_iters"].default),
            max_trials_name="max_iters",
        )

    return [
        EntryPoint(
            f"ransac.{name}",
            problem,
            k,
            bound(name, calibrated),
            defaults(name),
            counted=True,
            spare=spare,
            typical_trials=typical_trials,
        )
        for name, problem, k, calibrated, spare, typical_trials in (
            ("homography", "homography", 4, False, 1, 80),
            ("fundamental", "fundamental", 8, False, 2, 80),
            ("essential", "essential", 5, True, 2, 20),
        )
        if hasattr(ransac, name)
    ]


PROBE = Probe("kornia-rs", "kornia_rs", ("kornia-rs",), _entry_points)
