"""Simulated samplers are told apart, with the error rates stated."""

import math

import numpy as np
import pytest

from ransac_fix.audit.plan import hit_cases
from ransac_fix.audit.sampling import Hit, decide


def simulate(draw, k, runs, seed, seeded=True, documented=None):
    """Hits of a sampler ``draw(rng, n) -> indices`` of k, planned for the documented k."""
    rng = np.random.default_rng(seed)
    hits = []
    for case in hit_cases(documented or k, seeded, runs):
        group = np.zeros(case.n, dtype=bool)
        members = {
            "groups": slice(None, case.size),
            "clutter": slice(case.n - case.size, None),
            "anything": rng.permutation(case.n)[: case.size],
        }
        group[members[case.first]] = True
        hit = any(
            group[sample].all() and len(set(sample.tolist())) == k
            for sample in (draw(rng, case.n) for _ in range(case.trials))
        )
        hits.append(Hit(case, bool(hit)))
    return hits


def distinct(k):
    return lambda rng, n: rng.permutation(n)[:k]


def replacement(k):
    return lambda rng, n: rng.integers(0, n, k)


@pytest.mark.parametrize("k", [2, 3, 4, 5, 7])
@pytest.mark.parametrize(("name", "law"), [("distinct", distinct), ("replacement", replacement)])
@pytest.mark.parametrize("seeded", [True, False])
def test_both_ways_of_drawing_are_recognised(k, name, law, seeded):
    for runs in (160, 320, 640, 1280, 2560):
        found = decide(simulate(law(k), k, runs, seed=k, seeded=seeded), k)
        if found.drawn != "undecided":
            break
    if not seeded and k <= 3 and law is replacement:
        # Small samples rarely repeat an index: on one fixed generator it may stay open.
        assert found.drawn in ("replacement", "undecided")
        return
    assert (found.drawn, found.sample_size) == (name, k)
    assert found.hits == pytest.approx(found.expected, abs=5 * math.sqrt(found.expected + 1))


def test_few_runs_leave_it_undecided():
    assert decide(simulate(distinct(4), 4, 6, seed=1), 4).drawn == "undecided"


def test_a_sample_size_that_is_not_the_documented_one_is_found():
    found = decide(simulate(distinct(5), 5, 640, seed=2, documented=4), 4)
    assert (found.drawn, found.sample_size) == ("distinct", 5)


def test_a_sampler_that_prefers_the_first_measurements_is_not_called_uniform():
    """Nine in ten draws take the first three, as PROSAC does on sorted matches."""

    def draw(rng, n):
        if rng.random() < 0.9:
            return np.concatenate([rng.permutation(3), 3 + rng.permutation(n - 3)[:1]])
        return rng.permutation(n)[:4]

    assert decide(simulate(draw, 4, 160, seed=0), 4).drawn == "not uniform"


def test_the_interval_covers_uniform_draws():
    covered = 0
    for seed in range(40):
        low, high = decide(simulate(distinct(4), 4, 320, seed), 4).interval
        covered += low <= 1 <= high
    assert covered >= 37
