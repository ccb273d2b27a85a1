"""OpenGV: its C++ templates through a driver, and pyopengv.

Neither belongs to a Python environment: both are what is installed on the machine. Residuals are
1 - cos of an angle, so thresholds in pixels become such angles.
"""

import ctypes
import importlib.machinery
import importlib.util
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ransac_fix.audit.worker import agreement, native
from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import CENTRE, FOCAL, Planted, bearings, rig

_LIBRARY = native.Library(
    title="OpenGV",
    source=Path(__file__).with_name("drivers") / "opengv.cpp",
    header=native.Header("opengv/sac/Ransac.hpp", "libopengv-dev"),
    needs=(native.Header("Eigen/Core", "libeigen3-dev", ("eigen3",)),),
    links=("opengv",),
)
# As the constructor of SampleConsensus has them; a budget of 1000 runs one trial more.
_DEFAULTS = Defaults(0.99, max_trials=1001, max_trials_name="max_iterations_")

# Samples larger than this meet a group of one more than a sample seldom, beside a larger one.
_LARGE_SAMPLE = 5
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
            spare=2 if verifying or k > _LARGE_SAMPLE else 1,
            verifying=verifying,
            n_strata=_CAMERAS if of_rig else 1,
        )
        for of_rig, table in ((False, _RANSAC), (True, _RIG))
        for name, driven, problem, k, verifying in table
    ]


# Debian puts it where its own interpreter looks; others may load it if it was built for them.
_DEBIAN = "/usr/lib/python3/dist-packages"
_PYTHON_PACKAGE = "python3-opengv"
# It takes its seed from the clock, which is made to stand where it is set.
_CLOCK = native.Library(
    title="pyopengv clock",
    source=Path(__file__).with_name("drivers") / "clock.cpp",
    header=native.Header("time.h", "libc6-dev"),
    shared=True,
)
# Trials are not counted here, and the larger samples are slow to solve.
_SHORT = 20
_SHORT_FROM = 6
_SET_CLOCK = "ransac_fix_set_clock"
_CAMERA = np.array([[FOCAL, 0, CENTRE], [0, FOCAL, CENTRE], [0, 0, 1]])

# What a user writes, the planted problem, k, how many of those only choose, and the arguments.
_PYTHON = (
    ("absolute_pose_ransac", "absolute_pose", 4, 1, ("KNEIP",)),
    ("absolute_pose_ransac", "absolute_pose", 4, 1, ("GAO",)),
    ("absolute_pose_ransac", "absolute_pose", 6, 0, ("EPNP",)),
    ("relative_pose_ransac", "essential", 8, 3, ("STEWENIUS",)),
    ("relative_pose_ransac", "essential", 8, 3, ("NISTER",)),
    ("relative_pose_ransac", "essential", 9, 2, ("SEVENPT",)),
    ("relative_pose_ransac", "essential", 9, 1, ("EIGHTPT",)),
    ("relative_pose_ransac_rotation_only", "rotation", 2, 0, ()),
)


def _agreeing(planted: Planted, model: Any) -> Any:
    """Return the inliers of what pyopengv returns: where the viewpoint is, in the other's frame."""
    rotation = model[:, :3].T
    if model.shape[1] == 3:
        homography = _CAMERA @ rotation @ np.linalg.inv(_CAMERA)
        return agreement.with_homography(planted, homography, planted.threshold)
    shift = -rotation @ model[:, 3]
    if planted.x.shape[1] == 3:
        return agreement.with_pose(planted, rotation, shift, planted.threshold)
    x, y, z = shift
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    inverse = np.linalg.inv(_CAMERA)
    return agreement.with_fundamental(
        planted, inverse.T @ cross @ rotation @ inverse, planted.threshold
    )


def _called(function: Any, arguments: tuple[str, ...]) -> Any:
    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        getattr(ctypes.CDLL(None), _SET_CLOCK)(ctypes.c_long(seed))
        first, second = np.hsplit(_sides(planted), 2)
        limits: dict[str, Any] = {}
        if settings is not None:
            # A budget of T runs T + 1 trials, and one of 0 none: one trial is that of confidence 0.
            limits = {
                "iterations": max(1, settings.max_trials - 1),
                "probability": 0.0 if settings.max_trials == 1 else settings.confidence,
            }
        model = function(first, second, *arguments, _threshold(planted), **limits)
        return Outcome(_agreeing(planted, np.asarray(model)))

    return run


def _python(pyopengv: Any) -> list[EntryPoint | Unmeasured]:
    names = [f"pyopengv.{name}" + "".join(f"({one})" for one in rest) for name, *_, rest in _PYTHON]
    if not hasattr(ctypes.CDLL(None), _SET_CLOCK):
        why = "takes its seed from the clock, which could not be set"
        try:
            _CLOCK.build()
        except native.Unusable as reason:
            why = f"{why}: {reason}"
        return [Unmeasured(name, why) for name in names]
    return [
        EntryPoint(
            name,
            problem,
            k,
            _called(getattr(pyopengv, function), arguments),
            _DEFAULTS,
            spare=2 if verifying or k > _LARGE_SAMPLE else 1,
            verifying=verifying,
            typical_trials=_SHORT if k >= _SHORT_FROM else 2 * _SHORT,
        )
        for name, (function, problem, k, verifying, arguments) in zip(names, _PYTHON, strict=True)
    ]


def _spec() -> Any:
    """Return where pyopengv is, or None."""
    return importlib.machinery.PathFinder.find_spec("pyopengv", [*sys.path, _DEBIAN])


def _preload() -> Path | None:
    return _CLOCK.build() if sys.platform == "linux" and _spec() is not None else None


def _import() -> Any:
    """Return pyopengv, or None. Nothing else there becomes importable."""
    spec = _spec()
    if spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _find() -> SimpleNamespace | None:
    python = _import()
    if _LIBRARY.installed():
        version = _LIBRARY.version()
    elif python is not None:
        version = native.package_version(_PYTHON_PACKAGE, Path(python.__file__)) or "unknown"
    else:
        return None
    return SimpleNamespace(__version__=version, python=python)


def _entry_points(found: Any) -> list[EntryPoint | Unmeasured]:
    entry_points = _ransac() if _LIBRARY.installed() else []
    return entry_points + (_python(found.python) if found.python is not None else [])


PROBE = Probe("opengv", "pyopengv", (), _entry_points, find=_find, preload=_preload)
