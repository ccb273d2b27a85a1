"""Simulated samplers are told apart, with the error rates stated."""

import itertools
import math

import numpy as np
import pytest

from ransac_fix.audit.plan import case_pool, filter_cases, first_cases
from ransac_fix.audit.sampling import (
    ERROR_RATE,
    LAST_ERROR_RATE,
    LEAST_FOUND,
    Hit,
    accepted,
    decide,
    most_telling,
)


def outcomes(draw, k, cases, rng):
    """Whether samples of ``draw(rng, strata of the measurements)`` fall into the group."""
    hits = []
    for case in cases:
        parts = case.strata or ((case.size, case.n),)
        strata = np.repeat(np.arange(len(parts)), [n for _, n in parts])
        group = np.concatenate([np.arange(n) < size for size, n in parts])
        if case.first == "anything":
            order = rng.permutation(case.n)
            strata, group = strata[order], group[order]
        elif case.first == "clutter":
            group = group[::-1]
        hit = any(
            group[sample].all() and len(set(sample.tolist())) == k
            for sample in (draw(rng, strata) for _ in range(case.trials))
        )
        hits.append(Hit(case, bool(hit)))
    return hits


def simulate(draw, k, seed, seeded=True, documented=None, n_strata=1, most=2_560):
    """Measure a sampler of k, which is documented as another."""

    def look(cases, rng):
        return outcomes(draw, k, cases, rng)

    return measured(look, documented or k, seed, seeded, n_strata, most)


def measured(look, expected, seed, seeded=True, n_strata=1, most=2_560):
    """Ask for runs as the audit does until the law is decided."""
    rng = np.random.default_rng(seed)
    pool = case_pool(expected, seeded, n_strata=n_strata)
    cases, hits = first_cases(expected, seeded, n_strata=n_strata), []
    while True:
        hits += look(cases, rng)
        law = decide(hits, expected, n_strata=n_strata, seeded=seeded)
        if law.drawn != "undecided" or len(hits) >= most:
            return law
        cases = most_telling(hits, pool, expected, 40, n_strata=n_strata, seeded=seeded)
        if not cases:
            return decide(hits, expected, n_strata=n_strata, seeded=seeded, last=True)


def distinct(k):
    return lambda rng, strata: rng.permutation(len(strata))[:k]


def replacement(k):
    return lambda rng, strata: rng.integers(0, len(strata), k)


def beyond(k):
    """Distinct indices from one more than there are: a sample with that one is useless."""

    def draw(rng, strata):
        sample = rng.permutation(len(strata) + 1)[:k]
        return sample if sample.max() < len(strata) else np.zeros(k, int)

    return draw


def useless(k):
    """Never a sample that gives a model."""
    return lambda rng, strata: np.zeros(k, int)


def missing(k, found):
    """Distinct indices, of which a share gives the model only."""
    return lambda rng, strata: rng.permutation(len(strata))[:k] * (rng.random() < found)


def stratified(*quota):
    """So many from each stratum."""

    def draw(rng, strata):
        parts = [
            rng.permutation(np.flatnonzero(strata == number))[:size]
            for number, size in enumerate(quota)
        ]
        return np.concatenate(parts)

    return draw


def strata_at_random(*quota):
    """So many from one stratum, so many from another."""

    def draw(rng, strata):
        order = rng.permutation(strata.max() + 1)
        parts = [
            rng.permutation(np.flatnonzero(strata == number))[:size]
            for number, size in zip(order, quota, strict=False)
        ]
        return np.concatenate(parts)

    return draw


def camera_first(k):
    """A stratum, then one of its measurements; both again on a repeat."""

    def draw(rng, strata):
        sample = []
        while len(sample) < k:
            members = np.flatnonzero(strata == rng.integers(strata.max() + 1))
            index = int(rng.choice(members))
            if index not in sample:
                sample.append(index)
        return np.array(sample)

    return draw


@pytest.mark.parametrize("k", [2, 3, 4, 5, 7])
@pytest.mark.parametrize(("name", "law"), [("distinct", distinct), ("replacement", replacement)])
def test_both_ways_of_drawing_are_recognised(k, name, law):
    found = simulate(law(k), k, seed=k)
    assert (found.drawn, found.sample_size) == (name, k)
    assert found.error <= ERROR_RATE
    assert found.hits == pytest.approx(found.expected, abs=5 * math.sqrt(found.expected + 1))


class FixedGenerator:
    """Samples that depend on n and on the trial alone, as OpenCV's do."""

    def __init__(self, k, law, seed):
        self.k, self.law, self.seed = k, law, seed
        self.samples = {}

    def look(self, cases, rng):
        return [hit for case in cases for hit in outcomes(self.of_run(), self.k, [case], rng)]

    def of_run(self):
        trial = itertools.count()

        def draw(_rng, strata):
            n = len(strata)
            if n not in self.samples:
                rng = np.random.default_rng([self.seed, n])
                self.samples[n] = [self.law(self.k)(rng, strata) for _ in range(200)]
            return self.samples[n][next(trial)]

        return draw


@pytest.mark.parametrize("k", [3, 4])
@pytest.mark.parametrize(("name", "law"), [("distinct", distinct), ("replacement", replacement)])
def test_a_fixed_generator_is_not_taken_for_new_samples(k, name, law):
    """Its runs at one n show the same samples over and over, which proves little."""
    found = [measured(FixedGenerator(k, law, s).look, k, s, seeded=False) for s in range(6)]
    assert {(f.drawn, f.sample_size) for f in found} == {(name, k)}
    assert all(f.error <= LAST_ERROR_RATE for f in found)


@pytest.mark.parametrize(
    ("draw", "k", "n_strata", "drawn", "quota"),
    [
        (stratified(2, 1), 3, 2, "stratified", (2, 1)),
        (stratified(1, 3), 4, 2, "stratified", (1, 3)),
        (stratified(1, 1, 1), 3, 3, "stratified", (1, 1, 1)),
        (strata_at_random(5, 1), 6, 2, "weighted", (5, 1)),
        (strata_at_random(2, 1), 3, 3, "weighted", (2, 1)),
        (camera_first(3), 3, 2, "weighted", ()),
        (distinct(3), 3, 2, "distinct", ()),
        (replacement(3), 3, 2, "replacement", ()),
    ],
)
def test_samplers_that_go_by_strata_are_recognised(draw, k, n_strata, drawn, quota):
    found = simulate(draw, k, seed=3, n_strata=n_strata)
    assert (found.drawn, found.sample_size, found.quota) == (drawn, k, quota)


def test_few_runs_leave_it_undecided():
    hits = outcomes(distinct(4), 4, first_cases(4, True)[:6], np.random.default_rng(1))
    assert decide(hits, 4).drawn == "undecided"


def test_a_sample_size_that_is_not_the_documented_one_is_found():
    found = simulate(distinct(5), 5, seed=2, documented=4)
    assert (found.drawn, found.sample_size) == ("distinct", 5)


def test_a_sampler_that_prefers_the_first_measurements_is_not_called_uniform():
    """Nine in ten draws take the first three, as PROSAC does on sorted matches."""

    def draw(rng, strata):
        if rng.random() < 0.9:
            return np.concatenate([rng.permutation(3), 3 + rng.permutation(len(strata) - 3)[:1]])
        return rng.permutation(len(strata))[:4]

    assert simulate(draw, 4, seed=0).drawn == "not uniform"


@pytest.mark.parametrize("k", [2, 4, 5, 7])
def test_an_index_beyond_the_data_is_not_taken_for_replacement(k):
    for seed in range(3):
        found = simulate(beyond(k), k, seed)
        assert (found.drawn, found.sample_size) == ("not uniform", k)
        assert "an index beyond the data" in found.strayed
        assert found.error <= ERROR_RATE


@pytest.mark.parametrize("k", [2, 4])
def test_no_law_is_named_where_nothing_is_found(k):
    found = simulate(useless(k), k, seed=0, most=640)
    assert (found.drawn, found.hits) == ("undecided", 0)
    assert found.found < LEAST_FOUND


def test_no_law_is_named_where_few_samples_find_the_group():
    found = simulate(missing(4, 0.1), 4, seed=1)
    assert found.drawn == "undecided"
    assert found.hits > 0


@pytest.mark.parametrize("share", [0.4, 0.6, 0.9])
def test_a_law_is_named_where_a_check_rejects_samples(share):
    found = simulate(missing(4, share), 4, seed=2)
    assert (found.drawn, found.sample_size) == ("distinct", 4)
    assert found.found == pytest.approx(share, abs=0.11)


@pytest.mark.parametrize("passed", [1.0, 0.4])
def test_a_filter_is_told_by_the_share_of_samples_it_lets_pass(passed):
    """Samples that do not pass are drawn again for free; those in the group always pass."""
    law = simulate(distinct(4), 4, seed=1)
    rng = np.random.default_rng(2)
    hits = []
    for case in filter_cases(4, 200):
        of_group = math.comb(case.size, 4) / math.comb(case.n, 4)
        chance = of_group / (of_group + (1 - of_group) * passed)
        hits.append(Hit(case, bool(rng.random(case.trials).min() < chance)))
    low, high = accepted(hits, law)
    assert low <= passed <= high
    assert (high < 1) == (passed < 1)


def test_the_interval_covers_uniform_draws():
    covered = 0
    for seed in range(40):
        low, high = simulate(distinct(4), 4, seed).interval
        covered += low <= 1 <= high
    assert covered >= 37
