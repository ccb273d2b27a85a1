"""GC-RANSAC, through pygcransac.

Its generator is seeded from the entropy of the system in every call and its trials are not
reported, so that only the outcomes of many runs show its rule. On numpy 2 the mask it returns is
all true or all false, whatever the inliers: they are told by the model returned. Its graph-cut,
its SPRT and its default sampler 1 (PROSAC, which takes the order for a ranking) are switched off.
"""

from collections.abc import Callable
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
from ransac_fix.audit.worker.planted import CENTRE, FOCAL, Planted

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Its defaults, as the signatures say; conf, min_iters and max_iters of all functions.
_DEFAULTS = Defaults(0.99, min_trials=50, max_trials=10_000, max_trials_name="max_iters")
# Side of the images in pixels: beyond every planted one.
_SIDE = 1500
_CAMERA = np.array([[FOCAL, 0.0, CENTRE], [0.0, FOCAL, CENTRE], [0.0, 0.0, 1.0]])
_PLAIN = {
    "spatial_coherence_weight": 0.0,
    "use_sprt": False,
    "sampler": 0,
    "neighborhood": 0,
    "lo_number": 0,
}

# Trials of a run where each takes long.
_SHORT = 30

Solve = Callable[[Planted, dict[str, Any]], Any]
Agree = Callable[[Planted, Any], "NDArray[np.bool_]"]


def _pairs(planted: Planted) -> Any:
    return np.ascontiguousarray(np.hstack([planted.x, planted.y]))


def _with_homography(planted: Planted, model: Any) -> Any:
    return agreement.with_homography(planted, model.reshape(3, 3), planted.threshold)


def _with_fundamental(planted: Planted, model: Any) -> Any:
    return agreement.with_fundamental(planted, model.reshape(3, 3), planted.threshold)


def _with_essential(planted: Planted, model: Any) -> Any:
    inverse = np.linalg.inv(_CAMERA)
    essential = inverse.T @ model.reshape(3, 3) @ inverse
    return agreement.with_fundamental(planted, essential, planted.threshold)


def _with_motion(planted: Planted, model: Any) -> Any:
    return agreement.with_motion(planted, model[:3, :3].T, model[3, :3], planted.threshold)


def _with_pose(planted: Planted, model: Any) -> Any:
    return agreement.with_pose(planted, model[:, :3], model[:, 3], planted.threshold)


def _entry_points(pygcransac: Any) -> list[EntryPoint | Unmeasured]:
    sizes = {"h1": _SIDE, "w1": _SIDE, "h2": _SIDE, "w2": _SIDE}

    def homography(planted: Planted, options: dict[str, Any]) -> Any:
        return pygcransac.findHomography(
            _pairs(planted), **sizes, use_space_partitioning=False, **options
        )[0]

    def fundamental(planted: Planted, options: dict[str, Any]) -> Any:
        return pygcransac.findFundamentalMatrix(_pairs(planted), **sizes, **options)[0]

    def essential(planted: Planted, options: dict[str, Any]) -> Any:
        return pygcransac.findEssentialMatrix(
            _pairs(planted), _CAMERA, _CAMERA, **sizes, **options
        )[0]

    def rigid(planted: Planted, options: dict[str, Any]) -> Any:
        return pygcransac.findRigidTransform(
            _pairs(planted), use_space_partitioning=False, **options
        )[0]

    def pose(planted: Planted, options: dict[str, Any]) -> Any:
        normalised = np.hstack([(planted.y - CENTRE) / FOCAL, planted.x])
        options["threshold"] = planted.threshold / FOCAL
        return pygcransac.find6DPose(np.ascontiguousarray(normalised), **options)[0]

    def bound(solve: Solve, agree: Agree) -> Any:
        def run(planted: Planted, settings: Settings | None, _seed: int) -> Outcome:
            options: dict[str, Any] = {
                "probabilities": np.array([]),
                "threshold": planted.threshold,
                **_PLAIN,
            }
            if settings is not None:
                options["conf"] = settings.confidence
                options["min_iters"] = 0
                options["max_iters"] = settings.max_trials
            model = solve(planted, options)
            if model is None or not np.any(model) or not np.isfinite(model).all():
                return Outcome(None)
            return Outcome(agree(planted, np.asarray(model, dtype=float)))

        return run

    def entry_point(
        name: str,
        problem: str,
        k: int,
        solve: Solve,
        agree: Agree,
        spare: int = 1,
        typical_trials: int = 80,
    ) -> EntryPoint:
        return EntryPoint(
            f"{name}(sampler=0)",
            problem,
            k,
            bound(solve, agree),
            _DEFAULTS,
            repeatable=False,
            spare=spare,
            typical_trials=typical_trials,
        )

    return [
        entry_point("findHomography", "homography", 4, homography, _with_homography),
        entry_point(
            "findFundamentalMatrix", "fundamental", 7, fundamental, _with_fundamental, 2, _SHORT
        ),
        entry_point("findEssentialMatrix", "essential", 5, essential, _with_essential, 2, _SHORT),
        entry_point("find6DPose", "absolute_pose", 3, pose, _with_pose),
        entry_point("findRigidTransform", "rigid3d", 3, rigid, _with_motion),
        Unmeasured(
            "findLine2D",
            "with NumPy 2 the line that it returns is its first number three times over, which is "
            "no line; with NumPy 1 it was not tried",
        ),
    ]


PROBE = Probe("gc-ransac", "pygcransac", ("pygcransac",), _entry_points)
