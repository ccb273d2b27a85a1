"""PoseLib. It reports its iterations; local optimisation cannot be switched off.

Settings go in as a dict, in which its minimum of iterations and its multiplier are set out of
the way.
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

# Camera dictionaries hold what PoseLib's own Camera class is made from.
_CAMERA = {
    "model": "SIMPLE_PINHOLE",
    "width": 1024,
    "height": 1024,
    "params": [FOCAL, CENTRE, CENTRE],
}
# As in the RansacOptions of PoseLib 2: the Python functions take them over unchanged.
_DEFAULTS = Defaults(
    0.9999, min_trials=1000, max_trials=100_000, multiplier=3.0, max_trials_name="max_iterations"
)


def _options(planted: Planted, settings: Settings | None, seed: int, limit: str) -> dict[str, Any]:
    options: dict[str, Any] = {"seed": seed, limit: planted.threshold}
    if settings is not None:
        options |= {
            "max_iterations": settings.max_trials,
            "min_iterations": 0,
            "dyn_num_trials_mult": 1.0,
            "success_prob": settings.confidence,
        }
    return options


def _outcome(info: dict[str, Any]) -> Outcome:
    inliers = np.asarray(info["inliers"], dtype=bool).reshape(-1)
    return Outcome(inliers if inliers.size else None, int(info["iterations"]))


def _entry_points(poselib: Any) -> list[EntryPoint | Unmeasured]:
    def homography(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        return _outcome(poselib.estimate_homography(planted.x, planted.y, options, {})[1])

    def fundamental(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        return _outcome(poselib.estimate_fundamental(planted.x, planted.y, options, {})[1])

    def relative_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        found = poselib.estimate_relative_pose(planted.x, planted.y, _CAMERA, _CAMERA, options, {})
        return _outcome(found[1])

    def shared_focal(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        found = poselib.estimate_shared_focal_relative_pose(
            planted.x, planted.y, np.array([CENTRE, CENTRE]), options, {}
        )
        return _outcome(found[1])

    def absolute_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        return _outcome(
            poselib.estimate_absolute_pose(planted.y, planted.x, _CAMERA, options, {})[1]
        )

    def radial_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        found = poselib.estimate_1D_radial_absolute_pose(planted.y - CENTRE, planted.x, options, {})
        return _outcome(found[1])

    pooled = (
        "draws the camera first and then the point, from cameras that the planted problems do "
        "not have"
    )
    return [
        EntryPoint("estimate_homography", "homography", 4, homography, _DEFAULTS, counted=True),
        EntryPoint(
            "estimate_fundamental", "fundamental", 7, fundamental, _DEFAULTS, counted=True, spare=2
        ),
        EntryPoint(
            "estimate_relative_pose",
            "essential",
            5,
            relative_pose,
            _DEFAULTS,
            counted=True,
            spare=2,
        ),
        EntryPoint(
            "estimate_shared_focal_relative_pose",
            "essential",
            6,
            shared_focal,
            _DEFAULTS,
            counted=True,
            spare=2,
        ),
        EntryPoint(
            "estimate_absolute_pose", "absolute_pose", 3, absolute_pose, _DEFAULTS, counted=True
        ),
        EntryPoint(
            "estimate_1D_radial_absolute_pose",
            "absolute_pose",
            5,
            radial_pose,
            _DEFAULTS,
            counted=True,
            spare=2,
        ),
        Unmeasured("estimate_generalized_absolute_pose", pooled),
        Unmeasured("estimate_generalized_relative_pose", pooled),
    ]


PROBE = Probe("poselib", "poselib", ("poselib",), _entry_points)
