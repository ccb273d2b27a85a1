"""pyTheia: the estimators that run plain RANSAC and report it.

The rule is that of distinct samples since 0.2.6, but for two roundings. It works with
``int(I / n * n)``, which is one too small for one (I, n) in 26 and then asks for more trials than
are needed, up to several times as many; and it rounds down. The functions are wrapped, see
`ransac_fix.patching.missing`: with the true number of inliers, the trials that rounding leaves out
are drawn. There is no seed, so they are fresh samples. What was run beyond the exact number cannot
be taken back: it has been run by the time I is known. pyTheia says how many trials there were.

By default inliers decide which model is better. With ``use_mle`` the sum of truncated squared
residuals does, which pyTheia does not return, so such calls are passed through untouched, as are
``use_Tdd_test``, which verifies with a further measurement, and other kinds than
``RansacType.RANSAC``. Estimators whose samples were not measured are not wrapped.
"""

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

from ransac_fix.criterion import approximate_required_trials, required_trials
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

_SAMPLE_SIZES = {
    "EstimateHomography": 4,
    "EstimateFundamentalMatrix": 8,
    "EstimateEssentialMatrix": 5,
    "EstimateRelativePose": 5,
    "EstimateDominantPlaneFromPoints": 3,
}


def _wrap(module: Any, original: Callable[..., Any], sample_size: int) -> Callable[..., Any]:
    """Return the exact estimator: called with parameters, the kind of RANSAC, and measurements."""
    plain = module.sfm.RansacType.RANSAC

    def exact(*args: Any, **kwargs: Any) -> Any:
        result = original(*args, **kwargs)
        if kwargs or len(args) != 3:
            return result
        parameters, kind, measurements = args
        if kind != plain or parameters.use_mle or parameters.use_Tdd_test:
            return result
        n_samples = result[-1].num_input_data_points
        if n_samples <= sample_size:
            return result
        confidence = 1.0 - parameters.failure_probability
        limit: float = parameters.max_iterations
        if parameters.min_inlier_ratio > 0:
            fewest = math.floor(parameters.min_inlier_ratio * n_samples)
            bound = required_trials(fewest, n_samples, sample_size, confidence)
            limit = min(limit, max(bound, parameters.min_iterations))
        first = _attempt(result)
        if not missing_trials(
            first.n_inliers, n_samples, sample_size, confidence, first.trials, limit, slack()
        ):
            return result

        def run(trials: int, _round: int) -> Attempt[Any]:
            settings = _copy(module, parameters)
            settings.min_iterations = settings.max_iterations = trials
            return _attempt(original(settings, kind, measurements))

        promise = Promise(n_samples, sample_size, confidence, limit)
        return complete(first, promise, run)

    return exact


def _attempt(result: Any) -> Attempt[Any]:
    summary = result[-1]
    n_inliers = len(summary.inliers) if result[0] else 0
    return Attempt(result, n_inliers, summary.num_iterations)


def _copy(module: Any, parameters: Any) -> Any:
    copy = module.solvers.RansacParameters()
    for name in dir(copy):
        # A generator cannot be set from Python.
        if not name.startswith("_") and name != "rng":
            setattr(copy, name, getattr(parameters, name))
    return copy


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: the estimators whose samples are known."""
    home = getattr(module, "sfm", None)
    if home is None or not hasattr(getattr(module, "solvers", None), "RansacParameters"):
        raise PatchNotApplicable("pytheia has no sfm and no solvers.RansacParameters")
    replacements = []
    for name, sample_size in _SAMPLE_SIZES.items():
        original = own_function(home, name)
        if original is not None:  # in this release
            exact = _wrap(module, original, sample_size)
            replacements.append(Replacement(holder=home, name=name, exact=exact))
    if not replacements:
        raise PatchNotApplicable("pytheia.sfm has none of the known estimators")
    return tuple(replacements)


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the estimators, where their rule is one of those known."""
    wrapped = observe(module)
    _check(module)
    return wrapped


def _check(module: Any) -> None:
    """Refuse a rule that is neither that of distinct samples, rounded down, nor p**k."""
    import numpy as np

    rng = np.random.default_rng(0)
    n_samples, n_inliers, confidence = 20, 10, 0.99
    points = rng.uniform(-1, 1, (n_samples, 3))
    points[:n_inliers, 2] = 0.3 * points[:n_inliers, 0] - 0.2 * points[:n_inliers, 1] + 0.1
    parameters = module.solvers.RansacParameters()
    parameters.error_thresh, parameters.failure_probability = 1e-8, 1.0 - confidence
    parameters.min_iterations, parameters.max_iterations = 0, 10_000
    estimate = own_function(module.sfm, "EstimateDominantPlaneFromPoints")
    if estimate is None:
        raise PatchNotApplicable("pytheia.sfm has no EstimateDominantPlaneFromPoints to look at")
    setting = n_inliers, n_samples, 3, confidence
    laws = required_trials(*setting), approximate_required_trials(*setting)
    for _ in range(40):
        _, _, summary = estimate(parameters, module.sfm.RansacType.RANSAC, list(points))
        if len(summary.inliers) == n_inliers and any(
            abs(summary.num_iterations - law) <= 1 for law in laws
        ):
            return
    raise PatchNotApplicable("EstimateDominantPlaneFromPoints follows neither rule")


PATCH = LibraryPatch(
    system="theia",
    requirements=("pytheia==1.2.1",),
    modules=("pytheia",),
    plan=plan,
    observe=observe,
    wraps=True,
    counts_trials=True,
)
