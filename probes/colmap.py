"""COLMAP, through pycolmap. Its minimum of trials and its multiplier are set out of the way.

Local optimisation cannot be switched off. Functions come and go between releases: those that a
release has are measured.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from ransac_fix.audit.worker import agreement
from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import CENTRE, FOCAL, Planted, rig

if TYPE_CHECKING:
    from collections.abc import Callable


# Cameras of the planted rigs.
_CAMERAS = 2


class _Functions:
    """The estimators, each as a probe wants it."""

    def __init__(self, pycolmap: Any) -> None:
        self.pycolmap = pycolmap
        self._has_seed = hasattr(pycolmap.RANSACOptions(), "random_seed")
        self.seeded = self._has_seed or hasattr(pycolmap, "set_random_seed")
        self.camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE", width=1024, height=1024, params=[FOCAL, CENTRE, CENTRE]
        )

    def options(self, planted: Planted, settings: Settings | None, seed: int) -> Any:
        chosen = self.pycolmap.RANSACOptions()
        chosen.max_error = planted.threshold
        if self._has_seed:
            chosen.random_seed = seed
        else:
            self.pycolmap.set_random_seed(seed)
        if settings is not None:
            chosen.min_num_trials = 0
            chosen.max_num_trials = settings.max_trials
            chosen.confidence = settings.confidence
            chosen.dyn_num_trials_multiplier = 1.0
            # COLMAP also caps the trials by what this ratio would need.
            chosen.min_inlier_ratio = 1e-6
        return chosen

    def image_to_image(self, name: str) -> Any:
        function = getattr(self.pycolmap, name)

        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            return self._masked(
                function(planted.x, planted.y, self.options(planted, settings, seed))
            )

        return run

    def essential(self, name: str) -> Any:
        function = getattr(self.pycolmap, name)

        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            options = self.options(planted, settings, seed)
            return self._masked(function(planted.x, planted.y, self.camera, self.camera, options))

        return run

    def relative_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options = self.options(planted, settings, seed)
        return self._masked(
            self.pycolmap.estimate_relative_pose(
                self.camera, planted.x, self.camera, planted.y, options
            )
        )

    def absolute_pose(self, name: str) -> Any:
        function = getattr(self.pycolmap, name)

        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            options = self.pycolmap.AbsolutePoseEstimationOptions()
            options.ransac = self.options(planted, settings, seed)
            return self._masked(function(planted.y, planted.x, self.camera, options))

        return run

    def rig_absolute_pose(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        cameras = [
            self.pycolmap.Rigid3d(np.column_stack([rotation, shift]))
            for rotation, shift in rig(_CAMERAS)
        ]
        return self._masked(
            self.pycolmap.estimate_generalized_absolute_pose(
                planted.y,
                planted.x,
                planted.strata.tolist(),
                cameras,
                [self.camera] * _CAMERAS,
                self.options(planted, settings, seed),
            )
        )

    def space_to_space(self, name: str) -> Any:
        function = getattr(self.pycolmap, name)

        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            found = function(planted.x, planted.y, self.options(planted, settings, seed))
            if isinstance(found, dict):
                return self._masked(found)
            if found is None:
                return Outcome(None)
            matrix = np.asarray(found.matrix())
            return Outcome(
                agreement.with_motion(planted, matrix[:, :3], matrix[:, 3], planted.threshold)
            )

        return run

    @staticmethod
    def _masked(found: Any) -> Outcome:
        if not found:
            return Outcome(None)
        for key in ("inlier_mask", "inliers"):
            if key in found:
                return Outcome(np.asarray(found[key], dtype=bool).ravel())
        raise KeyError(f"no inliers among {', '.join(found)}")


def _entry_points(pycolmap: Any) -> list[EntryPoint | Unmeasured]:
    pycolmap.logging.minloglevel = 2
    functions = _Functions(pycolmap)
    untouched = pycolmap.RANSACOptions()
    defaults = Defaults(
        float(untouched.confidence),
        min_trials=int(untouched.min_num_trials),
        max_trials=int(untouched.max_num_trials),
        multiplier=float(untouched.dyn_num_trials_multiplier),
        max_trials_name="max_num_trials",
    )
    # Name, planted problem, k, how to run, spare, and what else is particular.
    slow: dict[str, Any] = {"typical_trials": 25}
    by_camera: dict[str, Any] = {"n_strata": _CAMERAS}
    table: tuple[tuple[str, str, int, Callable[[str], Any], int, dict[str, Any]], ...] = (
        ("estimate_homography_matrix", "homography", 4, functions.image_to_image, 1, {}),
        ("estimate_fundamental_matrix", "fundamental", 7, functions.image_to_image, 2, {}),
        ("estimate_essential_matrix", "essential", 5, functions.essential, 2, slow),
        ("estimate_relative_pose", "essential", 5, lambda _: functions.relative_pose, 2, slow),
        ("estimate_absolute_pose", "absolute_pose", 3, functions.absolute_pose, 1, {}),
        (
            "estimate_generalized_absolute_pose",
            "rig_absolute_pose",
            3,
            lambda _: functions.rig_absolute_pose,
            1,
            by_camera,
        ),
        ("estimate_affine2d_robust", "affine", 3, functions.image_to_image, 1, {}),
        ("estimate_rigid3d_robust", "rigid3d", 3, functions.space_to_space, 1, {}),
        ("estimate_sim3d_robust", "similarity3d", 3, functions.space_to_space, 1, {}),
    )
    listed: list[EntryPoint | Unmeasured] = []
    for name, problem, k, make, spare, particular in table:
        # The names up to 3.10.
        old = f"{name.removeprefix('estimate_')}_estimation"
        found = next((one for one in (name, old) if hasattr(pycolmap, one)), None)
        # Up to 3.x it took rays only.
        if found is None or (
            name == "estimate_relative_pose" and "camera1" not in getattr(pycolmap, name).__doc__
        ):
            continue
        if functions.seeded:
            listed.append(
                EntryPoint(found, problem, k, make(found), defaults, spare=spare, **particular)
            )
        else:
            listed.append(Unmeasured(found, "its generator cannot be seeded before 3.10"))
    listed += [
        Unmeasured(name, why) for name, why in _UNMEASURED.items() if hasattr(pycolmap, name)
    ]
    return listed


_UNMEASURED = {
    "estimate_generalized_relative_pose": (
        "one trial of its six-point solver takes 5 ms and more, and two groups that hold samples "
        "of six are found after some 200 trials at the soonest: points take minutes"
    ),
    "estimate_triangulation": (
        "by its source it goes through the pairs of observations in place of drawing samples"
    ),
}


PROBE = Probe("colmap", "pycolmap", ("pycolmap",), _entry_points)
