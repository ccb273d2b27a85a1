"""The command: formats, names, exit codes."""

import io
import json
import math
import re
import shlex
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import msgspec
import pytest
from click.testing import CliRunner
from rich.console import Console

from ransac_fix.audit import session
from ransac_fix.audit.examination import fixed_in_release
from ransac_fix.audit.expectations import load_expectations
from ransac_fix.audit.judge import advise
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
from ransac_fix.cli.audit import show
from ransac_fix.errors import RansacFixError
from ransac_fix.report.verdicts_json import verdicts_json
from ransac_fix.report.verdicts_junit import verdicts_junit
from ransac_fix.report.verdicts_markdown import verdicts_markdown
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


def test_what_a_library_wrote_to_a_terminal_does_not_break_the_xml():
    said = "crashed: \x1b[31mno memory\x1b[0m\x00"
    found = verdicts_junit(report(replace(VERDICT, verdict="not measured", reason=said)))
    (skipped,) = ElementTree.fromstring(found).iter("skipped")
    assert "no memory" in skipped.get("message")


def test_a_probe_whose_package_is_gone_is_none(monkeypatch):
    stale = EntryPoint("acme", "no_such_package_of_acme.probe", session.GROUP)
    known, files_before = session.entry_points(group=session.GROUP), session.probe_files()
    monkeypatch.setattr(session, "entry_points", lambda group: [stale, *known])
    assert session.probe_files() == files_before


def test_text_says_that_no_control_was_measured():
    console = Console(width=100, record=True, file=io.StringIO())
    absent = Verdict("kornia", "-", None, "not measured", "not installed")
    print_verdicts(report(absent, controls=()), console)
    assert "1 not measured; no controls, as there was nothing to measure;" in console.export_text()


@pytest.mark.parametrize(
    ("sampler", "strata", "chance"),
    [
        # (5)_4 / 14^4: an index may come twice.
        ({"drawn": "replacement"}, (), 5 * 4 * 3 * 2 / 14**4),
        # Two of 3 among 6, two of 2 among 8.
        ({"drawn": "stratified", "quota": (2, 2)}, ((3, 6), (2, 8)), 3 / 15 / 28),
        # No law is known: as if drawn distinct.
        ({"drawn": "not uniform", "sample_size": 3}, (), 5 / 1001),
    ],
)
def test_the_exact_column_is_that_of_the_sampler_measured(sampler, strata, chance):
    console = Console(width=100, record=True, file=io.StringIO())
    points = tuple(replace(point, strata=strata) for point in VERDICT.points)
    drawn = replace(VERDICT.sampler_law, **sampler)
    print_verdicts(report(replace(VERDICT, sampler_law=drawn, points=points)), console)
    assert f" {1.3703 / -math.log1p(-chance):.2f}" in console.export_text()


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
        assert list(session.chosen_probes((name,))) == ["opencv"]
    assert list(session.chosen_probes(("sklearn", "kornia"))) == ["scikit-learn", "kornia"]


def test_markdown_is_one_table_with_reasons_below():
    text = verdicts_markdown(report(VERDICT, Verdict("kornia", "RANSAC", "0.9.0", "exact", "why")))
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 4
    assert all(row.count(" | ") == 3 for row in rows)
    assert "`round(ln(1-s)/ln(1-(I/n)^4))`" in rows[2]
    assert "**opencv findHomography(RANSAC)**: assumes P = (I/n)^4, but draws" in text
    assert "**kornia" not in text


def test_markdown_escapes_what_a_library_says():
    crash = Verdict("a", "b", None, "not measured", "crashed: <b>|`x`_y_")
    assert r"\<b\>\|\`x\`\_y\_" in verdicts_markdown(report(crash))


def test_junit_counts_failures_skips_and_errors():
    result = report(
        VERDICT,
        Verdict("a", "b", None, "not measured", "crashed & <burnt>"),
        Verdict("a", "c", None, "oversamples", "slow"),
        controls=(CONTROL, Control("c", "x", "y", False, 1)),
    )
    suite = ElementTree.fromstring(verdicts_junit(result))
    assert suite.attrib["tests"] == "5"
    assert (suite.attrib["failures"], suite.attrib["errors"], suite.attrib["skipped"]) == (
        "1",
        "1",
        "1",
    )
    assert len(suite.findall("testcase")) == 5
    assert suite.find("testcase/skipped").attrib["message"] == "crashed & <burnt>"
    assert "undersamples" in suite.find("testcase/failure").attrib["message"]


EXPECT = """
[[expect]]
system = "opencv"
entry_point = "{entry_point}"
verdict = "{verdict}"
reason = "waiting for upstream"
"""


@pytest.mark.parametrize(
    ("entry_point", "verdict", "code", "said"),
    [
        ("findHomography(RANSAC)", "undersamples", 0, ""),
        ("*", "undersamples", 0, ""),
        (
            "findHomography(RANSAC)",
            "exact",
            1,
            "unexpected: opencv findHomography(RANSAC): undersamples, not exact as expected: assum",
        ),
        (
            "findHomography(RHO)",
            "undersamples",
            1,
            "expected but not seen: opencv findHomography(RHO)",
        ),
    ],
)
def test_expectations_decide_what_fails(monkeypatch, tmp_path, entry_point, verdict, code, said):
    monkeypatch.setattr(session, "audit", lambda options, progress: report(VERDICT))
    file = tmp_path / "audit.toml"
    file.write_text(EXPECT.format(entry_point=entry_point, verdict=verdict))
    run = CliRunner().invoke(audit_command.command, ["--expect", str(file)])
    assert run.exit_code == code, run.output
    assert said in run.stderr


@pytest.mark.parametrize(
    ("entry_point", "said"),
    [
        ("findHomography(RANSAC)", "findHomography(RANSAC): exact, not undersamples as expected"),
        ("*", "expected but not seen: opencv *: undersamples"),
    ],
)
def test_a_library_that_was_made_exact_is_no_longer_as_expected(
    monkeypatch, tmp_path, entry_point, said
):
    """Upstream fixed it: the expectation can go."""
    fixed = replace(VERDICT, verdict="exact")
    monkeypatch.setattr(session, "audit", lambda options, progress: report(fixed))
    file = tmp_path / "audit.toml"
    file.write_text(EXPECT.format(entry_point=entry_point, verdict="undersamples"))
    run = CliRunner().invoke(audit_command.command, ["--expect", str(file)])
    assert run.exit_code == 1
    assert said in run.stderr


@pytest.mark.parametrize(
    ("expected", "code"), [("undersamples", 0), ("not measured", 1), ("other rule", 1)]
)
def test_one_expectation_for_all_entry_points(monkeypatch, tmp_path, expected, code):
    """What is better is no surprise; what fails and is not expected is."""
    better = [
        replace(VERDICT, entry_point=name, verdict=name)
        for name in ("exact", "oversamples", "not measured")
    ]
    monkeypatch.setattr(session, "audit", lambda options, progress: report(VERDICT, *better))
    file = tmp_path / "audit.toml"
    file.write_text(EXPECT.format(entry_point="*", verdict=expected))
    run = CliRunner().invoke(audit_command.command, ["--expect", str(file)])
    assert run.exit_code == code, run.stderr


def test_every_format_at_once_knows_what_was_expected(monkeypatch, tmp_path):
    other = replace(VERDICT, entry_point="findHomography(USAC)")
    monkeypatch.setattr(session, "audit", lambda options, progress: report(VERDICT, other))
    file = tmp_path / "audit.toml"
    listed = ("findHomography(RANSAC)", "undersamples"), ("gone", "exact")
    file.write_text("".join(EXPECT.format(entry_point=e, verdict=v) for e, v in listed))
    outputs = {name: tmp_path / f"out.{name}" for name in ("markdown", "junit", "json", "text")}
    arguments = [f"--output={name}:{path}" for name, path in outputs.items()]
    run = CliRunner().invoke(audit_command.command, ["--expect", str(file), *arguments])
    assert run.exit_code == 1
    assert outputs["text"].read_text() == run.stdout
    jsonschema.validate(json.loads(outputs["json"].read_text()), schema())
    suite = ElementTree.fromstring(outputs["junit"].read_text())
    failures = [case.get("name") for case in suite if case.find("failure") is not None]
    assert failures == ["findHomography(USAC)", "gone"]
    assert (suite.get("tests"), suite.get("failures")) == ("4", "2")
    markdown = outputs["markdown"].read_text()
    assert "- ❌ **opencv findHomography(USAC)**: undersamples: assumes" in markdown
    assert "- ❌ **opencv gone**: expected but not seen: exact" in markdown


def test_the_job_of_the_page_runs(monkeypatch, tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "audit.md").read_text("utf-8")
    (command,) = re.findall(r"- run: >\s+ransac-fix audit (.*?)\n      - uses", page, re.DOTALL)
    (expected,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    Path("audit.toml").write_text(expected)
    monkeypatch.setattr(session, "audit", lambda options, progress: report(VERDICT))
    arguments = shlex.split(command.replace("$GITHUB_STEP_SUMMARY", "summary.md"))
    run = CliRunner().invoke(audit_command.command, arguments)
    assert run.exit_code == 0, run.output
    assert "Everything is as expected" in Path("summary.md").read_text()
    assert {path.name for path in tmp_path.glob("audit.*")} == {
        *("audit.toml", "audit.xml", "audit.json")
    }


def test_markdown_says_that_all_is_as_expected(monkeypatch, tmp_path):
    monkeypatch.setattr(session, "audit", lambda options, progress: report(VERDICT))
    file = tmp_path / "audit.toml"
    file.write_text(EXPECT.format(entry_point="*", verdict="undersamples"))
    arguments = ["--expect", str(file), "--output-format", "markdown"]
    run = CliRunner().invoke(audit_command.command, arguments)
    assert run.exit_code == 0
    assert "✅ Everything is as expected." in run.stdout


@pytest.mark.parametrize("output", ["html:x.html", "markdown", "markdown:", "text:/no/such/x"])
def test_an_output_that_cannot_be_is_one_error(monkeypatch, output):
    monkeypatch.setattr(session, "audit", lambda options, progress: report(VERDICT))
    run = CliRunner().invoke(audit_command.command, ["--output", output])
    assert run.exit_code == 2
    assert "--output" in run.stderr
    assert "Traceback" not in run.output


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[[expect]]\nsystem = 'opencv'\n", "lacks entry_point"),
        (EXPECT.format(entry_point="x", verdict="fine"), "verdict must be one of"),
        ("[expect]\nsystem = 1\n", "must hold [[expect]] tables"),
        ("= nothing", "not TOML"),
        (EXPECT.format(entry_point="x", verdict="exact") + "until = 'later'\n", "has until"),
        (EXPECT.format(entry_point="x", verdict="exact") + "releases = '0.9'\n", "as in '>=0.8"),
    ],
)
def test_a_wrong_expectations_file_is_one_line(tmp_path, text, complaint):
    file = tmp_path / "audit.toml"
    file.write_text(text)
    with pytest.raises(RansacFixError, match=re.escape(complaint)) as error:
        load_expectations(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--patched", "--python", sys.executable], "leave out --python"),
        (["--n", "20"], "belong together"),
        (["--confidence", "0.9"], "needs --n"),
        (["--python", "/no/such/python"], "does not exist"),
    ],
)
def test_options_that_do_not_go_together(arguments, complaint):
    run = CliRunner().invoke(audit_command.command, arguments)
    assert run.exit_code == 2
    assert complaint in run.output


@pytest.mark.parametrize(
    ("system", "version", "entry_point", "fixed"),
    [
        ("kornia", "0.8.2", "RANSAC(homography)", "0.9.0"),
        ("colmap", "3.11.1", "estimate_homography_matrix", "3.12.0"),
        ("colmap", "4.2.1", "estimate_homography_matrix", None),
        ("colmap", None, "estimate_homography_matrix", None),
        ("opencv", "5.0.0.93", "findHomography(RANSAC)", None),
        ("somebody's own", "1.0", "fit", None),
    ],
)
def test_upgrading_is_advised_where_a_newer_release_was_measured(
    system, version, entry_point, fixed
):
    assert fixed_in_release(system, version, entry_point) == fixed
    advice = advise("undersamples", None, "max_trials", fixed)
    assert advice == (f"Fixed in {fixed}: upgrade." if fixed else "")


def test_no_line_of_a_file_ends_in_blanks(capsys):
    show(report(VERDICT), "text", every_point=False)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 10
    assert [line for line in lines if line != line.rstrip()] == []
