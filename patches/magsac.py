"""MAGSAC and MAGSAC++, through pymagsac: four estimators, with uniform samples.

The rule is compiled in and assumes p**k, so the functions are wrapped: see
`ransac_fix.patching.wrapping`.

MAGSAC++ has no threshold between inliers and outliers, but its rule has one: it counts what is
within a pixel of the model, and within ``sigma_th``. So does the promise. The original counts
within several thresholds up to ``sigma_th`` and takes the mean number of trials, which is no fewer
than that at ``sigma_th``. The mask is no count of either where ``sigma_th`` is not 1: that of
homographies reaches to its square.

pymagsac does not return its score. The model with the smaller loss of MAGSAC++ is kept, which is
marginalised over the noise as in Barath et al. (CVPR 2020), equation 13 onwards: the integral of
the weight of a residual, up to a factor.

Passed through untouched: every sampler but the uniform one, ``sampler=0``; the default, 4, reorders
the measurements as it goes (AR-Sampler). ``findLine2D`` crashes in release 0.2.3 whatever it is
given.

There is no seed to look at the rule with, so releases other than the one measured are refused.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.patching import residuals
from ransac_fix.patching.docstrings import documented_functions
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.wrapping import Settings, floored

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Squares = Callable[[dict[str, Any], Any, bool], NDArray[np.float64]]
    """``squares(settings, model, scoring)``: squared residuals in pixels, for the count or the
    score."""

__all__ = ["PATCH"]

_KNOWN_VERSION = "0.2.3"
_UNIFORM = 0
# The rule counts what is as near as this, in pixels.
_REFERENCE_THRESHOLD = 1.0
# Residuals count up to so many standard deviations of the noise, and have four dimensions.
_QUANTILE, _DIMENSIONS = 3.64, 4
_TABLE = 4096

_NEEDED = (
    "correspondences",
    "sampler",
    "use_magsac_plus_plus",
    "sigma_th",
    "conf",
    "min_iters",
    "max_iters",
)


@dataclass(frozen=True, slots=True)
class _Estimator:
    """One function: the size of its samples, and its residuals."""

    sample_size: int
    squares: "Squares"
    squared_mask: bool = False


def _sides(settings: dict[str, Any], columns: int) -> tuple[Any, Any]:
    import numpy as np

    rows = np.asarray(settings["correspondences"], dtype=np.float64)
    return rows[:, :columns], rows[:, columns : 2 * columns]


def _homography_squares(
    settings: dict[str, Any], model: Any, _scoring: bool
) -> "NDArray[np.float64]":
    return residuals.transfer(*_sides(settings, 2), model)


def _fundamental_squares(
    settings: dict[str, Any], model: Any, scoring: bool
) -> "NDArray[np.float64]":
    measure = residuals.symmetric_epipolar if scoring else residuals.sampson
    return measure(*_sides(settings, 2), model)


def _essential_squares(
    settings: dict[str, Any], model: Any, scoring: bool
) -> "NDArray[np.float64]":
    import numpy as np

    cameras = [np.asarray(settings[name], dtype=np.float64) for name in ("K1", "K2")]
    x, y = (
        (side - camera[:2, 2]) / camera.diagonal()[:2]
        for side, camera in zip(_sides(settings, 2), cameras, strict=True)
    )
    focal = sum(camera[0, 0] + camera[1, 1] for camera in cameras) / 4
    measure = residuals.symmetric_epipolar if scoring else residuals.sampson
    return np.asarray(measure(x, y, model) * focal**2)


def _rigid_squares(settings: dict[str, Any], model: Any, _scoring: bool) -> "NDArray[np.float64]":
    return residuals.rigid(*_sides(settings, 3), model)


_ESTIMATORS = {
    "findHomography": _Estimator(4, _homography_squares, squared_mask=True),
    "findFundamentalMatrix": _Estimator(7, _fundamental_squares),
    "findEssentialMatrix": _Estimator(5, _essential_squares),
    "findRigidTransformation": _Estimator(3, _rigid_squares),
}


def _rule(n_inliers: int, n_samples: int, sample_size: int, confidence: float) -> float:
    """Return what pymagsac's own rule asks for with `n_inliers` in hand."""
    chance = (n_inliers / n_samples) ** sample_size
    if chance >= 1.0:
        return 0
    if chance <= 0.0 or confidence >= 1.0:
        return math.inf
    return math.floor(math.log(1.0 - confidence) / math.log1p(-chance))


@lru_cache(maxsize=1)
def _losses() -> "tuple[NDArray[np.float64], NDArray[np.float64]]":
    """Return residuals in units of the largest counted, squared, and the loss at each.

    The weight of a residual r is Gamma((d - 1)/2, r**2 / (2 sigma**2)) less its value at the
    quantile, with d dimensions; its loss is the integral of r times that. Here d = 4, where
    Gamma(3/2, x) = sqrt(pi)/2 erfc(sqrt(x)) + sqrt(x) exp(-x).
    """
    import numpy as np

    assert _DIMENSIONS == 4
    share = np.linspace(0.0, 1.0, _TABLE)
    x = (share * _QUANTILE) ** 2 / 2
    erfc = np.array([math.erfc(math.sqrt(value)) for value in x])
    gamma = math.sqrt(math.pi) / 2 * erfc + np.sqrt(x) * np.exp(-x)
    weighted = share * (gamma - gamma[-1])
    steps = (weighted[1:] + weighted[:-1]) / 2 * np.diff(share)
    return share**2, np.concatenate([[0.0], np.cumsum(steps)])


def _loss(squares: "NDArray[np.float64]", threshold: float) -> float:
    """Return the loss of a model, from the squared residuals of all measurements."""
    import numpy as np

    share, losses = _losses()
    return float(np.interp(squares / threshold**2, share, losses).sum())


def _wrap(
    original: Callable[..., Any], estimator: _Estimator, defaults: dict[str, Any]
) -> Callable[..., Any]:
    """Return the exact estimator."""

    def is_ours(settings: Settings) -> bool:
        return bool(settings["sampler"] == _UNIFORM)

    def count(settings: Settings, found: Any) -> int:
        if found[0] is None:
            return 0
        near = settings["sigma_th"]
        is_mask = not estimator.squared_mask or near == 1.0
        if settings["use_magsac_plus_plus"] and near > _REFERENCE_THRESHOLD:
            near, is_mask = _REFERENCE_THRESHOLD, False
        if is_mask:
            return int(found[1].sum())
        return int((estimator.squares(settings, found[0], False) <= near**2).sum())

    def loss(settings: Settings, found: Any) -> float:
        return _loss(estimator.squares(settings, found[0], True), settings["sigma_th"])

    return floored(
        original,
        defaults,
        estimator.sample_size,
        points="correspondences",
        is_ours=is_ours,
        count=count,
        rule=_rule,
        loss=loss,
    )


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the four functions."""
    known = documented_functions(module, _KNOWN_VERSION, dict.fromkeys(_ESTIMATORS, _NEEDED))
    return tuple(
        Replacement(holder=module, name=name, exact=_wrap(original, _ESTIMATORS[name], defaults))
        for name, (original, defaults) in known.items()
    )


PATCH = LibraryPatch(
    system="magsac",
    requirements=("pymagsac==0.2.3",),
    modules=("pymagsac",),
    plan=plan,
    observe=plan,
    wraps=True,
)
