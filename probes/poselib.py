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
# An empty list may be one of cameras or of dictionaries: a release takes the first.
_NO_CAMERAS: list[Any] = []
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


def _members(planted: Planted) -> list[Any]:
    """Return the numbers of the measurements of each stratum."""
    return [np.flatnonzero(planted.strata == number) for number in range(_CAMERAS)]


def _of_strata(planted: Planted, members: list[Any], inliers: Any, info: dict[str, Any]) -> Outcome:
    """Put the inliers of each stratum back to their places."""
    mask = np.zeros(planted.n_samples, dtype=bool)
    for places, of_stratum in zip(members, inliers, strict=False):
        if len(of_stratum):
            mask[places] = np.asarray(of_stratum, dtype=bool)
    return Outcome(mask if mask.any() else None, int(info["iterations"]))


class _Functions:
    """The estimators, each as a probe wants it."""

    def __init__(self, poselib: Any) -> None:
        self.poselib = poselib

    def homography(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        return _outcome(self.poselib.estimate_homography(planted.x, planted.y, options, {})[1])

    def fundamental(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        return _outcome(self.poselib.estimate_fundamental(planted.x, planted.y, options, {})[1])

    def relative_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        found = self.poselib.estimate_relative_pose(
            planted.x, planted.y, _CAMERA, _CAMERA, options, {}
        )
        return _outcome(found[1])

    def shared_focal(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        found = self.poselib.estimate_shared_focal_relative_pose(
            planted.x, planted.y, np.array([CENTRE, CENTRE]), options, {}
        )
        return _outcome(found[1])

    def absolute_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        return _outcome(
            self.poselib.estimate_absolute_pose(planted.y, planted.x, _CAMERA, options, {})[1]
        )

    def radial_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        found = self.poselib.estimate_1D_radial_absolute_pose(
            planted.y - CENTRE, planted.x, options, {}
        )
        return _outcome(found[1])

    def hybrid_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        # Without matches to a map: with some, release 2.0.5 draws points that do not exist.
        options = _options(planted, settings, seed, "max_reproj_error")
        found = self.poselib.estimate_hybrid_pose(
            planted.y, planted.x, [], _CAMERA, [], _NO_CAMERAS, options, {}
        )
        return _outcome(found[1])

    def _rig_poses(self) -> list[Any]:
        poses = []
        for rotation, shift in rig(_CAMERAS):
            pose = self.poselib.CameraPose()
            pose.R, pose.t = rotation, shift
            poses.append(pose)
        return poses

    def point_line_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        # The one for lines.
        options["max_epipolar_error"] = planted.threshold
        points, lines = _members(planted)
        _, info = self.poselib.estimate_absolute_pose_pnpl(
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

    def rig_absolute_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_reproj_error")
        of_camera = _members(planted)
        _, info = self.poselib.estimate_generalized_absolute_pose(
            [planted.y[places] for places in of_camera],
            [planted.x[places] for places in of_camera],
            self._rig_poses(),
            [_CAMERA] * _CAMERAS,
            options,
            {},
        )
        return _of_strata(planted, of_camera, info["inliers"], info)

    def rig_relative_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = _options(planted, settings, seed, "max_epipolar_error")
        of_pair = _members(planted)
        matches = []
        for number, places in enumerate(of_pair):
            pair = self.poselib.PairwiseMatches()
            pair.cam_id1 = pair.cam_id2 = number
            pair.x1, pair.x2 = planted.x[places], planted.y[places]
            matches.append(pair)
        cameras = self._rig_poses(), [_CAMERA] * _CAMERAS
        _, info = self.poselib.estimate_generalized_relative_pose(
            matches, *cameras, *cameras, options, {}
        )
        return _of_strata(planted, of_pair, info["inliers"], info)


def _entry_points(poselib: Any) -> list[EntryPoint | Unmeasured]:
    functions = _Functions(poselib)
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
        ("estimate_homography", "homography", 4, functions.homography, 1, 1),
        ("estimate_fundamental", "fundamental", 7, functions.fundamental, 2, 1),
        ("estimate_relative_pose", "essential", 5, functions.relative_pose, 2, 1),
        ("estimate_shared_focal_relative_pose", "essential", 6, functions.shared_focal, 2, 1),
        ("estimate_absolute_pose", "absolute_pose", 3, functions.absolute_pose, 1, 1),
        (
            "estimate_absolute_pose_pnpl",
            "point_line_pose",
            3,
            functions.point_line_pose,
            2,
            _CAMERAS,
        ),
        ("estimate_1D_radial_absolute_pose", "absolute_pose", 5, functions.radial_pose, 2, 1),
        ("estimate_hybrid_pose", "absolute_pose", 3, functions.hybrid_pose, 1, 1),
        (
            "estimate_generalized_absolute_pose",
            "rig_absolute_pose",
            3,
            functions.rig_absolute_pose,
            1,
            _CAMERAS,
        ),
        (
            "estimate_generalized_relative_pose",
            "rig_relative_pose",
            6,
            functions.rig_relative_pose,
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
