"""Open3D: registration from correspondences, and plane segmentation.

Both rules assume p**k. Registration draws its sample *with replacement*, and a repeated
correspondence makes it useless: the exact chance is I (I-1) ... (I-k+1) / n**k. Planes are
segmented from distinct points, those of a tensor cloud by the same code. The rules are compiled
in, so the functions are wrapped: see `ransac_fix.patching.missing`. The missing trials are drawn
with a confidence of 1, which runs all that are asked for; the global generator goes on from call
to call, so they are fresh samples, and a program that calls ``open3d.utility.random.seed`` repeats
as far as Open3D's own threads do. The better result is the one with the higher fitness, then the
smaller error.

How many trials Open3D ran it does not say, and its threads race. The wrapper takes the smallest
number that its rule can have asked for.

`registration_ransac_based_on_feature_matching` matches the features and registers the
correspondences, of which it does not say how many there were. The wrapper takes the same two steps,
with the functions that Open3D has for them, and features are matched once.

There is nothing to repeat and too much noise in a race to look at the rule quickly, so releases
other than those it was measured in are refused.
"""

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

from packaging.version import InvalidVersion, Version

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import (
    Attempt,
    Promise,
    complete,
    missing_trials,
    own_function,
    slack,
)

__all__ = ["PATCH"]

Bound = dict[str, Any]

_OLDEST, _NEWEST = Version("0.19"), Version("0.21.dev0")
_COMMON = (
    "max_correspondence_distance",
    "estimation_method",
    "ransac_n",
    "checkers",
    "criteria",
)
_FEATURES = "source_feature", "target_feature", "mutual_filter"
_MATCHED = "source_features", "target_features", "mutual_filter"
_FEATURE_NAMES = ("source", "target", *_FEATURES, *_COMMON)
_CORRESPONDENCE_NAMES = ("source", "target", "corres", *_COMMON)
_PLANE_NAMES = ("distance_threshold", "ransac_n", "num_iterations", "probability")
_PLANE_DEFAULTS = {"probability": 0.99999999}
_TENSOR_PLANE_DEFAULTS = {"ransac_n": 3, "num_iterations": 100, "probability": 0.999}


def _trials(
    n_inliers: int,
    n_samples: int,
    sample_size: int,
    confidence: float,
    limit: float,
    rounding: Callable[[float], int],
) -> float:
    """Return what Open3D's own rule asks for with `n_inliers` in hand, up to its limit."""
    chance = (n_inliers / n_samples) ** sample_size
    if chance <= 0 or confidence >= 1:
        return limit
    if chance >= 1:
        return min(1, limit)
    return min(max(rounding(math.log(1 - confidence) / math.log1p(-chance)), 1), limit)


def _wrap_registration(
    registration: Any, original: Callable[..., Any], names: tuple[str, ...]
) -> Callable[..., Any]:
    """Return the exact registration of correspondences."""
    defaults = registration.RANSACConvergenceCriteria()

    def exact(*args: Any, **kwargs: Any) -> Any:
        result = original(*args, **kwargs)
        settings = {**dict(zip(names, args, strict=False)), **kwargs}
        criteria = settings.get("criteria", defaults)
        k = settings.get("ransac_n", 3)
        n_samples = len(settings["corres"])
        n_inliers = len(result.correspondence_set)
        if not k <= n_inliers or n_samples <= k:  # no model: it has run to its limit, or not at all
            return result
        confidence, limit = criteria.confidence, criteria.max_iteration
        trials = _trials(n_inliers, n_samples, k, confidence, limit, math.ceil)
        if not missing_trials(
            n_inliers, n_samples, k, confidence, trials, limit, slack(), "replacement"
        ):
            return result

        def run(trials: int, _round: int) -> Attempt[Any]:
            whole = registration.RANSACConvergenceCriteria(trials, 1.0)
            again = original(**{**settings, "criteria": whole})
            return Attempt(again, len(again.correspondence_set), trials)

        return complete(
            Attempt(result, n_inliers, trials),
            Promise(n_samples, k, confidence, limit, "replacement"),
            run,
            lambda new, best: (new.fitness, -new.inlier_rmse) > (best.fitness, -best.inlier_rmse),
        )

    return exact


def _wrap_feature_matching(
    original: Callable[..., Any], match: Callable[..., Any], register: Callable[..., Any]
) -> Callable[..., Any]:
    """Return the exact registration of features: those that match are registered."""

    def exact(*args: Any, **kwargs: Any) -> Any:
        settings = {**dict(zip(_FEATURE_NAMES, args, strict=False)), **kwargs}
        if not settings.keys() >= set(_FEATURES):
            return original(*args, **kwargs)  # which says what is missing
        features = [settings.pop(name) for name in _FEATURES]
        return register(**settings, corres=match(*features))

    return exact


def _wrap_segment_plane(
    original: Callable[..., Any], defaults: dict[str, Any], count: Callable[[Any], int]
) -> Callable[..., Any]:
    """Return the exact method of clouds whose points `count` counts."""

    def exact(self: Any, *args: Any, **kwargs: Any) -> Any:
        result = original(self, *args, **kwargs)
        settings = {**defaults, **dict(zip(_PLANE_NAMES, args, strict=False)), **kwargs}
        confidence = settings["probability"]
        k, limit = settings["ransac_n"], settings["num_iterations"]
        n_samples, n_inliers = count(self), len(result[1])
        if n_samples <= k or n_inliers == 0:
            return result
        trials = _trials(n_inliers, n_samples, k, confidence, limit, math.floor)
        if not missing_trials(n_inliers, n_samples, k, confidence, trials, limit, slack()):
            return result

        def run(trials: int, _round: int) -> Attempt[Any]:
            again = original(self, **{**settings, "num_iterations": trials, "probability": 1.0})
            return Attempt(again, len(again[1]), trials)

        return complete(
            Attempt(result, n_inliers, trials),
            Promise(n_samples, k, confidence, limit),
            run,
        )

    return exact


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: two functions, and a method of two kinds of clouds."""
    version = str(getattr(module, "__version__", ""))
    try:
        known = _OLDEST <= Version(version) < _NEWEST
    except InvalidVersion:
        known = False
    if not known:
        raise PatchNotApplicable(f"the rule of release {version or 'unknown'} was not measured")
    registration = module.pipelines.registration
    cloud, tensor_cloud = module.geometry.PointCloud, module.t.geometry.PointCloud
    by_pairs, by_features = (
        f"registration_ransac_based_on_{what}" for what in ("correspondence", "feature_matching")
    )
    original = _checked(registration, by_pairs, _CORRESPONDENCE_NAMES)
    register = _wrap_registration(registration, original, _CORRESPONDENCE_NAMES)
    match = _checked(registration, "correspondences_from_features", _MATCHED)
    of_features = _checked(registration, by_features, _FEATURE_NAMES)
    segment = _checked(cloud, "segment_plane", _PLANE_NAMES)
    segment_tensor = _checked(tensor_cloud, "segment_plane", _PLANE_NAMES)
    wrapped = (
        (registration, by_pairs, register),
        (registration, by_features, _wrap_feature_matching(of_features, match, register)),
        (
            cloud,
            "segment_plane",
            _wrap_segment_plane(segment, _PLANE_DEFAULTS, lambda cloud: len(cloud.points)),
        ),
        (
            tensor_cloud,
            "segment_plane",
            _wrap_segment_plane(
                segment_tensor,
                _TENSOR_PLANE_DEFAULTS,
                lambda cloud: len(cloud.point.positions),
            ),
        ),
    )
    return tuple(Replacement(holder=h, name=name, exact=exact) for h, name, exact in wrapped)


def _checked(holder: Any, name: str, names: tuple[str, ...]) -> Callable[..., Any]:
    """Return a function whose docstring names its parameters in the known order."""
    original = own_function(holder, name)
    first_line = (getattr(original, "__doc__", None) or "").partition("\n")[0]
    places = [first_line.find(f"{parameter}: ") for parameter in names]
    if original is None or -1 in places or places != sorted(places):
        raise PatchNotApplicable(f"open3d has no {name} that takes {', '.join(names)}")
    return original


PATCH = LibraryPatch(
    system="open3d",
    requirements=("open3d>=0.19,<=0.20", "open3d-cpu>=0.19,<=0.20"),
    modules=("open3d",),
    plan=plan,
    observe=plan,
    wraps=True,
)
