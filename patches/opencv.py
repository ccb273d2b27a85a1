"""OpenCV: every function with a RANSAC loop, classic (``cv2.RANSAC``) and USAC.

The rule is compiled in, so the functions are wrapped: see `ransac_fix.patching.missing`. The
missing trials are drawn by the same function on the measurements in another order, since the
classic generator starts from the same state in every call; masks and indices come back in the
caller's order. Both families draw distinct measurements. The classic one redraws samples that
fail its checks for free, which only helps.

Passed through untouched: other methods (0, LMEDS, RHO, the 7- and 8-point algorithms, and
``FM_RANSAC`` below 15 points, where OpenCV runs LMedS); USAC with a sampler that is not uniform
(PROSAC, NAPSAC), or a score that does not judge a model by its inliers (MAGSAC, whose range of
residuals is fixed and not the threshold; LMEDS); ``estimateTranslation2D``, whose samples of one
measurement make both rules the same; arguments that are not NumPy arrays (``cv2.UMat``).

``estimateAffine3D``, ``estimateTranslation3D`` and the form of ``findEssentialMat`` with two
cameras take no number of trials: theirs is bounded by OpenCV's own 1000, and the missing ones
are asked for through the confidence.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from math import exp, floor, inf, log, log1p
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching import residuals
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
    with_argument,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["PATCH"]

_RANSAC = 8
_USAC = range(32, 39)
_USAC_8_POINTS, _USAC_PROSAC, _USAC_MAGSAC = 34, 37, 38
_UNIFORM = 0  # sampler
_COUNT_SCORE, _MSAC_SCORE = 0, 1
# Where USAC truncates the squared residual, in squared thresholds.
_TRUNCATION = 9.0 / 4.0
# The classic rule: a confidence within 2**-52 of 1 is taken for 0.99 by some functions, and by
# others refused.
_HIGHEST_CONFIDENCE = 1.0 - 2.0**-50
_EPSILON = 2.0**-52
_SMALLEST_FLOAT = 2.0**-1022
# What the functions without a knob for it run at most.
_FIXED_LIMIT = 1000
# USAC optimises and polishes for longer than it draws.
_SPARE = {"classic": Spare(1, 0.03), "usac": Spare(15, 0.1)}

Bound = dict[str, Any]
Result = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class _Form:
    """One overload of one function.

    Parameters
    ----------
    function : str
        Its name.
    names : tuple of str
        Its parameters in order, as in its docstring.
    defaults : dict
        Default values that matter here. A repeated call names them all.
    sample_sizes : tuple of int
        Measurements in one sample, classic and USAC; 0 where there is no such method.
    points : tuple of str
        The parameters that hold the measurements.
    outputs : tuple of str
        The parameters that are results too.
    inliers : int
        Where the mask stands in the result.
    indices : bool
        The result holds indices of inliers. OpenCV 4 gives a mask with ``cv2.UsacParams``.
    method, confidence, max_trials, threshold : str
        Names of these parameters; `max_trials` is empty where there is none.
    fewest : int
        Below so many measurements it runs another method.
    careless : bool
        A confidence of 0 or 1 is taken for 0.99.
    residuals : callable
        ``residuals(cv2, bound, result)``: squared residuals in units of the threshold. Only for
        USAC, whose measure is a truncated sum of them.
    """

    function: str
    names: tuple[str, ...]
    sample_sizes: tuple[int, int]
    defaults: Bound
    residuals: "Callable[[Any, Bound, Result], NDArray[np.float64]] | None" = None
    points: tuple[str, str] = ("points1", "points2")
    outputs: tuple[str, ...] = ("mask",)
    inliers: int = 1
    indices: bool = False
    method: str = "method"
    confidence: str = "confidence"
    max_trials: str = "maxIters"
    threshold: str = "ransacReprojThreshold"
    fewest: int = 0
    careless: bool = False

    has_params: bool = field(init=False)

    def __post_init__(self) -> None:
        # Whether the settings are a ``cv2.UsacParams``.
        object.__setattr__(self, "has_params", "params" in self.names)


@dataclass(slots=True)
class _Call:
    """One call of a wrapped function, as far as the rule is concerned."""

    bound: Bound
    kind: str
    sample_size: int
    confidence: float
    max_trials: float
    n_samples: int
    seed: int = 0
    first_inliers: int = field(default=0)


def _trials(
    kind: str, n_inliers: int, n_samples: int, sample_size: int, confidence: float, limit: float
) -> float:
    """Return what OpenCV's own rule asks for with `n_inliers` in hand, up to its limit."""
    if n_inliers <= 0:
        return limit
    if kind == "classic":
        outliers = (n_samples - n_inliers) / n_samples
        miss = 1.0 - (1.0 - outliers) ** sample_size
        if miss < _SMALLEST_FLOAT:
            return min(1.0, limit)
        allowed = log(max(1.0 - confidence, _SMALLEST_FLOAT))
        rule: float = round(allowed / log(miss)) if miss < 1.0 else inf
    else:
        miss = 1.0 - (n_inliers / n_samples) ** sample_size
        if miss <= 0.0:
            return min(1.0, limit)
        certain = confidence >= 1.0 or miss >= 1.0
        rule = inf if certain else floor(log(1.0 - confidence) / log(miss))
    return min(max(rule, 1.0), limit)


def _read(form: _Form, args: Result, kwargs: Bound, p3p: frozenset[int]) -> _Call | None:
    """Return what a call asks for; None where it is none of ours.

    `p3p` are the flags of solvePnPRansac for three points: OpenCV 5 has numbered them anew.
    """
    bound = dict(zip(form.names, args))  # noqa: B905 -- fewer arguments than names
    if kwargs:
        bound.update(kwargs)
    points: Any = bound.get(form.points[1])
    if type(points).__name__ != "ndarray" or points.size == 0:  # a cv2.UMat, or nothing at all
        return None
    n_samples = points.size // points.shape[-1]
    if form.has_params:
        return _read_params(form, bound, n_samples)
    defaults = form.defaults
    method: Any = bound.get(form.method, defaults.get(form.method, _RANSAC))
    confidence: Any = bound.get(form.confidence, defaults[form.confidence])
    if method in _USAC:
        kind, sample_size = "usac", form.sample_sizes[1]
        if method in (_USAC_PROSAC, _USAC_MAGSAC):
            return None
        if method == _USAC_8_POINTS:
            sample_size = 8
    elif form.function == "solvePnPRansac":
        # Its flags name the solver; P3P takes a fourth point to choose among its solutions.
        kind, sample_size = "classic", 4 if method in p3p else form.sample_sizes[0]
    else:
        # findFundamentalMat looks at some bits of its method only.
        bits = method & ~3 if form.function == "findFundamentalMat" else method
        if bits != _RANSAC or n_samples < form.fewest:
            return None
        kind, sample_size = "classic", form.sample_sizes[0]
    if form.careless and not _EPSILON <= confidence <= 1.0 - _EPSILON:
        confidence = 0.99
    limit: Any = bound.get(form.max_trials, defaults.get(form.max_trials, _FIXED_LIMIT))
    if n_samples <= sample_size or sample_size == 0:
        return None
    return _Call(bound, kind, sample_size, float(confidence), max(limit, 1), n_samples)


def _read_params(form: _Form, bound: Bound, n_samples: int) -> _Call | None:
    params = bound.get("params")
    sample_size = form.sample_sizes[1]
    if (
        params is None
        or params.sampler != _UNIFORM
        or params.score not in (_COUNT_SCORE, _MSAC_SCORE)
        or n_samples <= sample_size
    ):
        return None
    return _Call(
        bound,
        "usac",
        sample_size,
        params.confidence,
        params.maxIterations,
        n_samples,
        params.randomGeneratorState,
    )


def _wrap(
    cv2: ModuleType,
    original: Callable[..., Any],
    choose: Callable[[Result, Bound], _Form | None],
    kinds: frozenset[str],
) -> Callable[..., Any]:
    """Return the exact function.

    Parameters
    ----------
    cv2 : module
        The library.
    original : callable
        Its function.
    choose : callable
        ``choose(args, kwargs)`` says which overload a call is for.
    kinds : frozenset of str
        The families whose rule is to be made exact: "classic", "usac".
    """
    flags = (getattr(cv2, name, None) for name in ("SOLVEPNP_P3P", "SOLVEPNP_AP3P"))
    p3p = frozenset(flag for flag in flags if flag is not None)

    def exact(*args: Any, **kwargs: Any) -> Any:
        form = choose(args, kwargs)
        if form is None:
            return original(*args, **kwargs)
        try:
            call = _read(form, args, kwargs, p3p)
        except (TypeError, AttributeError):  # OpenCV says what is wrong with the arguments
            call = None
        if call is None or call.kind not in kinds:
            return original(*args, **kwargs)
        guess = _guess(form, args, kwargs) if form.indices else {}
        promise = call.n_samples, call.sample_size, call.confidence
        asked = raised_confidence(*promise, _SPARE[call.kind])
        if asked != call.confidence:
            args, kwargs = _asking(cv2, form, args, kwargs, asked)
        result = original(*args, **kwargs)
        inliers = result[form.inliers]
        if type(inliers).__name__ != "ndarray":  # no model
            return result
        n_inliers = _count(cv2, form, inliers)
        trials = _trials(call.kind, n_inliers, *promise[:2], asked, call.max_trials)
        if not missing_trials(n_inliers, *promise, trials, call.max_trials, slack()):
            return result
        call.bound.update(guess)
        call.first_inliers = n_inliers
        best = complete(
            Attempt(result, n_inliers, trials),
            Promise(*promise, call.max_trials),
            lambda trials, round_: _again(cv2, original, form, call, trials, round_),
            lambda new, best: _is_better(cv2, form, call, new, best),
        )
        return _delivered(result, best)

    return exact


def _asking(
    cv2: Any, form: _Form, args: Result, kwargs: Bound, confidence: float
) -> tuple[Result, Bound]:
    """Return the arguments of a call with another confidence."""
    if not form.has_params:
        return with_argument(form.names, args, kwargs, form.confidence, confidence)
    place = form.names.index("params")
    params = args[place] if place < len(args) else kwargs["params"]
    changed = _copy(cv2, params, confidence=confidence)
    return with_argument(form.names, args, kwargs, "params", changed)


def _again(
    cv2: Any, original: Callable[..., Any], form: _Form, call: _Call, trials: int, round_: int
) -> Attempt[Result]:
    """Run the function for so many trials with the measurements in another order."""
    import numpy as np

    order = np.random.default_rng((call.seed & 0xFFFFFFFF, round_)).permutation(call.n_samples)
    bound = {**form.defaults, **call.bound}
    for name in form.points:
        points = bound[name]
        bound[name] = np.take(points, order, axis=points.shape.index(call.n_samples))
    guessing = bound.get("useExtrinsicGuess")
    for name in form.outputs:
        if not (guessing and name in ("rvec", "tvec")):
            bound.pop(name, None)
        elif name in bound:
            bound[name] = bound[name].copy()
    confidence, limit = _HIGHEST_CONFIDENCE, float(trials)
    if form.has_params:
        bound["params"] = _copy(
            cv2,
            bound["params"],
            confidence=confidence,
            maxIterations=trials,
            randomGeneratorState=fresh_seed(call.seed, round_),
        )
    else:
        if form.max_trials:
            bound[form.max_trials] = trials
        else:
            limit = _FIXED_LIMIT
            confidence = _confidence_for(trials, call)
        bound[form.confidence] = confidence
    result = list(original(**bound))
    inliers = result[form.inliers]
    n_inliers = 0
    if inliers is not None and inliers.size:
        n_inliers = _count(cv2, form, inliers)
        restored = np.empty_like(inliers)
        if _are_indices(form, inliers):
            restored.reshape(-1)[:] = np.sort(order[inliers.reshape(-1)])
        else:
            restored.reshape(-1)[order] = inliers.reshape(-1)
        result[form.inliers] = restored
    ran = _trials(call.kind, n_inliers, call.n_samples, call.sample_size, confidence, limit)
    return Attempt(tuple(result), n_inliers, ran)


def _are_indices(form: _Form, inliers: Any) -> bool:
    return form.indices and inliers.dtype.itemsize > 1


def _count(cv2: Any, form: _Form, inliers: Any) -> int:
    if _are_indices(form, inliers):
        return int(inliers.size)
    return int(cv2.countNonZero(inliers))


def _confidence_for(trials: int, call: _Call) -> float:
    """Return the confidence at which the library's rule asks for so many trials."""
    ratio = call.first_inliers / call.n_samples
    chance = ratio**call.sample_size
    if chance >= 1.0:
        return _HIGHEST_CONFIDENCE
    return min(1.0 - exp((trials + 0.25) * log1p(-chance)), _HIGHEST_CONFIDENCE)


def _copy(cv2: Any, params: Any, **changes: float) -> Any:
    """Return a ``cv2.UsacParams`` with other values."""
    copy = cv2.UsacParams()
    for name in dir(copy):
        if not name.startswith("_"):
            setattr(copy, name, changes.get(name, getattr(params, name)))
    return copy


def _is_better(cv2: Any, form: _Form, call: _Call, new: Result, best: Result) -> bool:
    """Compare two results by OpenCV's own measure. With the same inliers the earlier is kept."""
    ours, theirs = new[form.inliers], best[form.inliers]
    both = ours is not None and theirs is not None and ours.shape == theirs.shape
    # What a second run finds is mostly what the first has found.
    if both and (ours == theirs).all():
        return False
    return _measure(cv2, form, call, new) > _measure(cv2, form, call, best)


def _measure(cv2: Any, form: _Form, call: _Call, result: Result) -> float:
    """Return how good a result is: inliers, or minus the truncated sum of squares for USAC."""
    inliers = result[form.inliers]
    if result[0] is None or result[0] is False or inliers is None:
        return -inf
    by_count = form.has_params and call.bound["params"].score == _COUNT_SCORE
    if call.kind == "classic" or by_count or form.residuals is None:
        return float(_count(cv2, form, inliers))
    squares = form.residuals(cv2, {**form.defaults, **call.bound}, result)
    return -float(squares.clip(max=_TRUNCATION).sum())


def _delivered(first: Result, best: Result) -> Result:
    """Return the better result in the arrays of the first, which may be the caller's own."""
    if best is first:
        return first
    values = []
    for old, new in zip(first, best, strict=True):
        same = getattr(old, "shape", None) == getattr(new, "shape", ())
        if same and old.dtype == new.dtype and old.flags.writeable:
            old[...] = new
            values.append(old)
        else:
            values.append(new)
    return tuple(values)


def _guess(form: _Form, args: Result, kwargs: Bound) -> Bound:
    """Return the starting pose of solvePnPRansac, which the first run overwrites."""
    if form.function != "solvePnPRansac" or len(args) + len(kwargs) < 7:
        return {}
    bound = {**dict(zip(form.names, args, strict=False)), **kwargs}
    if not bound.get("useExtrinsicGuess"):
        return {}
    return {name: bound[name].copy() for name in ("rvec", "tvec") if bound.get(name) is not None}


# Residuals of USAC's models, squared and divided by the square of the threshold.


def _rows(points: Any, n_samples: int, columns: int) -> "NDArray[np.float64]":
    import numpy as np

    rows, axis = np.asarray(points, dtype=np.float64), points.shape.index(n_samples)
    if axis > 0:
        rows = np.moveaxis(rows, axis, 0)
    return rows.reshape(n_samples, -1)[:, :columns]


def _threshold(form_default: float, bound: Bound, name: str) -> float:
    params = bound.get("params")
    return float(bound.get(name, form_default) if params is None else params.threshold)


def _homography_residuals(_cv2: Any, bound: Bound, result: Result) -> "NDArray[np.float64]":
    x, y = (_rows(bound[name], result[1].size, 2) for name in ("srcPoints", "dstPoints"))
    threshold = _threshold(3.0, bound, "ransacReprojThreshold")
    return residuals.transfer(x, y, result[0]) / threshold**2


def _affine_residuals(_cv2: Any, bound: Bound, result: Result) -> "NDArray[np.float64]":
    names = ("pts1", "pts2") if "params" in bound else ("from_", "to")
    x, y = (_rows(bound[name], result[1].size, 2) for name in names)
    threshold = _threshold(3.0, bound, "ransacReprojThreshold")
    return residuals.transfer(x, y, result[0]) / threshold**2


def _fundamental_residuals(_cv2: Any, bound: Bound, result: Result) -> "NDArray[np.float64]":
    x, y = (_rows(bound[name], result[1].size, 2) for name in ("points1", "points2"))
    threshold = _threshold(3.0, bound, "ransacReprojThreshold")
    return residuals.sampson(x, y, result[0][:3]) / threshold**2


def _essential_residuals(cv2: Any, bound: Bound, result: Result) -> "NDArray[np.float64]":
    import numpy as np

    n_samples = result[1].size
    points = [_rows(bound[name], n_samples, 2) for name in ("points1", "points2")]
    if "cameraMatrix1" in bound:
        distortions = ("dist_coeff1", "dist_coeff2")
        if "distCoeffs1" in bound:
            distortions = ("distCoeffs1", "distCoeffs2")
        cameras = [np.asarray(bound[name], float) for name in ("cameraMatrix1", "cameraMatrix2")]
        points = [
            cv2.undistortPoints(rows[:, None], camera, bound.get(name)).reshape(n_samples, 2)
            for rows, camera, name in zip(points, cameras, distortions, strict=True)
        ]
        focal = sum(camera[0, 0] + camera[1, 1] for camera in cameras) / 4
    elif "cameraMatrix" in bound:
        camera = np.asarray(bound["cameraMatrix"], dtype=np.float64)
        points = [(rows - camera[:2, 2]) / camera.diagonal()[:2] for rows in points]
        focal = (camera[0, 0] + camera[1, 1]) / 2
    else:
        focal = float(bound.get("focal", 1.0))
        points = [(rows - np.asarray(bound.get("pp", (0.0, 0.0)))) / focal for rows in points]
    threshold = _threshold(1.0, bound, "threshold") / focal
    return np.asarray(residuals.sampson(points[0], points[1], result[0][:3]) / threshold**2)


def _pose_residuals(cv2: Any, bound: Bound, result: Result) -> "NDArray[np.float64]":
    n_samples = bound["imagePoints"].size // 2
    x = _rows(bound["objectPoints"], n_samples, 3)
    y = _rows(bound["imagePoints"], n_samples, 2)
    rvec, tvec = result[-3:-1]
    camera = result[1] if len(result) == 5 else bound["cameraMatrix"]
    threshold = _threshold(8.0, bound, "reprojectionError")
    moved = cv2.projectPoints(x, rvec, tvec, camera, bound["distCoeffs"])[0].reshape(-1, 2)
    squares: NDArray[np.float64] = ((moved - y) ** 2).sum(axis=1) / threshold**2
    return squares


# The functions.

_HOMOGRAPHY = _Form(
    "findHomography",
    (
        "srcPoints",
        "dstPoints",
        "method",
        "ransacReprojThreshold",
        "mask",
        "maxIters",
        "confidence",
    ),
    (4, 4),
    {"method": 0, "maxIters": 2000, "confidence": 0.995},
    _homography_residuals,
    points=("srcPoints", "dstPoints"),
)
_HOMOGRAPHY_PARAMS = _Form(
    "findHomography",
    ("srcPoints", "dstPoints", "params", "mask"),
    (0, 4),
    {},
    _homography_residuals,
    points=("srcPoints", "dstPoints"),
)
_FUNDAMENTAL_DEFAULTS = {"method": _RANSAC, "ransacReprojThreshold": 3.0, "confidence": 0.99}
_FUNDAMENTAL = _Form(
    "findFundamentalMat",
    ("points1", "points2", "method", "ransacReprojThreshold", "confidence", "maxIters", "mask"),
    (7, 7),
    {**_FUNDAMENTAL_DEFAULTS, "maxIters": 1000},
    _fundamental_residuals,
    fewest=15,
    careless=True,
)
_FUNDAMENTAL_SHORT = _Form(
    "findFundamentalMat",
    ("points1", "points2", "method", "ransacReprojThreshold", "confidence", "mask"),
    (7, 7),
    {**_FUNDAMENTAL_DEFAULTS, "maxIters": 1000},
    _fundamental_residuals,
    fewest=15,
    careless=True,
)
_FUNDAMENTAL_PARAMS = _Form(
    "findFundamentalMat",
    ("points1", "points2", "params", "mask"),
    (0, 7),
    {},
    _fundamental_residuals,
)
_ESSENTIAL_DEFAULTS = {"method": _RANSAC, "prob": 0.999, "threshold": 1.0}
_ESSENTIAL = _Form(
    "findEssentialMat",
    ("points1", "points2", "cameraMatrix", "method", "prob", "threshold", "maxIters", "mask"),
    (5, 5),
    {**_ESSENTIAL_DEFAULTS, "maxIters": 1000},
    _essential_residuals,
    confidence="prob",
)
_ESSENTIAL_FOCAL = _Form(
    "findEssentialMat",
    ("points1", "points2", "focal", "pp", "method", "prob", "threshold", "maxIters", "mask"),
    (5, 5),
    {**_ESSENTIAL_DEFAULTS, "maxIters": 1000},
    _essential_residuals,
    confidence="prob",
)
_ESSENTIAL_CAMERAS = _Form(
    "findEssentialMat",
    (
        "points1",
        "points2",
        "cameraMatrix1",
        "distCoeffs1",
        "cameraMatrix2",
        "distCoeffs2",
        "method",
        "prob",
        "threshold",
        "mask",
    ),
    (5, 5),
    _ESSENTIAL_DEFAULTS,
    _essential_residuals,
    confidence="prob",
    max_trials="",
)
_ESSENTIAL_PARAMS = _Form(
    "findEssentialMat",
    (
        "points1",
        "points2",
        "cameraMatrix1",
        "cameraMatrix2",
        "dist_coeff1",
        "dist_coeff2",
        "params",
        "mask",
    ),
    (0, 5),
    {},
    _essential_residuals,
)
_POSE = _Form(
    "solvePnPRansac",
    (
        "objectPoints",
        "imagePoints",
        "cameraMatrix",
        "distCoeffs",
        "rvec",
        "tvec",
        "useExtrinsicGuess",
        "iterationsCount",
        "reprojectionError",
        "confidence",
        "inliers",
        "flags",
    ),
    (5, 3),
    {"flags": 0, "iterationsCount": 100, "confidence": 0.99},
    _pose_residuals,
    points=("objectPoints", "imagePoints"),
    outputs=("rvec", "tvec", "inliers"),
    inliers=3,
    indices=True,
    method="flags",
    max_trials="iterationsCount",
)
_POSE_PARAMS = _Form(
    "solvePnPRansac",
    (
        "objectPoints",
        "imagePoints",
        "cameraMatrix",
        "distCoeffs",
        "rvec",
        "tvec",
        "inliers",
        "params",
    ),
    (0, 3),
    {},
    _pose_residuals,
    points=("objectPoints", "imagePoints"),
    outputs=("rvec", "tvec", "inliers"),
    inliers=4,
    indices=True,
)
_AFFINE_NAMES = (
    "from_",
    "to",
    "inliers",
    "method",
    "ransacReprojThreshold",
    "maxIters",
    "confidence",
    "refineIters",
)
_AFFINE_DEFAULTS = {"method": _RANSAC, "maxIters": 2000, "confidence": 0.99}
_AFFINE = _Form(
    "estimateAffine2D",
    _AFFINE_NAMES,
    (3, 3),
    _AFFINE_DEFAULTS,
    _affine_residuals,
    points=("from_", "to"),
    outputs=("inliers",),
)
_AFFINE_PARAMS = _Form(
    "estimateAffine2D",
    ("pts1", "pts2", "params", "inliers"),
    (0, 3),
    {},
    _affine_residuals,
    points=("pts1", "pts2"),
    outputs=("inliers",),
)
_AFFINE_PARTIAL = _Form(
    "estimateAffinePartial2D",
    _AFFINE_NAMES,
    (2, 0),
    _AFFINE_DEFAULTS,
    points=("from_", "to"),
    outputs=("inliers",),
)
_SPACE_NAMES = ("src", "dst", "out", "inliers", "ransacThreshold", "confidence")
_AFFINE_3D, _TRANSLATION_3D = (
    _Form(
        function,
        _SPACE_NAMES,
        (4, 0),
        {"confidence": 0.99},
        points=("src", "dst"),
        outputs=("out", "inliers"),
        inliers=2,
        max_trials="",
        careless=True,
    )
    for function in ("estimateAffine3D", "estimateTranslation3D")
)


def _choose_homography(args: Result, kwargs: Bound) -> _Form | None:
    return _HOMOGRAPHY_PARAMS if _has_params(args, kwargs, 2) else _HOMOGRAPHY


def _choose_fundamental(args: Result, kwargs: Bound) -> _Form | None:
    if _has_params(args, kwargs, 2):
        return _FUNDAMENTAL_PARAMS
    if "maxIters" in kwargs or (len(args) > 5 and isinstance(args[5], int)):
        return _FUNDAMENTAL
    return _FUNDAMENTAL_SHORT


def _choose_essential(args: Result, kwargs: Bound) -> _Form | None:
    if _has_params(args, kwargs, 6):
        return _ESSENTIAL_PARAMS
    if "cameraMatrix1" in kwargs or "distCoeffs2" in kwargs:
        return _ESSENTIAL_CAMERAS
    if "cameraMatrix" in kwargs or (len(args) > 2 and _is_matrix(args[2])):
        if len(args) > 4 and _is_matrix(args[4]):
            return _ESSENTIAL_CAMERAS
        return _ESSENTIAL
    return _ESSENTIAL_FOCAL


def _choose_pose(args: Result, kwargs: Bound) -> _Form | None:
    return _POSE_PARAMS if _has_params(args, kwargs, 7) else _POSE


def _choose_affine(args: Result, kwargs: Bound) -> _Form | None:
    return _AFFINE_PARAMS if _has_params(args, kwargs, 2) else _AFFINE


def _choose_affine_3d(args: Result, kwargs: Bound) -> _Form | None:
    # The other overload aligns without RANSAC; two arguments alone mean this one.
    similarity = "force_rotation" in kwargs or (len(args) > 2 and isinstance(args[2], bool))
    return None if similarity else _AFFINE_3D


_CHOICES: dict[str, tuple[Callable[[Result, Bound], _Form | None], tuple[_Form, ...]]] = {
    "findHomography": (_choose_homography, (_HOMOGRAPHY, _HOMOGRAPHY_PARAMS)),
    "findFundamentalMat": (
        _choose_fundamental,
        (_FUNDAMENTAL, _FUNDAMENTAL_SHORT, _FUNDAMENTAL_PARAMS),
    ),
    "findEssentialMat": (
        _choose_essential,
        (_ESSENTIAL, _ESSENTIAL_FOCAL, _ESSENTIAL_CAMERAS, _ESSENTIAL_PARAMS),
    ),
    "solvePnPRansac": (_choose_pose, (_POSE, _POSE_PARAMS)),
    "estimateAffine2D": (_choose_affine, (_AFFINE, _AFFINE_PARAMS)),
    "estimateAffinePartial2D": (lambda _args, _kwargs: _AFFINE_PARTIAL, (_AFFINE_PARTIAL,)),
    "estimateAffine3D": (_choose_affine_3d, (_AFFINE_3D,)),
    "estimateTranslation3D": (lambda _args, _kwargs: _TRANSLATION_3D, (_TRANSLATION_3D,)),
}


def _has_params(args: Result, kwargs: Bound, position: int) -> bool:
    return "params" in kwargs or (
        len(args) > position and type(args[position]).__name__ == "UsacParams"
    )


def _is_matrix(value: object) -> bool:
    return getattr(value, "ndim", 0) == 2


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace: the functions whose signatures are known."""
    kinds = _approximate_kinds(module)
    return _wrapped(module, kinds) if kinds else ()


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch. Where one family of methods alone is exact, it is not read."""
    return _wrapped(module, _approximate_kinds(module) or frozenset({"classic", "usac"}))


def _wrapped(module: ModuleType, kinds: frozenset[str]) -> tuple[Replacement, ...]:
    replacements = []
    for name, (choose, forms) in _CHOICES.items():
        original = own_function(module, name)
        if original is None:  # not in this release
            continue
        signatures = _signatures(original)
        for form in forms:
            if form.names not in signatures:
                raise PatchNotApplicable(
                    f"cv2.{name} has no form with the arguments {', '.join(form.names)}"
                )
        exact = _wrap(module, original, choose, kinds)
        replacements.append(Replacement(holder=module, name=name, exact=exact))
    return tuple(replacements)


def _signatures(function: Callable[..., Any]) -> set[tuple[str, ...]]:
    """Return the overloads of a function, as its docstring gives them."""
    found = set()
    for line in (function.__doc__ or "").splitlines():
        call, arrow, _ = line.partition(" -> ")
        if arrow and call.endswith(")"):
            inside = call.partition("(")[2][:-1].replace("[", "").replace("]", "")
            found.add(tuple(name.strip() for name in inside.split(",")))
    return found


def _approximate_kinds(cv2: ModuleType) -> frozenset[str]:
    """Return the families of methods that assume p**k, as measured."""
    find = own_function(cv2, "estimateAffine2D")  # the quickest
    if find is None:
        raise PatchNotApplicable("cv2 has no estimateAffine2D")
    return _measured(find, hasattr(cv2, "USAC_DEFAULT"))


@lru_cache(maxsize=4)
def _measured(find: Callable[..., Any], has_usac: bool) -> frozenset[str]:
    """Return the families in which ``estimateAffine2D`` assumes p**k."""
    from ransac_fix.patching.behaviour import assumed_probability

    methods = {"classic": _RANSAC}
    if has_usac:
        methods["usac"] = _USAC.start
    assumed = {}
    for kind, method in methods.items():

        def count(x: Any, y: Any, trials: int, confidence: float, method: int = method) -> int:
            _, mask = find(x, y, None, method, 0.05, trials, confidence, 0)
            return 0 if mask is None else int(mask.sum())

        assumed[kind] = assumed_probability(count, 3)
        if assumed[kind] is None:
            raise PatchNotApplicable(f"the {kind} estimateAffine2D follows neither rule")
    return frozenset(kind for kind in assumed if assumed[kind] == "approximate")


PATCH = LibraryPatch(
    system="opencv",
    requirements=(
        "opencv-python-headless>=4.8,<=5.0.0.93",
        "opencv-python>=4.8,<=5.0.0.93",
        "opencv-contrib-python-headless>=4.8,<=5.0.0.93",
        "opencv-contrib-python>=4.8,<=5.0.0.93",
    ),
    modules=("cv2",),
    plan=plan,
    observe=observe,
    wraps=True,
)
