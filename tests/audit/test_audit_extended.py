"""Wrapped functions under the audit: trial counts and outcomes, on a simulated library."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ransac_fix import approximate_required_trials, required_trials
from ransac_fix.audit.extended import (
    count_trials,
    decide_by_outcomes,
    judge_extension,
    keeps,
)
from ransac_fix.audit.model import SamplerLaw, TrialCount
from ransac_fix.criterion import all_inlier_probability

K = 4
ONE = {
    "name": "simulated",
    "sample_size": K,
    "typical_trials": 80,
    "spare": 1,
    "fewest_samples": 0,
    "n_strata": 1,
    "verifying": 0,
}
SAMPLER = SamplerLaw("distinct", K, 20, 20.0, 40, (0.9, 1.1))


class Library:
    """A library whose rule is the approximate one, and its wrapper.

    Parameters
    ----------
    drawn : float
        Share of the missing trials that the wrapper really draws.
    told : float
        Share that it tells of.
    found : float
        Share of samples within a group that find it.
    """

    def __init__(self, drawn: float = 1.0, told: float = 1.0, found: float = 1.0) -> None:
        self.drawn, self.told, self.found = drawn, told, found

    def ask(self, do: str, **request: Any) -> dict[str, Any]:
        assert do == "extended"
        rng = np.random.default_rng(request["seed"])
        counts, returned, runs = [], [], 0
        for n, size, n_groups, _strata, budget, confidence, times in request["cases"]:
            a, b = (
                groups * self.found * all_inlier_probability(inliers, n, K)
                for groups, inliers in ((n_groups, size), (1, size + 1))
            )
            smaller = larger = 0
            for _ in range(times):
                first_a, first_b = rng.geometric(a), rng.geometric(b)

                def in_hand(trial: int, sizes=(first_a, first_b), size=size) -> int:
                    return size + 1 if sizes[1] <= trial else size if sizes[0] <= trial else K

                trial = 0
                while trial < budget and trial < self._rule(in_hand(trial), n, confidence):
                    trial += 1
                own, best = trial, in_hand(trial)
                needed = min(required_trials(best, n, K, confidence), budget)
                missing = max(needed - own, 0) if request["exact"] else 0
                best = in_hand(own + round(self.drawn * missing))
                smaller += best == size
                larger += best == size + 1
                counts.append(
                    {
                        "n_samples": n,
                        "n_inliers": best,
                        "sample_size": K,
                        "confidence": confidence,
                        "own": own,
                        "first_inliers": in_hand(own),
                        "trials": own + round(self.told * missing),
                        "required": required_trials(best, n, K, confidence),
                        "limit": budget,
                    }
                )
            returned.append([smaller, larger])
            runs += times
        return {"counts": counts, "returned": returned, "runs": runs}

    def _rule(self, n_inliers: int, n: int, confidence: float) -> float:
        return approximate_required_trials(n_inliers, n, K, confidence)


def verdict(library: Library, one: dict[str, Any] = ONE, sampler: SamplerLaw = SAMPLER) -> Any:
    counts, _ = count_trials(library, one, sampler, 1)
    outcomes, _ = decide_by_outcomes(library, one, sampler, 2)
    return judge_extension(counts, sampler, outcomes, counted=False)


def test_a_wrapper_that_draws_what_is_missing_is_exact() -> None:
    judged, reason, evidence = verdict(Library())
    assert judged == "exact", reason
    assert evidence.kept == evidence.runs > evidence.extended > 0
    assert evidence.outcomes.log_ratio > 13.8
    assert evidence.outcomes.log_ratio_alone < -13.8
    assert evidence.outcomes.own < evidence.outcomes.exact


def test_a_wrapper_that_tells_of_more_than_it_draws_undersamples() -> None:
    judged, reason, _ = verdict(Library(drawn=0.0))
    assert judged == "undersamples", reason


def test_a_wrapper_that_draws_too_few_is_found_by_its_counts() -> None:
    judged, reason, evidence = verdict(Library(drawn=0.5, told=0.5))
    assert judged == "other rule"
    assert "did not come to the exact number" in reason
    assert not keeps(evidence.counts[0])


@pytest.mark.parametrize("found", [0.4, 1.8])
def test_a_share_found_that_is_not_known_is_measured(found: float) -> None:
    judged, reason, _ = verdict(Library(found=found), {**ONE, "verifying": 0})
    assert judged == "exact", reason


def test_another_law_than_that_of_the_sampler_is_named() -> None:
    with_replacement = replace(SAMPLER, drawn="replacement")
    judged, reason, _ = verdict(Library(), sampler=with_replacement)
    assert judged == "other rule"
    assert "(replacement), for which" in reason


def test_what_outcomes_cannot_tell_is_left_to_the_library_s_own_count() -> None:
    counts = [TrialCount(20, 10, K, 0.9, 20, 10, 21, 21, 1000)]
    needed = required_trials(10, 20, K, 0.9)
    counts = [replace(counts[0], own=needed - 1, trials=needed, required=needed)]
    assert judge_extension(counts, SAMPLER, None, counted=True)[0] == "exact"
    judged, reason, _ = judge_extension(counts, SAMPLER, None, counted=False)
    assert judged == "not measured"
    assert "too near" in reason


def test_what_keeps_a_promise() -> None:
    count = TrialCount(20, 10, K, 0.9, 30, 10, 53, 53, 1000)
    assert keeps(count)
    assert not keeps(replace(count, trials=54))
    assert not keeps(replace(count, trials=52))
    assert keeps(replace(count, trials=40, limit=40))
    assert keeps(replace(count, own=60, trials=60))
    assert keeps(replace(count, n_inliers=12, trials=80, required=20))
    assert keeps(replace(count, trials=None, own=None, required=None, limit=None))
    assert math.isfinite(required_trials(10, 20, K, 0.9))
