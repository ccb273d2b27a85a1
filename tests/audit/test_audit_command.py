"""The command: formats, names, exit codes."""

import io
import json
import math
from importlib.resources import files

import jsonschema
import msgspec
import pytest
from click.testing import CliRunner
from rich.console import Console

from ransac_fix.audit import session
from ransac_fix.audit.model import (
    AtDefaults,
    Control,
    Guarantee,
    Point,
    Report,
    SamplerLaw,
    StoppingLaw,
    Verdict,
)
from ransac_fix.cli import audit as audit_command
from ransac_fix.cli import main
from ransac_fix.report.verdicts_json import verdicts_json
from ransac_fix.report.verdicts_text import print_verdicts

CONTROL = Control("exact", "a; distinct", "a; distinct", True, 100)
VERDICT = Verdict(
    "opencv",
    "findHomography(RANSAC)",
    "5.0.0.93",
    "undersamples",
    "assumes P = (I/n)^4, but draws 4 distinct indices",
    "Set maxIters.",
    SamplerLaw("distinct", 4, 100, 101.5, 300, (0.9, 1.1)),
    StoppingLaw(
        "approximate", 4, 0, 1.0, (0.5, 0.5), "every trial", False, "round(ln(1-s)/ln(1-(I/n)^4))"
    ),
    AtDefaults(0.995, 0, 2000, 1.0, True, (Guarantee(20, 7, 4, 0.995, 350, 731, "rule", 0.9209),)),
    (Point(14, 5, 4, 84, 1.3703, 1.37, 20, "flip"), Point(14, 5, 4, 30, 0.48, 0.479, 9, "flip")),
    runs=500,
    seconds=1.5,
)


def report(*verdicts, controls=(CONTROL,)):
    return Report(1, verdicts, controls, ("kornia",), 600, 2.0)


def schema():
    return json.loads(files("ransac_fix.report").joinpath("schemas/audit.json").read_text())


def test_the_published_schema_is_that_of_the_model():
    assert schema() == json.loads(json.dumps(msgspec.json.schema(Report)))


def test_json_follows_the_schema():
    unmeasured = Verdict("pcl", "-", None, "not measured", "not installed")
    document = json.loads(verdicts_json(report(VERDICT, unmeasured)))
    jsonschema.validate(document, schema())
    verdict = document["verdicts"][0]
    assert document["schema_version"] == 1
    assert {"n", "n_inliers", "sample_size", "trials", "u"} <= set(verdict["points"][0])
    assert verdict["stopping_law"]["assumed"] == "approximate"
    broken = {**document, "verdicts": [{**verdict, "verdict": "perhaps"}]}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, schema())


@pytest.mark.parametrize("width", [80, 100, 200])
def test_text_fits_the_terminal_and_shows_the_evidence(width):
    console = Console(width=width, record=True, file=io.StringIO())
    print_verdicts(report(VERDICT), console)
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= min(width, 100)
    assert "undersamples  findHomography(RANSAC)" in text
    # u / -ln(1 - (5/14)^4) and u / -ln(1 - C(5,4)/C(14,4)), the better point of the two.
    assert f"{1.3703 / -math.log1p(-((5 / 14) ** 4)):.2f}" in text
    assert f"{1.3703 / -math.log1p(-5 / 1001):.2f}" in text
    assert "by default: s = 0.995, at most 2,000 (checked by running)" in text
    assert "1 undersamples; 1 of 1 controls identified; 600 library runs in 2 s" in text
    assert "0.4800" not in text
    assert "not the success rate" in text
    assert "not installed: kornia" in text


def test_every_point_on_request():
    console = Console(width=100, record=True, file=io.StringIO())
    print_verdicts(report(VERDICT), console, every_point=True)
    assert "0.4800" in console.export_text()


@pytest.mark.parametrize(
    ("result", "code"),
    [
        (report(VERDICT), 1),
        (report(Verdict("a", "b", "1", "exact", "")), 0),
        (report(Verdict("a", "b", "1", "oversamples", "")), 0),
        (report(Verdict("a", "b", "1", "not measured", "")), 2),
        (report(), 2),
        (report(VERDICT, controls=(Control("c", "x", "y", False, 1),)), 2),
        (report(VERDICT, Verdict("a", "b", "1", "not measured", "")), 1),
    ],
)
def test_exit_codes(monkeypatch, result, code):
    monkeypatch.setattr(session, "audit", lambda options, progress: result)
    run = CliRunner().invoke(audit_command.command, ["--output-format", "json"])
    assert run.exit_code == code, run.output
    jsonschema.validate(json.loads(run.output), schema())


def test_an_unknown_system_is_one_line_and_exit_code_2(capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["audit", "opencvv"])
    assert exit_info.value.code == 2
    error = capsys.readouterr().err
    assert "unknown system 'opencvv'" in error
    assert "Traceback" not in error


def test_a_system_without_a_probe_names_those_that_have_one(capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["audit", "orb-slam3"])
    assert exit_info.value.code == 2
    assert "there is no probe for orb-slam3" in capsys.readouterr().err


def test_distribution_and_import_names_are_understood():
    for name in ("opencv", "cv2", "opencv-python-headless"):
        assert list(session._chosen((name,))) == ["opencv"]
    assert list(session._chosen(("sklearn", "kornia"))) == ["scikit-learn", "kornia"]
