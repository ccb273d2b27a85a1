"""pydegensac keeps its promise: by trial counts and by outcomes."""

import math
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pydegensac
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_views import Planted, chance_of_larger, likelihood_ratio, plant

from ransac_fix import patched, required_trials, status, unpatch
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import pydegensac as patch_file
from ransac_fix.patching import missing


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("RANSAC_FIX_SLACK", "0")
    monkeypatch.setattr(missing, "_slack", 0.0)
    yield
    unpatch("pydegensac")


def homography(planted: Planted, confidence: float, seed: int) -> Any:
    return pydegensac.findHomography(planted.x, planted.y, 0.05, confidence, 50_000, seed=seed)


def fundamental(planted: Planted, confidence: float, seed: int) -> Any:
    return pydegensac.findFundamentalMatrix(
        planted.x, planted.y, 0.01, confidence, enable_degeneracy_check=False, seed=seed
    )


# Function, kind of problem, n, sizes of the groups, k.
CASES = {
    "findHomography": (homography, "affine", 14, (5, 6), 4),
    "findFundamentalMatrix": (fundamental, "two views", 20, (9, 10), 7),
}


@pytest.mark.parametrize("name", CASES)
def test_outcomes_are_those_of_the_exact_number_of_trials(name: str) -> None:
    function, kind, n_samples, sizes, sample_size = CASES[name]
    total = math.comb(n_samples, sample_size)
    hits = [math.comb(size, sample_size) / total for size in sizes]
    trials = [required_trials(sizes[0] + more, n_samples, sample_size, 0.5) for more in (0, 1)]
    likely, unlikely = (chance_of_larger(number, *hits) for number in trials)

    def run(seed: int) -> bool:
        planted = plant(kind, n_samples, sizes, seed)
        return planted.found(function(planted, 0.5, seed + 1)[1]) == 1

    is_bare_exact, *_ = likelihood_ratio(run, likely, unlikely, error=1e-3)
    with patched("pydegensac"):
        is_exact, successes, runs = likelihood_ratio(run, likely, unlikely, error=1e-3)
    assert is_exact, f"{successes} of {runs}: exact {likely:.3f}, with I + 1 {unlikely:.3f}"
    assert is_bare_exact is False


@given(
    n_samples=st.integers(8, 300),
    data=st.data(),
    confidence=st.floats(0.01, 0.9999),
    limit=st.integers(1, 200_000),
    name=st.sampled_from(list(CASES)),
)
def test_trials_run_and_missing_make_the_required_number(
    n_samples: int, data: Any, confidence: float, limit: int, name: str
) -> None:
    k = patch_file._SAMPLE_SIZES[name]
    n_inliers = data.draw(st.integers(k, n_samples))
    runs: list[float] = []

    def counting(
        pts1_: Any, pts2_: Any, px_th: float, conf: float, max_iters: int, seed: int = -1
    ) -> Any:
        runs.append(patch_file._trials(n_inliers, n_samples, k, conf, max_iters))
        return np.eye(3), np.arange(n_samples) < n_inliers

    points = np.zeros((n_samples, 2))
    patch_file._wrap(counting, k)(points, points, 1.0, confidence, limit, seed=3)
    bare = patch_file._trials(n_inliers, n_samples, k, confidence, limit)
    needed = min(required_trials(n_inliers, n_samples, k, confidence), limit)
    assert bare <= runs[0] <= max(bare, 1.1 * needed + patch_file._SPARE.trials + 1)
    assert sum(runs) == max(runs[0], needed)


def test_a_confidence_of_one_runs_the_whole_budget() -> None:
    """The missing trials rely on it: the rule alone would have stopped with five in hand."""
    stopped = 0
    for seed in range(1, 40):
        planted = plant("affine", 14, (5, 6), seed)

        def inliers(trials: int, confidence: float, planted: Planted = planted) -> int:
            found = pydegensac.findHomography(
                planted.x, planted.y, 0.05, confidence, trials, seed=2
            )
            return int(found[1].sum())

        low, high = 0, 4096
        if inliers(high, 1.0) != 6:  # one piece of clutter agrees by chance
            continue
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if inliers(middle, 1.0) == 6 else (middle, high)
        if high > 60 and inliers(high - 1, 1.0) == 5:
            chance = math.comb(6, 4) / math.comb(14, 4)
            assert inliers(4096, -math.expm1(0.5 * high * math.log1p(-chance))) == 5
            stopped += 1
    assert stopped > 3


@pytest.mark.parametrize("name", CASES)
def test_results_repeat_and_limits_win(name: str) -> None:
    function, kind, n_samples, sizes, _ = CASES[name]
    better = 0
    for seed in range(1, 15):
        planted = plant(kind, n_samples, sizes, seed)
        bare = function(planted, 0.3, seed)
        with patched("pydegensac"):
            first, second = (function(planted, 0.3, seed) for _ in range(2))
        np.testing.assert_array_equal(first[0], second[0])
        np.testing.assert_array_equal(first[1], second[1])
        assert (first[1].shape, first[1].dtype) == (bare[1].shape, bare[1].dtype)
        assert first[1].sum() >= bare[1].sum()
        better += first[1].sum() > bare[1].sum()
    assert better
    planted = plant("affine", 14, (5, 6), 0)
    with patched("pydegensac"):
        limited = pydegensac.findHomography(planted.x, planted.y, 0.05, 0.9999, 20, seed=1)
    bare = pydegensac.findHomography(planted.x, planted.y, 0.05, 0.9999, 20, seed=1)
    np.testing.assert_array_equal(limited[1], bare[1])


def test_no_model_and_few_points_do_not_hang() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1000, (2, 100, 2))
    with patched("pydegensac"):
        pydegensac.findHomography(x, y, 0.5, max_iters=3000)
        pydegensac.findFundamentalMatrix(x, y, 0.001, max_iters=3000, seed=1)
        with pytest.raises(ValueError, match="N>=4"):
            pydegensac.findHomography(x[:3], y[:3])


def test_status_and_refusals() -> None:
    with patched("pydegensac", threads=True):
        state = next(s for s in status().systems if s.system == "pydegensac")
        assert state.state == "patched"
        assert pydegensac.utils.findHomography is pydegensac.findHomography
    older = ModuleType("pydegensac")
    older.findHomography = lambda pts1_, pts2_, px_th=1.0, conf=0.99, max_iters=1: None  # type: ignore[attr-defined]
    with pytest.raises(PatchNotApplicable, match="takes no seed"):
        patch_file.plan(older)
