"""OpenGV, its C++ templates, through a driver.

Residuals are 1 - cos of an angle, so thresholds in pixels become such angles.
"""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ransac_fix.audit.worker import native
from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import FOCAL, Planted, bearings, rig

_LIBRARY = native.Library(
    title="OpenGV",
    source=Path(__file__).with_name("drivers") / "opengv.cpp",
    header=native.Header("opengv/sac/Ransac.hpp", "libopengv-dev"),
    needs=(native.Header("Eigen/Core", "libeigen3-dev", ("eigen3",)),),
    links=("opengv",),
)
# As the constructor of SampleConsensus has them; a budget of 1000 runs one trial more.
_DEFAULTS = Defaults(0.99, max_trials=1001, max_trials_name="max_iterations_")

# What a user writes, the driver's name, the planted problem, k with the measurements that choose
# among the solver's solutions, and how many of those there are.
_RANSAC = (
    ("Ransac<AbsolutePoseSacProblem>(KNEIP)", "absolute_pose.kneip", "absolute_pose", 4, 1),
    ("Ransac<AbsolutePoseSacProblem>(GAO)", "absolute_pose.gao", "absolute_pose", 4, 1),
    ("Ransac<AbsolutePoseSacProblem>(EPNP)", "absolute_pose.epnp", "absolute_pose", 6, 0),
    ("Ransac<AbsolutePoseSacProblem>(TWOPT)", "absolute_pose.twopt", "absolute_position", 2, 0),
    (
        "Ransac<CentralRelativePoseSacProblem>(STEWENIUS)",
        "relative_pose.stewenius",
        "essential",
        8,
        3,
    ),
    ("Ransac<CentralRelativePoseSacProblem>(NISTER)", "relative_pose.nister", "essential", 8, 3),
    ("Ransac<CentralRelativePoseSacProblem>(SEVENPT)", "relative_pose.sevenpt", "essential", 9, 2),
    ("Ransac<CentralRelativePoseSacProblem>(EIGHTPT)", "relative_pose.eightpt", "essential", 9, 1),
    ("Ransac<RotationOnlySacProblem>", "relative_pose.rotation_only", "rotation", 2, 0),
    (
        "Ransac<TranslationOnlySacProblem>",
        "relative_pose.translation_only",
        "translation_direction",
        2,
        0,
    ),
    ("Ransac<PointCloudSacProblem>", "point_cloud", "rigid3d", 3, 0),
    ("Lmeds<AbsolutePoseSacProblem>(KNEIP)", "absolute_pose.kneip.lmeds", "absolute_pose", 4, 1),
)


# On the cameras of a rig: Ransac draws from all rays alike, MultiRansac from each camera in turn.
_RIG = (
    ("Ransac<AbsolutePoseSacProblem>(GP3P)", "rig.absolute_pose", "rig_absolute_pose", 4, 1),
    (
        "MultiRansac<MultiNoncentralAbsolutePoseSacProblem>",
        "multi.absolute_pose",
        "rig_absolute_pose",
        4,
        1,
    ),
)
_CAMERAS = 2


def _of_rig(planted: Planted) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the sides, in the frame of the rig where they are rays, its centre and the camera."""
    sides = _sides(planted)
    rays = (slice(0, 3),) if planted.x.shape[1] == 3 else (slice(0, 3), slice(3, 6))
    centres = np.empty((planted.n_samples, 3))
    for camera, (rotation, shift) in enumerate(rig(_CAMERAS)):
        seen = planted.strata == camera
        centres[seen] = -rotation.T @ shift
        for ray in rays:
            sides[seen, ray] = sides[seen, ray] @ rotation
    return np.column_stack([sides, centres, planted.strata])


def _sides(planted: Planted) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return both sides of the measurements as vectors in space, as OpenGV takes them."""
    x, y = planted.x, planted.y
    if x.shape[1] == 3 and y.shape[1] == 2:
        return np.hstack([bearings(y), x])
    if x.shape[1] == 2:
        return np.hstack([bearings(x), bearings(y)])
    # Its motion maps the second cloud to the first.
    return np.hstack([y, x])


def _threshold(planted: Planted) -> float:
    if planted.x.shape[1] == planted.y.shape[1] == 3:
        return planted.threshold
    return 1 - math.cos(planted.threshold / FOCAL)


def _driven(driver: native.Driver, name: str, data: Any) -> Any:
    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        return driver.run(name, data(planted), _threshold(planted), settings, seed)

    return run


def _ransac() -> list[EntryPoint | Unmeasured]:
    try:
        driver = _LIBRARY.start()
    except native.Unusable as why:
        return [Unmeasured(name, str(why)) for name, *_ in (*_RANSAC, *_RIG)]
    return [
        EntryPoint(
            name,
            problem,
            k,
            _driven(driver, driven, _of_rig if of_rig else _sides),
            _DEFAULTS,
            counted=True,
            spare=2 if verifying else 1,
            verifying=verifying,
            n_strata=_CAMERAS if of_rig else 1,
        )
        for of_rig, table in ((False, _RANSAC), (True, _RIG))
        for name, driven, problem, k, verifying in table
    ]


def _find() -> SimpleNamespace | None:
    return SimpleNamespace(__version__=_LIBRARY.version()) if _LIBRARY.installed() else None


PROBE = Probe("opengv", "pyopengv", (), lambda _: _ransac(), find=_find)
