"""Counted trials of runs that are another each time, and of runs that no rule ends."""

import itertools
import math
from collections import Counter
from dataclasses import replace
from statistics import median

from ransac_fix.audit.control_probe import entry_point
from ransac_fix.audit.controls import CONTROLS
from ransac_fix.audit.worker import streams
from ransac_fix.audit.worker.interface import EntryPoint, Outcome

REQUEST = {
    "kind": "count",
    "n_samples": 14,
    "group_size": 4,
    "n_groups": 1,
    "wanted": 6,
    "streams": 40,
    "largest": 640,
    "smallest": 10,
    "seed": 5,
    "u": [2.5, 6.0],
    "strata": (),
}


def test_the_count_of_runs_that_cannot_be_repeated_is_the_one_that_comes_again():
    """Runs in which the model comes late end anywhere above."""
    law = next(law for law in CONTROLS if law.counted)
    repeatable, seeds, runs = entry_point(law), itertools.count(), Counter()

    def run(planted, settings, seed):
        runs[seed, settings.confidence] += 1
        return repeatable.run(planted, settings, next(seeds))

    answer = streams.points(replace(repeatable, repeatable=False, run=run), REQUEST)
    assert len(answer["points"]) == REQUEST["wanted"]
    for point in answer["points"]:
        for u, trials in (
            (point["u_low"], point["trials"] - 1),
            (point["u_high"], point["trials"]),
        ):
            required = law.required_trials(4, 14, law.sample_size, -math.expm1(-u))
            assert required == trials
    assert answer["runs"] == runs.total()
    assert min(runs.values()) == 4
    assert median(runs.values()) <= 5
    assert max(runs.values()) <= 16


def test_runs_that_all_reach_their_budget_are_given_up():
    def run(planted, settings, _seed):
        return Outcome(planted.labels == 0, settings.max_trials)

    answer = streams.points(EntryPoint("endless", "line", 2, run, counted=True), REQUEST)
    assert answer["points"] == []
    assert answer["discarded"] == {streams.BUDGET_REACHED: 8}
    assert answer["runs"] == 8
