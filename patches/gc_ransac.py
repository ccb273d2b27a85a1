"""Graph-Cut RANSAC, through pygcransac: four estimators, with uniform samples.

The rule is compiled in and assumes p**k, so the functions are wrapped: see
`ransac_fix.patching.wrapping`.

An inlier of the rule, and of the mask, lies within one and a half thresholds of the model.
pygcransac does not return its score: the model with the smaller sum of squared residuals, truncated
there, is kept.

Passed through untouched: samplers other than the uniform one, ``sampler=0`` (the default is 1,
PROSAC), and minimal solvers other than the first, which take samples of another kind.
``find6DPose`` and the essential matrices with known gravity or planar motion were not measured.
What ``findLine2D`` makes of a sample depends on the size of the coordinates, so that no number of
trials is the right one: see ``docs/wrappers.md``.

With NumPy 2 and later release 0.1.1 returns masks that hold their first value all over: nothing can
be read from them, so it is refused there. There is no seed to look at the rule with, so releases
other than the one measured are refused too.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching import residuals
from ransac_fix.patching.docstrings import documented_functions
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import own_function
from ransac_fix.patching.wrapping import Settings, floored

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Squares = Callable[[dict[str, Any], Any], NDArray[np.float64]]
    """``squares(settings, model)``: squared residuals in units of the threshold's."""

__all__ = ["PATCH"]

_KNOWN_VERSION = "0.1.1"
_NEEDED = ("threshold", "conf", "max_iters", "min_iters")
_UNIFORM = 0
_FIRST_SOLVER = 0
# Where the squared residual is truncated, in squared thresholds.
_TRUNCATION = 9.0 / 4.0


@dataclass(frozen=True, slots=True)
class _Estimator:
    """One function: the size of its samples, its measurements and its residuals."""

    sample_size: int
    points: str
    squares: "Squares"


def _sides(settings: dict[str, Any], name: str, columns: int) -> tuple[Any, Any]:
    import numpy as np

    rows = np.asarray(settings[name], dtype=np.float64)
    return rows[:, :columns], rows[:, columns : 2 * columns]


def _homography(settings: dict[str, Any], model: Any) -> "NDArray[np.float64]":
    return residuals.transfer(*_sides(settings, "correspondences", 2), model)


def _fundamental(settings: dict[str, Any], model: Any) -> "NDArray[np.float64]":
    return residuals.sampson(*_sides(settings, "correspondences", 2), model)


def _essential(settings: dict[str, Any], model: Any) -> "NDArray[np.float64]":
    import numpy as np

    sides = _sides(settings, "correspondences", 2)
    cameras = [np.asarray(settings[name], dtype=np.float64) for name in ("K1", "K2")]
    x, y = (
        (side - camera[:2, 2]) / camera.diagonal()[:2]
        for side, camera in zip(sides, cameras, strict=True)
    )
    # Thresholds in pixels are divided by it.
    focal = sum(camera[0, 0] + camera[1, 1] for camera in cameras) / 4
    return np.asarray(residuals.sampson(x, y, model) * focal**2)


def _rigid(settings: dict[str, Any], model: Any) -> "NDArray[np.float64]":
    return residuals.rigid(*_sides(settings, "x1y1z1x2y2z2", 3), model)


_ESTIMATORS = {
    "findHomography": _Estimator(4, "correspondences", _homography),
    "findFundamentalMatrix": _Estimator(7, "correspondences", _fundamental),
    "findEssentialMatrix": _Estimator(5, "correspondences", _essential),
    "findRigidTransform": _Estimator(3, "x1y1z1x2y2z2", _rigid),
}


def _rule(n_inliers: int, n_samples: int, sample_size: int, confidence: float) -> float:
    """Return what pygcransac's own rule asks for with `n_inliers` in hand."""
    chance = (n_inliers / n_samples) ** sample_size
    if chance >= 1.0:
        return 1
    if chance <= 0.0 or confidence >= 1.0:
        return math.inf
    return math.floor(math.log(1.0 - confidence) / math.log1p(-chance)) + 1


def _wrap(
    original: Callable[..., Any], estimator: _Estimator, defaults: dict[str, Any]
) -> Callable[..., Any]:
    """Return the exact estimator."""

    def is_ours(settings: Settings) -> bool:
        solver = settings.get("solver", _FIRST_SOLVER)
        return bool(settings["sampler"] == _UNIFORM and solver == _FIRST_SOLVER)

    def count(_settings: Settings, found: Any) -> int:
        # A model of no more inliers than a sample is not returned, but ends the run.
        return estimator.sample_size if found[0] is None else int(found[1].sum())

    def loss(settings: Settings, found: Any) -> float:
        squares = estimator.squares(settings, found[0]) / settings["threshold"] ** 2
        return float(squares.clip(max=_TRUNCATION).sum())

    return floored(
        original,
        defaults,
        estimator.sample_size,
        points=estimator.points,
        is_ours=is_ours,
        count=count,
        rule=_rule,
        loss=loss,
    )


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the four functions."""
    needed = {name: (estimator.points, *_NEEDED) for name, estimator in _ESTIMATORS.items()}
    known = documented_functions(module, _KNOWN_VERSION, needed)
    _check_masks(module)
    return tuple(
        Replacement(holder=module, name=name, exact=_wrap(original, _ESTIMATORS[name], defaults))
        for name, (original, defaults) in known.items()
    )


def _check_masks(module: Any) -> None:
    """Refuse a pygcransac whose masks say nothing."""
    import numpy as np

    find = own_function(module, "findRigidTransform")
    assert find is not None
    rng = np.random.default_rng(0)
    source = rng.uniform(-1, 1, (20, 3))
    target = source + np.array([0.3, -0.2, 0.1])
    off = np.arange(20) % 4 == 0
    target[off] += rng.uniform(1, 2, (off.sum(), 3))
    rows, chosen = np.hstack([source, target]), {"threshold": 1e-3, "sampler": _UNIFORM}
    _, mask = find(rows, np.ones(20), use_space_partitioning=False, **chosen)
    if not np.array_equal(mask, ~off):
        raise PatchNotApplicable(
            f"with NumPy {np.__version__} its masks do not show the inliers: use NumPy 1"
        )


PATCH = LibraryPatch(
    system="gc-ransac",
    requirements=("pygcransac==0.1.1",),
    modules=("pygcransac",),
    plan=plan,
    observe=plan,
    wraps=True,
)
