"""COLMAP, through pycolmap. Its minimum of trials and its multiplier are set out of the way."""

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
from ransac_fix.audit.worker.planted import Planted


def _entry_points(pycolmap: Any) -> list[EntryPoint | Unmeasured]:
    pycolmap.logging.minloglevel = 2
    # The names of the first pycolmap releases.
    homography_matrix = (
        getattr(pycolmap, "estimate_homography_matrix", None)
        or pycolmap.homography_matrix_estimation
    )
    untouched = pycolmap.RANSACOptions()
    has_seed = hasattr(untouched, "random_seed")

    def options(planted: Planted, settings: Settings | None, seed: int) -> Any:
        chosen = pycolmap.RANSACOptions()
        chosen.max_error = planted.threshold
        if has_seed:
            chosen.random_seed = seed
        else:
            pycolmap.set_random_seed(seed)
        if settings is not None:
            chosen.min_num_trials = 0
            chosen.max_num_trials = settings.max_trials
            chosen.confidence = settings.confidence
            chosen.dyn_num_trials_multiplier = 1.0
            # COLMAP also caps the trials by what this ratio would need.
            chosen.min_inlier_ratio = 1e-6
        return chosen

    def homography(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        found = homography_matrix(planted.x, planted.y, options(planted, settings, seed))
        if not found:
            return Outcome(None)
        mask = found["inlier_mask"] if "inlier_mask" in found else found["inliers"]
        return Outcome(np.asarray(mask, dtype=bool).ravel())

    return [
        EntryPoint(
            "estimate_homography_matrix",
            "homography",
            4,
            homography,
            Defaults(
                float(untouched.confidence),
                min_trials=int(untouched.min_num_trials),
                max_trials=int(untouched.max_num_trials),
                multiplier=float(untouched.dyn_num_trials_multiplier),
                max_trials_name="max_num_trials",
            ),
        )
    ]


PROBE = Probe("colmap", "pycolmap", ("pycolmap",), _entry_points)
