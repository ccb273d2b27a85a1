"""Stopping laws told by nothing but what many runs returned."""

import io
import json
import math
from dataclasses import replace
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
from rich.console import Console

from ransac_fix.audit import control_probe, outcomes, session
from ransac_fix.audit import measure as measurement
from ransac_fix.audit.controls import CONTROLS, NO_BUDGET_CONTROLS, OUTCOME_CONTROLS, OUTCOME_ZOO
from ransac_fix.audit.judge import judge
from ransac_fix.audit.laws import Candidate, Fit
from ransac_fix.audit.local import LocalHost
from ransac_fix.audit.measure import Measurement, measure
from ransac_fix.audit.model import (
    LikelihoodRatio,
    OutcomeCount,
    OutcomeEvidence,
    SamplerLaw,
    Verdict,
)
from ransac_fix.audit.outcome_laws import Hypothesis, Problem, chance_of_smaller, hypotheses
from ransac_fix.report.verdicts_json import verdicts_json
from ransac_fix.report.verdicts_junit import verdicts_junit
from ransac_fix.report.verdicts_markdown import verdicts_markdown
from ransac_fix.report.verdicts_text import print_verdicts

DISTINCT = SamplerLaw("distinct", 4, 64, 64.3, 100, (0.8, 1.2))
APPROXIMATE = Hypothesis(Candidate("approximate", 4))
ABOVE = Hypothesis(Candidate("distinct", 4, 1))
EXACT = Hypothesis(Candidate("distinct", 4))
EVIDENCE = OutcomeEvidence(
    runs=3744,
    error_rate=1e-6,
    counts=(
        OutcomeCount(19, 5, 2, 0.632, 1965, 120, 312, 24, 0.29, 0.05, 0.29),
        OutcomeCount(19, 5, 2, None, 336, 50, 150, 16, None, None, 0.26),
    ),
    likeliest=APPROXIMATE.formula,
    ratios=(LikelihoodRatio(ABOVE.formula, 0.4), LikelihoodRatio(EXACT.formula, 94.0)),
    factor=(0.97, 0.86, 1.1),
    no_law=-20.7,
)


@pytest.mark.parametrize("tested", ["every trial", "on improvement"])
@pytest.mark.parametrize(("in_hand", "without"), [(40, 150), (3, 90), (200, 200), (120, 10_000)])
def test_the_chance_to_keep_the_smaller_model_is_that_of_simulated_runs(tested, in_hand, without):
    problem = Problem(20, 5, 2, 0.012, 0.01, 300)
    rng = np.random.default_rng(1)
    runs = 200_000
    a, b = problem.smaller, problem.larger
    first = rng.geometric(a + b, runs)
    is_smaller = rng.random(runs) < a / (a + b)
    improving = tested == "on improvement"
    seen = first <= (problem.budget if improving else min(without, problem.budget))
    end = np.maximum(first, in_hand)
    if improving:
        end = np.where(first >= in_hand, first, problem.budget)
    kept = is_smaller & (first + rng.geometric(b, runs) > end)
    share = (kept & seen).sum() / seen.sum()
    expected = chance_of_smaller(
        problem, np.array([float(in_hand)]), np.array([float(without)]), np.array([1.0]), tested
    )[0, 0]
    assert expected == pytest.approx(share, abs=4 * math.sqrt(0.25 / seen.sum()) + 1e-3)


def test_a_budget_below_the_rule_is_what_ends_a_run():
    problem = Problem(20, 5, 2, 0.012, 0.01, 300)
    at = np.array([300.0]), np.array([300.0])
    beyond = np.array([math.inf]), np.array([math.inf])
    chances = [chance_of_smaller(problem, *x, np.array([1.0]), "every trial") for x in (at, beyond)]
    assert chances[0] == chances[1]


def test_no_law_is_tried_twice():
    for k in (1, 2, 3, 4, 7):
        laws = hypotheses(k, "distinct")
        assert len(set(laws)) == len(laws)
        told_apart = {
            (law.tested, *(round(law.x(i, n, 1.0), 9) for n, i in ((30, 11), (57, 19))))
            for law in laws
        }
        assert len(told_apart) == len(laws)


def by_name(name):
    return next(law for law in OUTCOME_ZOO if law.name == f"{name}, by outcomes")


# All of them: benchmarks/control_zoo.py --outcomes.
@pytest.mark.parametrize("name", ["exact in I-1", "no rule"])
def test_a_known_law_is_recognised_by_outcomes(name):
    law = by_name(name)
    host = LocalHost(control_probe.entry_point(law))
    found = measure(host, host.described, 3)
    assert law.recognised(found), found
    assert found.points == ()
    assert found.outcomes.runs <= found.runs
    seen = sum(c.smaller + c.larger + c.neither for c in found.outcomes.counts)
    assert seen == found.outcomes.runs


def test_a_law_is_recognised_where_no_number_of_trials_can_be_set():
    """Runs of one trial are asked for by the lowest confidence."""
    (law,) = NO_BUDGET_CONTROLS
    point = control_probe.entry_point(law)
    host = LocalHost(
        replace(point, run=lambda p, s, seed: point.run(p, replace(s, max_trials=1), seed))
    )
    found = measure(host, host.described, 3)
    assert law.recognised(found), found
    assert judge(found)[0] == "undersamples"


def test_a_limit_of_its_own_on_few_trials_is_noticed():
    """Without a budget a function may end runs before the rule does: no law is made of that."""
    (law,) = NO_BUDGET_CONTROLS
    point = replace(control_probe.entry_point(replace(law, budget=True)), budget=False)
    host = LocalHost(
        replace(point, run=lambda p, s, seed: point.run(p, replace(s, max_trials=20), seed))
    )
    verdict, reason = judge(measure(host, host.described, 3))
    assert verdict == "not measured"
    assert "ends runs by a limit of its own" in reason


def test_a_rule_that_the_data_change_is_not_taken_for_a_law():
    """A quarter or three times the exact number, mixed, looks like (I/n)^k from afar."""
    law = by_name("data for a count")
    host = LocalHost(control_probe.entry_point(law))
    found = measure(host, host.described, 3)
    assert law.recognised(found), found
    assert judge(found)[0] == "other rule"
    assert found.outcomes is None


# All of them: benchmarks/control_zoo.py --outcomes --quick.
def test_runs_that_end_with_the_verdict_give_that_of_a_full_measurement(monkeypatch):
    monkeypatch.setattr(outcomes, "_MOST_SECONDS", math.inf)
    law = by_name("exact in I+1")
    host = LocalHost(control_probe.entry_point(law))
    brief, full = (measure(host, host.described, 3, verdict_only=only) for only in (True, False))
    assert law.recognised(brief), brief
    assert judge(brief)[0] == judge(full)[0] == "undersamples"
    assert brief.runs < full.runs
    # What is not told apart is named.
    assert {full.fit.law, *full.fit.rivals} <= {brief.fit.law, *brief.fit.rivals}
    # Nor are fewer runs believed unless they speak against no law, too.
    assert brief.outcomes.no_law < math.log(1e-6)


@pytest.mark.parametrize(
    ("described", "drawn", "reason"),
    [
        ({"verifying": 1}, "distinct", "1 of the 3 of a sample only choose among the models"),
        ({}, "not uniform", "outcomes show the rule of uniform samples only; these are not unif"),
        ({}, "stratified", "outcomes show the rule of uniform samples only; these are stratified"),
        ({}, "undecided", "the sampler could not be told from 100 runs (64 hits, 64.3 expected)"),
    ],
)
def test_outcomes_are_not_asked_where_chances_are_not_those_of_the_laws(
    monkeypatch, described, drawn, reason
):
    """The rule is the exact one of the control; what its samples are is another matter."""
    host = LocalHost(control_probe.entry_point(OUTCOME_CONTROLS[0]))
    sampler = replace(DISTINCT, drawn=drawn)
    monkeypatch.setattr(measurement, "sampler_law", lambda *_, **__: (sampler, 100))
    monkeypatch.setattr(outcomes, "decide", pytest.fail)
    verdict, why = judge(measure(host, {**host.described, **described}))
    assert verdict == "not measured"
    assert reason in why


def test_a_law_no_likelier_than_none_is_not_named():
    doubtful = replace(EVIDENCE, no_law=3.0)
    verdict, reason = judge(Measurement(DISTINCT, (), Fit(None), 3844, {}, (), doubtful))
    assert verdict == "not measured"
    assert "not a hundred times as likely as none" in reason


def test_laws_that_outcomes_cannot_tell_apart_are_named_together():
    found = Measurement(DISTINCT, (), Fit(APPROXIMATE.law, (ABOVE.law,)), 3844, {}, (), EVIDENCE)
    verdict, reason = judge(found)
    assert verdict == "undersamples"
    assert "assumes P = (I/n)^4, but draws 4 distinct indices" in reason
    assert "or it assumes C((I+1),4)/C(n,4), which 3,744 runs did not tell from that" in reason


def test_no_verdict_where_laws_with_different_verdicts_stand():
    found = Measurement(DISTINCT, (), Fit(EXACT.law, (APPROXIMATE.law,)), 6100, {}, (), EVIDENCE)
    verdict, reason = judge(found)
    assert verdict == "not measured"
    assert reason.startswith("undecided after 3,744 runs: ")


def test_the_report_shows_the_counts_and_the_error_rate():
    verdict = Verdict(
        "gc-ransac",
        "findHomography",
        "0.1.1",
        "undersamples",
        "assumes P = (I/n)^4",
        sampler_law=DISTINCT,
        stopping_law=APPROXIMATE.law,
        outcomes=EVIDENCE,
        runs=3844,
    )
    report = session.Report(1, (verdict,), (), (), 3844, 4.0)
    console = Console(width=100, record=True, file=io.StringIO())
    print_verdicts(report, console)
    text = " ".join(console.export_text().split())
    assert "undersamples findHomography ln(1-s)/ln(1-(I/n)^4)" in text
    assert "19 5 0.632 432 28% 29% 5% 29%" in text
    assert "e^94.0 ln(1-s)/ln(1-C(I,4)/C(n,4))" in text
    assert "error rate 1e-06 each" in text
    assert "0.97, with 99 % confidence 0.86 to 1.1" in text

    line = "of 3,744 runs 462 returned the larger of two models, 170 the smaller, 40 neither"
    for write in (verdicts_markdown, verdicts_junit):
        assert f"{line}; error rate 1e-06" in write(report).replace("\\", "")

    schema = files("ransac_fix.report").joinpath("schemas/audit.json").read_text()
    jsonschema.validate(json.loads(verdicts_json(report)), json.loads(schema))


def test_an_audit_by_outcomes_proves_itself_on_a_law_seen_so():
    assert all(law.outcomes_only for law in (*OUTCOME_CONTROLS, *NO_BUDGET_CONTROLS))
    assert not any(law.budget for law in NO_BUDGET_CONTROLS)
    assert not any(law.outcomes_only for law in CONTROLS)
