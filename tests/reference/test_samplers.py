"""The samplers draw from the law they state."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ransac_fix import Stratum, all_inlier_probability
from ransac_fix.reference import (
    DistinctSampler,
    KnownSampler,
    ReplacementSampler,
    Sampler,
    StratifiedSampler,
    SubsetSampler,
)
from ransac_fix.reference import samplers as samplers_module

STRATA = [([4, 0, 6, 1], 2), ([2, 5, 3], 1)]

# A sampler, and every ordered draw it can make.
SPACES: dict[str, tuple[Sampler, list[tuple[int, ...]]]] = {
    "distinct": (DistinctSampler(5, 3), list(itertools.permutations(range(5), 3))),
    "distinct, all": (DistinctSampler(4, 4), list(itertools.permutations(range(4)))),
    "distinct, one": (DistinctSampler(7, 1), [(i,) for i in range(7)]),
    "replacement": (ReplacementSampler(4, 3), list(itertools.product(range(4), repeat=3))),
    "stratified": (
        StratifiedSampler(STRATA),
        [
            (*pair, single)
            for pair in itertools.permutations([4, 0, 6, 1], 2)
            for single in [2, 5, 3]
        ],
    ),
}


def uniformity(sampler: Sampler, outcomes: list[tuple[int, ...]], seed: int) -> float:
    """Return the p-value of the chi-square test for equal frequencies, 200 draws an outcome."""
    rng = np.random.default_rng(seed)
    seen = Counter(tuple(sampler.draw(rng).tolist()) for _ in range(200 * len(outcomes)))
    assert set(seen) <= set(outcomes)
    return float(stats.chisquare([seen[outcome] for outcome in outcomes]).pvalue)


@pytest.mark.parametrize("name", SPACES)
def test_every_draw_is_equally_likely(name: str) -> None:
    sampler, outcomes = SPACES[name]
    assert uniformity(sampler, outcomes, seed=1) > 1e-3


@pytest.mark.parametrize("limit", [5, 20, 60])
def test_draws_made_in_several_steps_have_the_same_law(
    limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samplers_module, "_LARGEST_BOUND", limit)
    sampler = DistinctSampler(5, 3)
    assert len(sampler._steps) == {5: 3, 20: 2, 60: 1}[limit]
    assert uniformity(sampler, list(itertools.permutations(range(5), 3)), seed=2) > 1e-3
    replacement = ReplacementSampler(3, 3)
    assert uniformity(replacement, list(itertools.product(range(3), repeat=3)), seed=3) > 1e-3


@given(st.integers(1, 10**9), st.integers(1, 20), st.integers(0, 2**32))
def test_distinct_draws_are_distinct_indices_at_any_size(n: int, k: int, seed: int) -> None:
    k = min(n, k)
    drawn = DistinctSampler(n, k).draw(np.random.default_rng(seed))
    assert drawn.shape == (k,)
    assert drawn.dtype == np.intp
    assert len(set(drawn.tolist())) == k
    assert 0 <= drawn.min() <= drawn.max() < n


def test_large_draws_cover_the_range_evenly() -> None:
    sampler = DistinctSampler(10**9, 7)  # more than one step
    rng = np.random.default_rng(4)
    drawn = np.concatenate([sampler.draw(rng) for _ in range(2000)])
    assert stats.kstest(drawn / 1e9, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(
    ("sampler", "seed"),
    [(DistinctSampler(9, 4), 5), (ReplacementSampler(9, 4), 6), (StratifiedSampler(STRATA), 7)],
)
def test_the_stated_law_is_the_measured_one(sampler: KnownSampler, seed: int) -> None:
    n, k = sampler.n_samples, sampler.sample_size  # type: ignore[attr-defined]
    inliers = np.zeros(n, dtype=np.bool_)
    inliers[[0, 1, 2, 4, 5]] = True
    stated = all_inlier_probability(int(inliers.sum()), n, k, sampling=sampler.sampling(inliers))
    rng = np.random.default_rng(seed)
    draws = [sampler.draw(rng) for _ in range(20_000)]
    hits = sum(bool(inliers[d].all()) and len(set(d.tolist())) == k for d in draws)
    assert stats.binomtest(hits, len(draws), stated).pvalue > 1e-3


def test_strata_are_stated_with_their_inliers() -> None:
    inliers = np.array([True, False, True, True, True, False, False])
    assert StratifiedSampler(STRATA).sampling(inliers) == (Stratum(2, 4, 2), Stratum(2, 3, 1))


def test_a_stratum_may_give_nothing() -> None:
    sampler = StratifiedSampler([([0, 1], 0), ([2, 3, 4], 2)])
    assert sampler.n_subsets == 3
    assert set(sampler.draw(np.random.default_rng(0)).tolist()) <= {2, 3, 4}
    everything = np.ones(5, dtype=np.bool_)
    assert sampler.sampling(everything) == (Stratum(2, 2, 0), Stratum(3, 3, 2))


@pytest.mark.parametrize("sampler", [DistinctSampler(7, 3), StratifiedSampler(STRATA)])
def test_subsets_are_numbered_in_the_order_in_which_they_come(sampler: SubsetSampler) -> None:
    listed = [tuple(subset.tolist()) for subset in sampler.subsets()]
    assert len(listed) == sampler.n_subsets == len({frozenset(subset) for subset in listed})
    assert listed == [tuple(sampler.subset(r).tolist()) for r in range(sampler.n_subsets)]
    drawn = {frozenset(sampler.draw(np.random.default_rng(s)).tolist()) for s in range(3000)}
    assert drawn == {frozenset(subset) for subset in listed}


@given(st.data())
def test_subsets_of_many_are_numbered_lexicographically(data: st.DataObject) -> None:
    n = data.draw(st.integers(1, 10**9))
    k = data.draw(st.integers(1, min(n, 9)))
    rank = data.draw(st.integers(0, math.comb(n, k) - 1))
    subset = DistinctSampler(n, k).subset(rank).tolist()
    assert subset == sorted(set(subset))
    assert 0 <= subset[0] <= subset[-1] < n
    # Of all subsets, those after this one share its first i members and go on with a larger one.
    after = sum(math.comb(n - 1 - member, k - i) for i, member in enumerate(subset))
    assert math.comb(n, k) - 1 - after == rank


def test_the_stream_is_the_generators() -> None:
    for sampler, _ in SPACES.values():
        once, again = np.random.default_rng(8), np.random.default_rng(8)
        for _ in range(20):
            np.testing.assert_array_equal(sampler.draw(once), sampler.draw(again))


@pytest.mark.parametrize("kind", [DistinctSampler, ReplacementSampler])
@pytest.mark.parametrize("size", [0, 6])
def test_impossible_sizes_are_refused(kind: type, size: int) -> None:
    with pytest.raises(ValueError, match=r"sample_size must be from 1 to n_samples = 5"):
        kind(5, size)


@pytest.mark.parametrize("rank", [-1, 10])
def test_ranks_out_of_range_are_refused(rank: int) -> None:
    with pytest.raises(ValueError, match="rank must be from 0 to 9"):
        DistinctSampler(5, 2).subset(rank)
    with pytest.raises(ValueError, match="rank must be from 0 to 9"):
        StratifiedSampler([([0, 1, 2, 3, 4], 2)]).subset(rank)


@pytest.mark.parametrize(
    ("strata", "message"),
    [
        ([([0, 1], 1), ([1, 2], 1)], "each index from 0 to n-1 exactly once"),
        ([([1, 2], 1)], "each index from 0 to n-1 exactly once"),
        ([([0, 1], 3)], "sample_size of stratum 0 must be from 0 to its 2"),
        ([([0, 1], 0)], "at least one stratum"),
        ([], "at least one stratum"),
    ],
)
def test_strata_that_are_no_partition_are_refused(
    strata: list[tuple[list[int], int]], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        StratifiedSampler(strata)
