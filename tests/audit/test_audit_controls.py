"""Known laws are recognised, wrong ones are not, and a failed control stops every verdict."""

import sys
from dataclasses import replace

import pytest

from ransac_fix.audit import control_probe, proof, session
from ransac_fix.audit.controls import CONTROLS, KINDS, ZOO, controls_for
from ransac_fix.audit.judge import judge
from ransac_fix.audit.local import LocalHost
from ransac_fix.audit.measure import measure
from ransac_fix.audit.model import Control, OutcomeCount, OutcomeEvidence, Point, Verdict
from ransac_fix.audit.session import Options


def measured(law, seed=1):
    host = LocalHost(control_probe.entry_point(law))
    return measure(host, host.described, seed)


# The others differ from these in one number; benchmarks/control_zoo.py measures them all.
SAMPLE = (
    *CONTROLS,
    *(law for law in ZOO if law.quirk is not None or law.truncated or law.offset == 2),
)


@pytest.mark.parametrize("law", SAMPLE, ids=lambda law: law.name)
def test_a_known_law_is_recognised(law):
    found = measured(law)
    assert law.recognised(found), found


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        # After a hundred runs, one law left, its first groups are hit five deviations too often.
        ("sampler that prefers the first", 9_300_000),
        ("sampler that prefers the first", 84_500_000),
        # A thousand runs find the larger group each time.
        ("confidence ignored", 64_500_000),
    ],
)
def test_laws_that_showed_late_are_waited_for(name, seed):
    law = next(law for law in ZOO if law.name == name)
    found = measured(law, seed)
    assert law.recognised(found), found


def test_the_zoo_holds_what_programs_are_known_to_do():
    assert len(ZOO) >= 24
    assert len({law.name for law in ZOO}) == len(ZOO)
    exact = {"distinct", "replacement", "stratified", "weighted"}
    assert {law.assumed for law in ZOO} == {*exact, "approximate", "approximate stratified"}
    assert {law.drawn for law in ZOO} == {*exact, "not uniform"}
    assert {law.multiplier for law in ZOO} == {1, 1.5, 2, 3}
    assert {law.offset for law in ZOO} == {-1, 0, 1, 2}
    assert {law.inlier_offset for law in ZOO} == {-1, 0, 1}


@pytest.mark.parametrize(
    "change",
    [
        {"assumed": "approximate"},
        {"inlier_offset": 1},
        {"exponent": 2},
        {"multiplier": 2.0},
        {"rounding": "floor"},
        {"offset": 1},
        {"drawn": "replacement"},
        {"tested": "on improvement"},
    ],
    ids=str,
)
def test_a_control_that_is_not_what_it_says_is_noticed(change):
    """The law put in is the exact one; what it is taken for differs in one respect."""
    law = CONTROLS[1]
    assert law.assumed == "distinct"
    found = measured(law)
    assert law.recognised(found)
    assert not replace(law, **change).recognised(found)


@pytest.mark.parametrize(
    "law",
    [law for law in ZOO if law.quirk in ("first model", "first consensus")],
    ids=lambda law: law.name,
)
def test_a_run_that_ends_with_a_model_in_hand_undersamples(law):
    """Whatever its formula is, no trial follows where the exact rule asks for hundreds."""
    verdict, reason = judge(measured(law))
    assert verdict == "undersamples"
    assert "stops at once, and s=0.99 needs" in reason


def test_no_verdict_is_given_when_a_control_is_misidentified(monkeypatch):
    failed = Control("exact", "this", "that", False, 10)
    monkeypatch.setattr(proof, "measure_controls", lambda laws, seconds, **how: (failed,))
    report = session.audit(Options(("scikit-image",), sys.executable))
    assert [v.verdict for v in report.verdicts] == ["not measured"]
    assert "control was misidentified (exact)" in report.verdicts[0].reason


def test_every_control_vouches_for_one_kind_of_measurement():
    of_kinds = [law for kind in KINDS for law in controls_for(kind)]
    assert set(CONTROLS) < set(of_kinds)
    assert len(set(of_kinds)) == len(of_kinds)
    assert all(law.n_strata == 1 for law in controls_for("any"))
    assert all(law.n_strata > 1 for law in controls_for("strata"))
    for quick in (True, False):
        assert all(law.outcomes_only for law in controls_for("outcomes", quick=quick))


@pytest.fixture
def measured_kinds(monkeypatch):
    """The kinds of control that were measured, none of them really."""
    kinds = []

    def pretend(laws, seconds, **how):
        kinds.append(next(kind for kind in KINDS if laws == controls_for(kind)))
        return (Control(kinds[-1], "this", "this", True, 10),)

    monkeypatch.setattr(proof, "measure_controls", pretend)
    return kinds


def test_only_the_controls_that_a_measurement_rests_on_are_measured(measured_kinds):
    """Neither strata nor outcomes show anything of this one."""
    report = session.audit(Options(("scikit-image",), sys.executable))
    assert measured_kinds == ["any"]
    assert [v.verdict for v in report.verdicts] == ["undersamples"]
    assert report.runs == 10 + report.verdicts[0].runs


@pytest.mark.parametrize(
    ("system", "entry_point", "kinds"),
    [
        ("gc-ransac", "findRigidTransform(*", {"any", "outcomes"}),
        ("gc-ransac", "findLine2D", set()),
        ("opencv", "estimateAffine3D(*", {"any", "outcomes", "no budget"}),
    ],
)
def test_the_controls_by_outcomes_are_measured_beside_such_entry_points(
    monkeypatch, measured_kinds, system, entry_point, kinds
):
    monkeypatch.setattr(session, "examine", examined)
    session.audit(Options((system,), sys.executable, entry_points=(entry_point,)))
    assert set(measured_kinds) == kinds
    assert len(measured_kinds) == len(kinds)


def test_the_controls_by_strata_are_measured_beside_such_entry_points(monkeypatch, measured_kinds):
    monkeypatch.setattr(session, "examine", examined)
    which = ("estimate_generalized_absolute_pose",)
    session.audit(Options(("poselib",), sys.executable, entry_points=which))
    assert sorted(measured_kinds) == ["any", "strata"]


def examined(host, system, version, one, problems, **how):
    """Stand in for the measurement, which is not what is looked at."""
    return Verdict(system, one["name"], version, "exact", "why", runs=1)


@pytest.mark.parametrize(
    ("system", "entry_points"),
    [("colmap", ()), ("scikit-image", ("no such*",))],
    ids=["not installed", "nothing to measure"],
)
def test_no_control_is_measured_where_nothing_else_is(
    monkeypatch, measured_kinds, tmp_path, system, entry_points
):
    probe = session.probe_files()[system].read_text("utf-8")
    if system == "colmap":
        probe = probe.replace('"pycolmap"', '"no_such_module"')
    file = tmp_path / "probe.py"
    file.write_text(probe, "utf-8")
    monkeypatch.setattr(session, "probe_files", lambda: {system: file})
    report = session.audit(Options((system,), sys.executable, entry_points=entry_points))
    assert [v.verdict for v in report.verdicts] == ["not measured"]
    assert measured_kinds == []
    assert (report.controls, report.runs) == ((), 0)


def counted(max_trials, confidence):
    return OutcomeCount(9, 3, 1, confidence, max_trials, 5, 5, 5, None, None, None)


POINT = Point(9, 4, 2, 20, 3.0, 2.9, 5, "flip", ((2, 5), (2, 4)))
EVIDENCE = OutcomeEvidence(15, 1e-6, (), "law", (), None, -20.0)


@pytest.mark.parametrize(
    ("found", "kinds"),
    [
        ({}, ["any"]),
        ({"verdict": "not measured", "outcomes": EVIDENCE}, []),
        ({"points": (POINT,)}, ["any", "strata"]),
        ({"outcomes": replace(EVIDENCE, counts=(counted(4, None),))}, ["any", "outcomes"]),
        (
            {"outcomes": replace(EVIDENCE, counts=(counted(1, 0.9), counted(1, None)))},
            ["any", "outcomes", "no budget"],
        ),
    ],
    ids=["points", "no verdict", "strata", "outcomes", "no budget"],
)
def test_the_controls_of_a_kept_verdict_follow_from_its_evidence(measured_kinds, found, kinds):
    verdict = replace(Verdict("small", "fit", "1.0", "exact", "why"), **found)
    controls = proof.Controls(20.0).measured([verdict, verdict])
    assert [control.name for control in controls] == measured_kinds == kinds
