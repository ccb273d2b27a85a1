"""OpenCV's RANSAC functions keep their promise: by trial counts and by outcomes."""

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_views import CAMERA, Planted, chance_of_larger, likelihood_ratio, plant

from ransac_fix import patch, patched, required_trials, status, unpatch
from ransac_fix.errors import PatchNotApplicable, RansacFixError
from ransac_fix.patches import opencv
from ransac_fix.patching import missing

BUDGET = 100_000


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("RANSAC_FIX_SLACK", "0")
    monkeypatch.setattr(missing, "_slack", 0.0)
    yield
    unpatch("opencv")


def params(confidence: float, trials: int, threshold: float) -> Any:
    settings = cv2.UsacParams()
    settings.confidence, settings.maxIterations = confidence, trials
    settings.threshold = threshold
    return settings


def mask_of(indices: np.ndarray | None, n_samples: int) -> np.ndarray:
    mask = np.zeros(n_samples, bool)
    if indices is not None:
        mask[indices.ravel()] = True
    return mask


@dataclass(frozen=True, slots=True)
class Case:
    """One entry point on one planted problem.

    `chance`: how often an all-inlier sample really gives its group, and with P3P also a sample
    with one outlier, as runs with fixed numbers of trials on one group show.
    """

    kind: str
    n_samples: int
    sizes: tuple[int, int]
    sample_size: int
    function: str
    mask: Callable[[Any, Planted, float], np.ndarray | None]
    family: str = "classic"
    chance: float = 1.0

    def trials(self, confidence: float) -> tuple[float, float]:
        """Return what OpenCV's rule asks for with the smaller group in hand, and what exact."""
        setting = (self.sizes[0], self.n_samples, self.sample_size, confidence)
        return opencv._trials(self.family, *setting, math.inf), required_trials(*setting)

    def expected(self, trials: float) -> float:
        hits = [math.comb(size, self.sample_size) for size in self.sizes]
        total = math.comb(self.n_samples, self.sample_size)
        return chance_of_larger(trials, *(self.chance * hit / total for hit in hits))


R, U = cv2.RANSAC, cv2.USAC_DEFAULT
FM8 = cv2.USAC_FM_8PTS
EPNP, P3P = cv2.SOLVEPNP_EPNP, cv2.SOLVEPNP_P3P


def homography(method: int) -> Callable[[Any, Planted, float], Any]:
    return lambda f, p, s: f(p.x, p.y, method, 0.05, None, BUDGET, s)[1]


def fundamental(method: int) -> Callable[[Any, Planted, float], Any]:
    return lambda f, p, s: f(p.x, p.y, method, 0.01, s, BUDGET)[1]


def essential(method: int) -> Callable[[Any, Planted, float], Any]:
    return lambda f, p, s: f(p.x, p.y, CAMERA, method, s, 0.01, BUDGET)[1]


def affine(method: int) -> Callable[[Any, Planted, float], Any]:
    return lambda f, p, s: f(p.x, p.y, None, method, 0.05, BUDGET, s, 0)[1]


def pose(flags: int) -> Callable[[Any, Planted, float], Any]:
    def mask(f: Any, p: Planted, s: float) -> Any:
        settings = {"iterationsCount": BUDGET, "reprojectionError": 0.05, "flags": flags}
        return mask_of(f(p.x, p.y, CAMERA, None, confidence=s, **settings)[3], len(p.x))

    return mask


CASES = {
    "findHomography RANSAC": Case("affine", 14, (5, 6), 4, "findHomography", homography(R)),
    "findHomography USAC_DEFAULT": Case(
        "affine", 14, (5, 6), 4, "findHomography", homography(U), "usac"
    ),
    "findHomography USAC_FAST": Case(
        "affine", 14, (5, 6), 4, "findHomography", homography(cv2.USAC_FAST), "usac"
    ),
    "findHomography USAC_ACCURATE": Case(
        "affine", 14, (5, 6), 4, "findHomography", homography(cv2.USAC_ACCURATE), "usac"
    ),
    "findHomography UsacParams": Case(
        "affine",
        14,
        (5, 6),
        4,
        "findHomography",
        lambda f, p, s: f(p.x, p.y, params(s, BUDGET, 0.05))[1],
        "usac",
    ),
    "findFundamentalMat FM_RANSAC": Case(
        "two views", 18, (8, 9), 7, "findFundamentalMat", fundamental(R), chance=0.88
    ),
    "findFundamentalMat USAC_DEFAULT": Case(
        "two views", 20, (9, 10), 7, "findFundamentalMat", fundamental(U), "usac", 0.87
    ),
    "findFundamentalMat USAC_FM_8PTS": Case(
        "two views", 22, (10, 11), 8, "findFundamentalMat", fundamental(FM8), "usac", 0.72
    ),
    "findFundamentalMat UsacParams": Case(
        "two views",
        20,
        (9, 10),
        7,
        "findFundamentalMat",
        lambda f, p, s: f(p.x, p.y, params(s, BUDGET, 0.01))[1],
        "usac",
        0.87,
    ),
    "findEssentialMat RANSAC": Case("two views", 14, (6, 7), 5, "findEssentialMat", essential(R)),
    "findEssentialMat RANSAC, two cameras": Case(
        "two views",
        15,
        (7, 8),
        5,
        "findEssentialMat",
        lambda f, p, s: f(p.x, p.y, CAMERA, None, CAMERA, None, R, s, 0.01)[1],
    ),
    "findEssentialMat RANSAC, focal length": Case(
        "two views",
        15,
        (7, 8),
        5,
        "findEssentialMat",
        lambda f, p, s: f(p.x, p.y, 800.0, (320.0, 240.0), R, s, 0.01, BUDGET)[1],
    ),
    "findEssentialMat USAC_DEFAULT": Case(
        "two views", 16, (7, 8), 5, "findEssentialMat", essential(U), "usac"
    ),
    "findEssentialMat UsacParams": Case(
        "two views",
        16,
        (7, 8),
        5,
        "findEssentialMat",
        lambda f, p, s: f(p.x, p.y, CAMERA, CAMERA, None, None, params(s, BUDGET, 0.01))[1],
        "usac",
    ),
    "solvePnPRansac EPNP": Case("pose", 16, (7, 8), 5, "solvePnPRansac", pose(EPNP)),
    "solvePnPRansac P3P": Case("pose", 14, (5, 6), 4, "solvePnPRansac", pose(P3P), chance=2.6),
    "solvePnPRansac USAC_DEFAULT": Case(
        "pose", 14, (5, 6), 3, "solvePnPRansac", pose(U), "usac", 0.82
    ),
    "solvePnPRansac UsacParams": Case(
        "pose",
        14,
        (5, 6),
        3,
        "solvePnPRansac",
        lambda f, p, s: mask_of(
            f(p.x, p.y, CAMERA, None, params=params(s, BUDGET, 0.05))[4], len(p.x)
        ),
        "usac",
        0.82,
    ),
    "estimateAffine2D RANSAC": Case("affine", 14, (4, 5), 3, "estimateAffine2D", affine(R)),
    "estimateAffine2D USAC_DEFAULT": Case(
        "affine", 14, (4, 5), 3, "estimateAffine2D", affine(U), "usac", 0.86
    ),
    "estimateAffine2D UsacParams": Case(
        "affine",
        14,
        (4, 5),
        3,
        "estimateAffine2D",
        lambda f, p, s: f(p.x, p.y, params(s, BUDGET, 0.05))[1],
        "usac",
        0.86,
    ),
    "estimateAffinePartial2D RANSAC": Case(
        "similarity", 14, (3, 4), 2, "estimateAffinePartial2D", affine(R)
    ),
    "estimateAffine3D": Case(
        "space",
        14,
        (6, 7),
        4,
        "estimateAffine3D",
        lambda f, p, s: f(p.x, p.y, None, None, 0.05, s)[2],
    ),
    "estimateTranslation3D": Case(
        "translation",
        14,
        (6, 7),
        4,
        "estimateTranslation3D",
        lambda f, p, s: f(p.x, p.y, None, None, 0.05, s)[2],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_outcomes_are_those_of_the_exact_number_of_trials(name: str) -> None:
    case = CASES[name]
    confidence = 0.5
    approximate, exact = case.trials(confidence)

    def run(seed: int) -> bool:
        planted = plant(case.kind, case.n_samples, case.sizes, seed)
        return planted.found(case.mask(getattr(cv2, case.function), planted, confidence)) == 1

    likely, unlikely = case.expected(exact), case.expected(approximate)
    with patched("opencv"):
        is_exact, successes, runs = likelihood_ratio(run, likely, unlikely, error=1e-3)
    assert is_exact, f"{successes} of {runs}: exact {likely:.3f}, approximate {unlikely:.3f}"


@pytest.mark.parametrize("name", ["findHomography RANSAC", "estimateAffine2D USAC_DEFAULT"])
def test_without_the_patch_the_same_test_finds_the_approximate_rule(name: str) -> None:
    case = CASES[name]
    approximate, exact = case.trials(0.5)

    def run(seed: int) -> bool:
        planted = plant(case.kind, case.n_samples, case.sizes, seed)
        return planted.found(case.mask(getattr(cv2, case.function), planted, 0.5)) == 1

    is_exact, _, _ = likelihood_ratio(
        run, case.expected(exact), case.expected(approximate), error=1e-3
    )
    assert is_exact is False


class Counting:
    """Stands in for a function of OpenCV: counts trials as OpenCV's rule does, draws nothing."""

    def __init__(self, form: Any, kind: str, found: list[int]) -> None:
        self.form, self.kind, self.found = form, kind, found
        self.runs: list[float] = []

    def __call__(self, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        bound = {**self.form.defaults, **dict(zip(self.form.names, args, strict=False)), **kwargs}
        points = bound[self.form.points[0]]
        n_inliers = self.found[min(len(self.runs), len(self.found) - 1)]
        if self.form.has_params:
            confidence, limit = bound["params"].confidence, bound["params"].maxIterations
        else:
            confidence = bound[self.form.confidence]
            limit = bound.get(self.form.max_trials, 1000)
        k = self.form.sample_sizes[self.kind == "usac"]
        self.runs.append(opencv._trials(self.kind, n_inliers, len(points), k, confidence, limit))
        mask = np.zeros((len(points), 1), np.uint8)
        mask[:n_inliers] = 1
        return np.eye(3), mask


@given(
    kind=st.sampled_from(["classic", "usac"]),
    n_samples=st.integers(5, 400),
    data=st.data(),
    confidence=st.floats(0.01, 0.99999),
    limit=st.integers(1, 10**7),
)
def test_trials_run_and_missing_make_the_required_number(
    kind: str, n_samples: int, data: Any, confidence: float, limit: int
) -> None:
    n_inliers = data.draw(st.integers(4, n_samples))
    counting = Counting(opencv._HOMOGRAPHY, kind, [n_inliers])
    exact = opencv._wrap(
        cv2, counting, lambda _args, _kwargs: opencv._HOMOGRAPHY, frozenset({"classic", "usac"})
    )
    points = np.zeros((n_samples, 2))
    exact(points, points, R if kind == "classic" else U, 3.0, None, limit, confidence)
    bare = opencv._trials(kind, n_inliers, n_samples, 4, confidence, limit)
    needed = min(required_trials(n_inliers, n_samples, 4, confidence), limit)
    first = counting.runs[0]
    assert bare <= first <= max(bare, 1.15 * needed + opencv._SPARE[kind].trials + 1)
    assert sum(counting.runs) == max(first, needed)


def test_a_better_model_in_a_later_run_lowers_the_number() -> None:
    counting = Counting(opencv._HOMOGRAPHY, "classic", [5, 8])
    exact = opencv._wrap(
        cv2, counting, lambda _args, _kwargs: opencv._HOMOGRAPHY, frozenset({"classic"})
    )
    points = np.zeros((20, 2))
    _, mask = exact(points, points, R, 3.0, None, 10**6, 0.99)
    assert mask.sum() == 8
    # The second run was asked for what is missing with 5, its own rule stopped it with 8.
    assert len(counting.runs) == 2
    assert sum(counting.runs) > required_trials(8, 20, 4, 0.99)


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("findHomography", {"method": 0}),
        ("findHomography", {"method": cv2.LMEDS}),
        ("findHomography", {"method": cv2.RHO}),
        ("findHomography", {"method": cv2.USAC_PROSAC}),
        ("findHomography", {"method": cv2.USAC_MAGSAC}),
        ("findFundamentalMat", {"method": cv2.FM_8POINT}),
        ("findFundamentalMat", {"method": cv2.FM_LMEDS}),
        ("findFundamentalMat", {"method": cv2.FM_RANSAC, "few": True}),
        ("estimateAffine2D", {"method": cv2.LMEDS}),
    ],
)
def test_other_methods_pass_through(
    name: str, extra: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_second_run(*_args: Any, **_kwargs: Any) -> None:
        raise AssertionError("a second run")

    monkeypatch.setattr(opencv, "_again", no_second_run)
    extra = dict(extra)
    planted = plant("two views" if "Fund" in name else "affine", 24, (9, 10), 1)
    keep = slice(14 if extra.pop("few", False) else 24)
    x, y = planted.x[keep], planted.y[keep]
    before = getattr(cv2, name)(x, y, **extra)
    with patched("opencv"):
        after = getattr(cv2, name)(x, y, **extra)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old, new)


LAYOUTS = {
    "rows": lambda x: x,
    "float32": lambda x: x.astype(np.float32),
    "n x 1 x 2": lambda x: x[:, None],
    "1 x n x 2": lambda x: x[None],
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("method", [R, U])
def test_results_keep_shape_type_order_and_repeat(layout: str, method: int) -> None:
    seconds = 0
    for seed in range(12):
        planted = plant("affine", 14, (5, 6), seed)
        x, y = (np.ascontiguousarray(LAYOUTS[layout](side)) for side in (planted.x, planted.y))
        bare, bare_mask = cv2.findHomography(x, y, method, 0.05, None, BUDGET, 0.3)
        with patched("opencv"):
            own = np.full((14, 1), 7, np.uint8)
            model, mask = cv2.findHomography(x, y, method, 0.05, own, BUDGET, 0.3)
            again, mask_again = cv2.findHomography(x, y, method, 0.05, None, BUDGET, 0.3)
        assert (mask.shape, mask.dtype) == (bare_mask.shape, bare_mask.dtype)
        assert (model.shape, model.dtype) == (bare.shape, bare.dtype)
        np.testing.assert_array_equal(model, again)
        np.testing.assert_array_equal(mask, mask_again)
        np.testing.assert_array_equal(own, mask)
        assert mask.sum() >= bare_mask.sum()
        # The mask is in the caller's order: it is that of the model.
        moved = np.column_stack([planted.x, np.ones(14)]) @ model.T
        close = np.hypot(*(moved[:, :2] / moved[:, 2:] - planted.y).T) < 0.05
        np.testing.assert_array_equal(mask.ravel().astype(bool), close)
        seconds += not np.array_equal(mask, bare_mask)
    assert seconds  # some of them did find their model in a second run


def test_a_starting_pose_survives_the_first_run() -> None:
    improved = 0
    for seed in range(10):
        planted = plant("pose", 14, (6, 7), seed)
        found = []
        for wrapped in (False, True):
            start = np.zeros((3, 1)), np.array([[0.0], [0.0], [8.0]])
            with patched("opencv") if wrapped else patched("scikit-learn"):
                found.append(
                    cv2.solvePnPRansac(
                        planted.x,
                        planted.y,
                        CAMERA,
                        None,
                        *start,
                        useExtrinsicGuess=True,
                        iterationsCount=2000,
                        reprojectionError=0.05,
                        confidence=0.4,
                        flags=EPNP,
                    )
                )
            assert found[-1][0]
            np.testing.assert_array_equal(found[-1][1], start[0])
        improved += len(found[1][3]) > len(found[0][3])
        assert len(found[1][3]) >= len(found[0][3])
        indices = found[1][3].ravel()
        assert np.all(np.diff(indices) > 0)
        assert planted.found(mask_of(indices, 14)) is not None
    assert improved


def test_the_user_s_limit_wins() -> None:
    planted = plant("affine", 14, (5, 6), 0)
    bare = cv2.findHomography(planted.x, planted.y, R, 0.05, None, 30, 0.9)
    with patched("opencv"):
        wrapped = cv2.findHomography(planted.x, planted.y, R, 0.05, None, 30, 0.9)
    for old, new in zip(bare, wrapped, strict=True):
        np.testing.assert_array_equal(old, new)


def test_no_model_does_not_hang() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1000, (2, 300, 2))
    with patched("opencv"):
        for method in (R, U):
            cv2.findHomography(x, y, method, 0.5)
            cv2.findFundamentalMat(x, y, method, 0.01, 0.99)
        with pytest.raises(cv2.error, match="sample_size"):
            cv2.findHomography(x[:3], y[:3], U, 0.5)
        # No sample passes OpenCV's checks.
        line = np.column_stack([np.arange(30.0), np.arange(30.0)])
        assert cv2.findHomography(line, line, R, 1.0)[0] is None


def test_errors_are_opencv_s_own() -> None:
    with patched("opencv"):
        with pytest.raises(cv2.error):
            cv2.findHomography(np.zeros((5, 2)), np.zeros((6, 2)), R)
        with pytest.raises(cv2.error):
            cv2.findHomography()


def test_slack_leaves_small_shortfalls_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 1000, (2000, 2))
    y = x.copy()
    y[1000:] = rng.uniform(0, 1000, (1000, 2))
    monkeypatch.setattr(opencv, "raised_confidence", lambda _n, _k, confidence, *_: confidence)
    rounds = []
    again = opencv._again
    monkeypatch.setattr(opencv, "_again", lambda *args: rounds.append(1) or again(*args))
    for slack, expected in ((0.1, 0), (0.0, 1)):
        patch("opencv", slack=slack)
        rounds.clear()
        cv2.findHomography(x, y, R, 1.0, None, 10**6, 0.999)
        assert bool(rounds) == bool(expected)
    with pytest.raises(RansacFixError, match="slack"):
        patch("opencv", slack=-1)


def test_status_and_undoing() -> None:
    before = cv2.findHomography
    patch("opencv")
    state = next(system for system in status().systems if system.system == "opencv")
    assert state.state == "patched"
    assert "cv2.findHomography" in state.sites
    assert cv2.findHomography.__doc__ == before.__doc__
    unpatch("opencv")
    assert cv2.findHomography is before


def test_patching_before_the_import() -> None:
    program = (
        "import ransac_fix; ransac_fix.patch('opencv')\n"
        "from cv2 import findHomography\n"
        "import cv2\n"
        "assert findHomography is cv2.findHomography\n"
        "print(findHomography.__ransac_fix__, ransac_fix.status().systems[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("True")
    assert not done.stderr


def test_an_unknown_signature_is_refused() -> None:
    def find(*args: Any) -> Any:
        """find(x, y) -> mask"""
        return cv2.estimateAffine2D(*args)

    other = ModuleType("cv2")
    other.estimateAffine2D = find  # type: ignore[attr-defined]
    with pytest.raises(PatchNotApplicable, match="no form with the arguments"):
        opencv.plan(other)
