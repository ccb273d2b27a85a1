"""The shared half of all wrappers: how many trials are missing, and who bounds them."""

import math
import subprocess
import sys
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ransac_fix import approximate_required_trials, required_trials, success_probability
from ransac_fix.errors import RansacFixError, RansacFixWarning
from ransac_fix.patching import missing
from ransac_fix.patching.missing import Attempt, Promise, Spare, complete, missing_trials
from ransac_fix.patching.watching import Watched, watching


@given(
    n_samples=st.integers(4, 1000),
    data=st.data(),
    confidence=st.floats(0.01, 0.9999),
    slack=st.sampled_from([0.0, 0.1, 1.0]),
)
def test_what_is_left_out_is_within_the_slack(
    n_samples: int, data: st.DataObject, confidence: float, slack: float
) -> None:
    n_inliers = data.draw(st.integers(4, n_samples))
    needed = required_trials(n_inliers, n_samples, 4, confidence)
    trials = data.draw(st.integers(1, int(needed)))
    left = missing_trials(n_inliers, n_samples, 4, confidence, trials, math.inf, slack)
    failure = 1 - success_probability(trials, n_inliers, n_samples, 4)
    if left:
        assert left == min(needed - trials, 2**31 - 1)  # what a C integer holds
        assert failure > (1 - confidence) * (1 + slack) * (1 - 1e-9)
    else:
        assert trials == needed or failure <= (1 - confidence) * (1 + slack) * (1 + 1e-9)


@pytest.mark.filterwarnings("default::ransac_fix.errors.RansacFixWarning")
@pytest.mark.parametrize("limit", [math.inf, 2**31 - 1])
def test_without_a_limit_the_second_run_is_bounded_and_says_so(limit: float) -> None:
    drawn = []

    def run(trials: int, _round: int) -> Attempt[str]:
        drawn.append(trials)
        return Attempt("second", 4, trials)

    first = Attempt("first", 4, 20_000)
    with pytest.warns(RansacFixWarning, match="before the exact number"):
        result = complete(first, Promise(500, 4, 0.99, limit), run, lambda *_: False)
    assert result == "first"
    assert sum(drawn) == 200_000 - 20_000


def test_a_library_that_stops_early_is_called_again_for_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rounds = []

    def run(trials: int, round_: int) -> Attempt[int]:
        rounds.append(round_)
        return Attempt(round_, 6, min(trials, 50))

    monkeypatch.setattr(missing, "_slack", 0.1)
    result = complete(Attempt(0, 5, 40), Promise(14, 4, 0.99, 10**6), run, lambda new, _: new == 2)
    assert result == 2
    # After the second round there are six inliers in hand, and the number is theirs.
    assert rounds == list(range(1, len(rounds) + 1))
    assert 40 + 50 * len(rounds) >= required_trials(6, 14, 4, 0.99) - 5


@pytest.mark.parametrize("value", ["-0.1", "much", "nan", "inf"])
def test_a_bad_slack_in_the_environment_is_one_clear_line(value: str) -> None:
    program = "import ransac_fix.patching.missing"
    environment = {"RANSAC_FIX_SLACK": value, "PATH": ""}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True
    )
    assert "RANSAC_FIX_SLACK must be a number that is not negative" in done.stderr
    with pytest.raises(RansacFixError):
        missing.set_slack(float("nan"))


def test_children_inherit_the_slack(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RANSAC_FIX_SLACK", "0.1")
    monkeypatch.setattr(missing, "_slack", 0.1)
    missing.set_slack(0.25)
    program = "from ransac_fix.patching import missing; print(missing.slack())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.strip() == "0.25"


@given(
    n_samples=st.integers(5, 3000),
    data=st.data(),
    confidence=st.floats(0.2, 0.9999),
    spare=st.integers(0, 20),
)
def test_a_raised_confidence_runs_what_is_missing_and_hardly_more(
    n_samples: int, data: Any, confidence: float, spare: int
) -> None:
    n_inliers = data.draw(st.integers(5, n_samples))
    counts = n_inliers, n_samples, 4
    asked = missing.raised_confidence(n_samples, 4, confidence, Spare(spare))
    assert confidence <= asked < 1
    own, raised = (approximate_required_trials(*counts, s) for s in (confidence, asked))
    if own < 10_000:
        assert raised <= max(own, 1.1 * required_trials(*counts, confidence) + spare + 2)


def test_a_raised_confidence_leaves_few_runs_short() -> None:
    short = {False: 0, True: 0}
    for n_samples in (20, 40, 100, 1000):
        for n_inliers in range(n_samples // 2, n_samples, n_samples // 20):
            for raising in short:
                asked = missing.raised_confidence(n_samples, 4, 0.99, Spare(10))
                own = approximate_required_trials(
                    n_inliers, n_samples, 4, asked if raising else 0.99
                )
                short[raising] += own < required_trials(n_inliers, n_samples, 4, 0.99)
    assert short[False] > 10
    assert short[True] == 0


def test_where_nothing_can_be_raised_the_confidence_is_as_it_was() -> None:
    for confidence in (0.0, 1.0, -1.0, 1.0 - 2.0**-52):
        assert missing.raised_confidence(50, 4, confidence, Spare(10)) == confidence
    assert missing.raised_confidence(4, 4, 0.9, Spare(10)) == 0.9
    # Three times what is needed is enough.
    assert missing.raised_confidence(50, 4, 0.9, Spare(0), multiplier=3.0) == 0.9
    for watched in (Watched(exact=False), Watched(exact=True, raising=False)):
        with watching(watched):
            assert missing.raised_confidence(20, 4, 0.9, Spare(10)) == 0.9
    assert missing.raised_confidence(20, 4, 0.9, Spare(10)) > 0.9
