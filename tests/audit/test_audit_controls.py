"""Known laws are recognised, wrong ones are not, and a failed control stops every verdict."""

import sys
from dataclasses import replace

import pytest

from ransac_fix.audit import control_probe, session
from ransac_fix.audit.controls import CONTROLS
from ransac_fix.audit.local import LocalHost
from ransac_fix.audit.measure import measure
from ransac_fix.audit.session import Options


def measured(law, seed=1):
    host = LocalHost(control_probe.entry_point(law))
    return measure(host, host.described, seed)


@pytest.mark.parametrize("law", CONTROLS, ids=lambda law: law.name)
def test_every_control_is_recognised(law):
    found = measured(law)
    assert law.recognised(found.fit, found.sampler), found


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
    assert not replace(law, **change).recognised(found.fit, found.sampler)


def test_no_verdict_is_given_when_a_control_is_misidentified(monkeypatch):
    failed = session.Control("exact", "this", "that", False, 10)
    monkeypatch.setattr(session, "measure_controls", lambda options: (failed,))
    report = session.audit(Options(("scikit-image",), sys.executable))
    assert [v.verdict for v in report.verdicts] == ["not measured"]
    assert "control was misidentified (exact)" in report.verdicts[0].reason
