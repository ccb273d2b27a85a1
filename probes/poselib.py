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
from ransac_fix.audit.worker.planted import CENTRE, FOCAL, Planted, rig

# Camera dictionaries hold what PoseLib's own Camera class is made from.
_CAMERA = {
    "model": "SIMPLE_PINHOLE",
    "width": 1024,
    "height": 1024,
    "params": [FOCAL, CENTRE, CENTRE],
}
# Cameras of the planted rigs.
_CAMERAS = 2


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


def _of_strata(planted: Planted, members: list[Any], inliers: Any, info: dict[str, Any]) -> Outcome:
    """Put the inliers of each stratum back to their places."""
    mask = np.zeros(planted.n_samples, dtype=bool)
    for places, of_stratum in zip(members, inliers, strict=False):
        if len(of_stratum):
            mask[places] = np.asarray(of_stratum, dtype=bool)
    return Outcome(mask if mask.any() else None, int(info["iterations"]))


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

    def hybrid_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        # Without matches to a map: with some, release 2.0.5 draws points that do not exist.
        options = _options(planted, settings, seed, "max_reproj_error")
        found = poselib.estimate_hybrid_pose(
            planted.y, planted.x, [], _CAMERA, [], no_cameras, options, {}
        )
        return _outcome(found[1])

    def members(planted: Planted) -> list[Any]:
        return [np.flatnonzero(planted.strata == number) for number in range(_CAMERAS)]

    def rig_poses() -> list[Any]:
        poses = []
        for rotation, shift in rig(_CAMERAS):
            pose = poselib.CameraPose()
            pose.R, pose.t = rotation, shift
            poses.append(pose)
        return poses

    def point_line_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        # The one for lines.
        options["max_epipolar_error"] = planted.threshold
        points, lines = members(planted)
        _, info = poselib.estimate_absolute_pose_pnpl(
            planted.y[points, :2],
            planted.x[points, :3],
            planted.y[lines, :2],
            planted.y[lines, 2:],
            planted.x[lines, :3],
            planted.x[lines, 3:],
            _CAMERA,
            options,
            {},
        )
        inliers = info["inliers"], info["inliers_lines"]
        return _of_strata(planted, [points, lines], inliers, info)

    def rig_absolute_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        of_camera = members(planted)
        _, info = poselib.estimate_generalized_absolute_pose(
            [planted.y[places] for places in of_camera],
            [planted.x[places] for places in of_camera],
            rig_poses(),
            [_CAMERA] * _CAMERAS,
            options,
            {},
        )
        return _of_strata(planted, of_camera, info["inliers"], info)

    def rig_relative_pose(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        of_pair = members(planted)
        matches = []
        for number, places in enumerate(of_pair):
            pair = poselib.PairwiseMatches()
            pair.cam_id1 = pair.cam_id2 = number
            pair.x1, pair.x2 = planted.x[places], planted.y[places]
            matches.append(pair)
        cameras = rig_poses(), [_CAMERA] * _CAMERAS
        _, info = poselib.estimate_generalized_relative_pose(
            matches, *cameras, *cameras, options, {}
        )
        return _of_strata(planted, of_pair, info["inliers"], info)

    # An empty list may be one of cameras or of dictionaries: a release takes the first.
    no_cameras: list[Any] = []
    untouched = poselib.RansacOptions({})
    defaults = Defaults(
        float(untouched["success_prob"]),
        min_trials=int(untouched["min_iterations"]),
        max_trials=int(untouched["max_iterations"]),
        multiplier=float(untouched["dyn_num_trials_mult"]),
        max_trials_name="max_iterations",
    )
    # Name, planted problem, k, how to run, spare, strata.
    table = (
        ("estimate_homography", "homography", 4, homography, 1, 1),
        ("estimate_fundamental", "fundamental", 7, fundamental, 2, 1),
        ("estimate_relative_pose", "essential", 5, relative_pose, 2, 1),
        ("estimate_shared_focal_relative_pose", "essential", 6, shared_focal, 2, 1),
        ("estimate_absolute_pose", "absolute_pose", 3, absolute_pose, 1, 1),
        ("estimate_absolute_pose_pnpl", "point_line_pose", 3, point_line_pose, 2, _CAMERAS),
        ("estimate_1D_radial_absolute_pose", "absolute_pose", 5, radial_pose, 2, 1),
        ("estimate_hybrid_pose", "absolute_pose", 3, hybrid_pose, 1, 1),
        (
            "estimate_generalized_absolute_pose",
            "rig_absolute_pose",
            3,
            rig_absolute_pose,
            1,
            _CAMERAS,
        ),
        (
            "estimate_generalized_relative_pose",
            "rig_relative_pose",
            6,
            rig_relative_pose,
            2,
            _CAMERAS,
        ),
    )
    return [
        EntryPoint(name, problem, k, run, defaults, counted=True, spare=spare, n_strata=n_strata)
        for name, problem, k, run, spare, n_strata in table
        if hasattr(poselib, name)
    ]


PROBE = Probe("poselib", "poselib", ("poselib",), _entry_points)
