"""PoseLib: its estimators, up to 2.0.5.

The rule is compiled in and assumes p**k up to 2.0.5, so the estimators are wrapped: see
`ransac_fix.patching.missing`. PoseLib reports its iterations, and has a minimum of them: the
missing ones are drawn exactly, with another seed, and the model with the better score is kept.

The promise is the caller's ``success_prob``, once: PoseLib's own defaults of 1000 iterations at
least, and of three times what its rule says (``dyn_num_trials_mult``), mostly keep it already.

Two samplers are not uniform, and the chance is that of their draws:
``estimate_generalized_absolute_pose`` draws a camera first and one of its points second,
``estimate_generalized_relative_pose`` draws five matches of one pair of cameras and one of another.

Passed through untouched: ``progressive_sampling``, and ``estimate_hybrid_pose`` with matches to a
map, where 2.0.5 draws points that do not exist.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeAlias

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import (
    Attempt,
    Promise,
    Spare,
    complete,
    fresh_seed,
    missing_trials,
    own_function,
    raised_confidence,
    slack,
)

__all__ = ["PATCH"]

Result = tuple[Any, dict[str, Any]]
Groups: TypeAlias = list[tuple[int, int]]
"""Inliers and measurements of each group."""

# PoseLib's own defaults.
_CONFIDENCE, _MAX_ITERATIONS, _MULTIPLIER, _SEED = 0.9999, 100_000, 3.0, 0
_SPARE = Spare(10)


@dataclass(frozen=True, slots=True)
class _Estimator:
    """One function: the size of its samples, and where its options stand among its arguments."""

    sample_size: int
    position: int
    # Of the inliers and measurements of each camera or pair, where samples are not uniform.
    chance: Callable[[Groups], float] | None = None
    # Lines are measurements too.
    lines: bool = False
    # Where the matches to a map stand, for whose samples there is no law.
    untouched_with: tuple[int, str] | None = None


def _chance_by_camera(cameras: Groups) -> float:
    """Return the chance that three draws give inliers only.

    A draw takes a camera, then one of its points, and is repeated where that point was drawn
    before: points are drawn without replacement, with weights 1 / (cameras x points of theirs).

    Parameters
    ----------
    cameras : list of (int, int)
        Inliers and points of each camera.
    """
    if any(n_samples == 0 for _, n_samples in cameras):
        return 1.0  # such a camera would give no sample at all: nothing to promise
    groups = [(inliers, 1.0 / (len(cameras) * n_samples)) for inliers, n_samples in cameras]
    total = sum(inliers * weight for inliers, weight in groups)
    chance = 0.0
    for index, (inliers, weight) in enumerate(groups):
        for other, (more, second) in enumerate(groups):
            left = more - (other == index)
            if inliers > 0 and left > 0 and weight + second < 1:
                third = (total - weight - second) / (1 - weight - second)
                chance += inliers * weight * left * second / (1 - weight) * max(third, 0.0)
    return min(chance, 1.0)


def _chance_by_pair(pairs: Groups) -> float:
    """Return the chance that five draws from one pair and one from another give inliers only.

    Any two pairs are as likely as any others, the first of them among those with five matches.

    Parameters
    ----------
    pairs : list of (int, int)
        Inliers and matches of each pair of cameras.
    """
    seconds = [inliers / n_samples for inliers, n_samples in pairs if n_samples > 0]
    firsts = [
        (math.comb(inliers, 5) / math.comb(n_samples, 5), inliers / n_samples)
        for inliers, n_samples in pairs
        if n_samples >= 5
    ]
    if not firsts or len(seconds) < 2:
        return 1.0  # no sample at all: nothing to promise
    total = math.fsum(seconds)
    chance = math.fsum(five * (total - own) for five, own in firsts)
    return min(chance / (len(firsts) * (len(seconds) - 1)), 1.0)


_ESTIMATORS = {
    "estimate_absolute_pose": _Estimator(3, 3),
    "estimate_absolute_pose_pnpl": _Estimator(3, 7, lines=True),
    "estimate_generalized_absolute_pose": _Estimator(3, 4, _chance_by_camera),
    "estimate_generalized_relative_pose": _Estimator(6, 5, _chance_by_pair),
    "estimate_hybrid_pose": _Estimator(3, 6, untouched_with=(2, "matches_2D_2D")),
    "estimate_relative_pose": _Estimator(5, 4),
    "estimate_shared_focal_relative_pose": _Estimator(6, 3),
    "estimate_fundamental": _Estimator(7, 2),
    "estimate_homography": _Estimator(4, 2),
    "estimate_1D_radial_absolute_pose": _Estimator(5, 2),
}


def _wrap(original: Callable[..., Any], estimator: _Estimator) -> Callable[..., Any]:
    """Return the exact estimator."""
    k, position = estimator.sample_size, estimator.position

    def call(options: dict[str, Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        if len(args) > position:
            return original(*args[:position], options, *args[position + 1 :], **kwargs)
        return original(*args, **{**kwargs, "ransac_opt": options})

    def exact(*args: Any, **kwargs: Any) -> Any:
        options = (args[position] if len(args) > position else kwargs.get("ransac_opt")) or {}
        try:
            asked = _asked(options, args, kwargs, estimator)
        except (TypeError, AttributeError, LookupError):  # PoseLib says what is wrong with them
            asked = {}
        result = call({**options, **asked}, args, kwargs) if asked else original(*args, **kwargs)
        n_inliers, n_samples, trials, chance = _read(result, estimator)
        if (
            n_samples <= k
            or options.get("progressive_sampling")
            or _is_untouched(args, kwargs, estimator)
        ):
            return result
        confidence = options.get("success_prob", _CONFIDENCE)
        limit = options.get("max_iterations", _MAX_ITERATIONS)
        if not missing_trials(
            n_inliers, n_samples, k, confidence, trials, limit, slack(), chance=chance
        ):
            return result

        def run(trials: int, round_: int) -> Attempt[Result]:
            settings = {
                **options,
                "min_iterations": trials,
                "max_iterations": trials,
                "seed": fresh_seed(int(options.get("seed", _SEED)), round_),
            }
            again = call(settings, args, kwargs)
            n_inliers, _, ran, chance = _read(again, estimator)
            return Attempt(again, n_inliers, ran, chance)

        return complete(
            Attempt(result, n_inliers, trials, chance),
            Promise(n_samples, k, confidence, limit),
            run,
            _is_better,
        )

    return exact


def _is_untouched(args: tuple[Any, ...], kwargs: dict[str, Any], estimator: _Estimator) -> bool:
    """Return whether a call comes with what there is no law for."""
    if estimator.untouched_with is None:
        return False
    position, name = estimator.untouched_with
    return len(args[position] if len(args) > position else kwargs[name]) > 0


def _asked(
    options: dict[str, Any],
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
    estimator: _Estimator,
) -> dict[str, float]:
    """Return what to change in the options of the first run: the confidence, where it serves."""
    if estimator.chance is not None or options.get("progressive_sampling"):
        return {}
    if _is_untouched(args, kwargs, estimator):
        return {}
    first = "points2D" if "points2D" in kwargs else "points2D_1"
    n_samples = len(args[0] if args else kwargs[first])
    if estimator.lines:
        n_samples += len(args[2] if len(args) > 2 else kwargs["lines2D_1"])
    confidence = options.get("success_prob", _CONFIDENCE)
    raised = raised_confidence(
        n_samples,
        estimator.sample_size,
        confidence,
        _SPARE,
        multiplier=options.get("dyn_num_trials_mult", _MULTIPLIER),
    )
    return {} if raised == confidence else {"success_prob": raised}


def _read(result: Result, estimator: _Estimator) -> tuple[int, int, int, float | None]:
    """Return inliers, measurements and iterations of a run, and the chance of its samples."""
    info = result[1]
    inliers = info["inliers"]
    n_samples = len(inliers)
    chance = None
    if estimator.chance is not None:
        chance = estimator.chance([(sum(group), len(group)) for group in inliers])
        n_samples = sum(map(len, inliers))
    n_samples += len(info.get("inliers_lines", ()))
    return info["num_inliers"], n_samples, info["iterations"], chance


def _is_better(new: Result, best: Result) -> bool:
    # The score is a truncated sum of squares; without a model it says nothing.
    if new[1]["num_inliers"] == 0 or best[1]["num_inliers"] == 0:
        return bool(new[1]["num_inliers"] > best[1]["num_inliers"])
    return bool(new[1]["model_score"] < best[1]["model_score"])


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: the estimators."""
    originals = {}
    for name, estimator in _ESTIMATORS.items():
        original = own_function(module, name)
        if original is None:  # not in this release
            continue
        if "ransac_opt: dict" not in (original.__doc__ or ""):
            raise PatchNotApplicable(f"poselib.{name} does not take ransac_opt")
        originals[name] = original, estimator
    if "estimate_homography" not in originals:
        raise PatchNotApplicable("poselib has no estimate_homography")
    return tuple(
        Replacement(holder=module, name=name, exact=_wrap(original, estimator))
        for name, (original, estimator) in originals.items()
    )


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the estimators, where their rule assumes p**k."""
    wrapped = observe(module)
    homography = own_function(module, "estimate_homography")
    assert homography is not None
    return () if _is_exact(homography) else wrapped


def _is_exact(estimate: Callable[..., Any]) -> bool:
    """Return whether the rule is exact: PoseLib says how many iterations it ran."""
    import numpy as np

    rng = np.random.default_rng(0)
    n_samples, n_inliers, confidence = 20, 9, 0.99
    x = rng.uniform(0, 1000, (n_samples, 2))
    y = x + rng.uniform(-100, 100, x.shape)
    y[:n_inliers] = x[:n_inliers] + np.array([10.0, 20.0])
    setting = n_inliers, n_samples, 4, confidence
    laws = {False: approximate_required_trials(*setting), True: required_trials(*setting)}
    for seed in range(40):
        options = {
            "min_iterations": 0,
            "max_iterations": 1000,
            "dyn_num_trials_mult": 1.0,
            "success_prob": confidence,
            "max_reproj_error": 1e-3,
            "seed": seed,
        }
        info: Mapping[str, Any] = estimate(x, y, options, {})[1]
        for exact, trials in laws.items():
            if info["num_inliers"] == n_inliers and math.fabs(info["iterations"] - trials) <= 2:
                return exact
    raise PatchNotApplicable("estimate_homography follows neither rule")


PATCH = LibraryPatch(
    system="poselib",
    requirements=("poselib>=2.0.5,<=2.0.5",),
    modules=("poselib",),
    plan=plan,
    observe=observe,
    wraps=True,
    counts_trials=True,
)
