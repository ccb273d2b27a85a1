"""Releases that are not installed: requests, results kept, bisection, and what is printed."""

import io
import json
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import msgspec
import pytest
from click.testing import CliRunner
from referencing import Registry
from referencing.jsonschema import DRAFT202012
from rich.console import Console

from ransac_fix.audit.host import NO_ANSWER
from ransac_fix.audit.model import Control, StoppingLaw, Verdict
from ransac_fix.audit.releases import matrix
from ransac_fix.audit.releases.bisect import bisect
from ransac_fix.audit.releases.matrix import (
    Asked,
    read_request,
)
from ransac_fix.audit.releases.model import Release, ReleaseReport, report_on
from ransac_fix.audit.releases.results import Results, key_of
from ransac_fix.cli import audit as audit_command
from ransac_fix.cli import main
from ransac_fix.report.releases_json import releases_json
from ransac_fix.report.releases_junit import releases_junit
from ransac_fix.report.releases_markdown import releases_markdown
from ransac_fix.report.releases_text import print_releases

CONTROL = Control("exact", "a; distinct", "a; distinct", True, 100)
LAW = StoppingLaw(
    "approximate", 4, 0, 1.0, (1.0, 1.0), "every trial", False, "ceil(ln(1-s)/ln(1-(I/n)^4))"
)


def verdict(judgement, name="fit", **changed):
    reason = "why it is so"
    return Verdict("kornia", name, None, judgement, reason, stopping_law=LAW, runs=10, **changed)


def release(version, *verdicts, **changed):
    one = Release(
        *("kornia", "kornia", version, "3.11.7", "kornia.whl", "ab" * 32),
        *(("numpy==2.2.0",), "0123456789ab", "2026-11-25", "", "", verdicts),
    )
    return replace(one, **changed)


REPORT = report_on(
    [
        release("0.10", verdict("exact")),
        release("0.9", verdict("undersamples"), remark="with numpy<2; with NumPy 2: crashed"),
        release("0.8", unmeasured="has no wheel for CPython 3.11"),
    ],
    (CONTROL,),
    12.3,
    ["kornia==0.9.1"],
)


# --- results -------------------------------------------------------------------------------


def test_a_reason_names_no_file_of_an_environment_that_is_gone():
    why = "ImportError: cannot import name 'a' from 'b'"
    broken = replace(verdict("not measured"), reason=f"{why} (/cache/environments-1/b.py)")
    assert matrix._first_reason(release("0.9", broken)) == why


def test_what_may_be_another_tomorrow_is_not_kept(tmp_path):
    results = Results(tmp_path)
    slow = replace(verdict("not measured"), reason=f"{NO_ANSWER} (60 s)")
    for number, one in enumerate(
        (release("1"), release("1", verdict("not measured")), release("1", verdict("exact"), slow))
    ):
        results.put(str(number), one)
        assert results.get(str(number)) is None
    results.put("good", release("1", verdict("exact")))
    assert results.get("good") == release("1", verdict("exact"))
    (tmp_path / "good.json").write_text("{half")
    assert results.get("good") is None


def test_the_key_covers_the_file_and_what_measured_it():
    base = release("1")
    keys = {
        key_of(one, "")
        for one in (
            base,
            replace(base, sha256="cd" * 32),
            replace(base, probe_version="1"),
            replace(base, python="3.12.0"),
            replace(base, version="2"),
        )
    }
    assert len(keys | {key_of(base, "quick")}) == 6
    assert key_of(base) == key_of(replace(base, measured_on="2030-01-01"))


# --- bisection -----------------------------------------------------------------------------


def history(judgements):
    """Measure releases 0, 1, ... that have these verdicts; None for one that cannot be built."""
    tried = []

    def measure(version):
        tried.append(int(version))
        judgement = judgements[int(version)]
        return release(version, *([] if judgement is None else [verdict(judgement)]))

    found = bisect([str(number) for number in range(len(judgements))], measure)
    assert sorted(tried) == [int(one.version) for one in found]
    return tried, report_on(found, (CONTROL,), 1.0).changes


def test_a_change_is_found_in_few_measurements():
    for at in range(1, 64):
        tried, found = history(["undersamples"] * at + ["exact"] * (64 - at))
        assert [(one.before, one.after) for one in found] == [(str(at - 1), str(at))]
        assert len(tried) <= 8


def test_each_change_of_a_history_that_goes_back_and_forth_is_narrowed_down():
    judgements = ["undersamples"] * 20 + ["other rule"] * 9 + ["undersamples"] * 11 + ["exact"] * 4
    tried, found = history(judgements)
    assert [(one.before, one.after) for one in found if one.verdict_after == "exact"]
    for one in found:
        assert int(one.after) == int(one.before) + 1
        assert judgements[int(one.before)] != judgements[int(one.after)]
    assert len(tried) < len(judgements)


def test_releases_that_cannot_be_measured_are_passed_over():
    judgements = [None, "undersamples", None, None, "exact", "not measured", None]
    tried, found = history(judgements)
    assert [(one.before, one.after) for one in found] == [("1", "4")]
    assert sorted(tried) == list(range(7))


def test_nothing_measurable_ends():
    assert history([None, None]) == ([0, 1], ())
    assert history([]) == ([], ())


def test_each_entry_point_is_searched():
    def measure(version):
        number = int(version)
        names = [("a", 5), ("b", 11), *([("new", 9)] if number >= 8 else [])]
        return release(
            version,
            *(verdict("exact" if number >= at else "undersamples", name) for name, at in names),
        )

    found = bisect([str(number) for number in range(16)], measure)
    changes = report_on(found, (CONTROL,), 1.0).changes
    assert {(one.entry_point, one.after) for one in changes} >= {("a", "5"), ("b", "11")}


def test_an_entry_point_that_was_renamed_is_followed_from_where_it_appears():
    """As in pycolmap 3.11: the new name is not in the oldest release, the old not in the newest."""

    def measure(version):
        number = int(version)
        judgement = "exact" if number >= 21 else "undersamples"
        return release(version, verdict(judgement, "old" if number < 10 else "new"))

    found = bisect([str(number) for number in range(64)], measure)
    (change,) = report_on(found, (CONTROL,), 1.0).changes
    assert (change.entry_point, change.before, change.after) == ("new", "20", "21")
    assert len(found) <= 14


# --- what is asked -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("kornia==0.8.2,0.8.3, 0.9.0", Asked("kornia", "kornia", ("0.8.2", "0.8.3", "0.9.0"))),
        ("kornia", Asked("kornia", "kornia")),
        ("kornia>=0.8,<0.9", Asked("kornia", "kornia", (), "<0.9,>=0.8")),
        ("colmap==3.12.0", Asked("colmap", "pycolmap", ("3.12.0",))),
        ("opencv_python==4.8.0.76", Asked("opencv", "opencv-python", ("4.8.0.76",))),
        ("cv2", Asked("opencv", "opencv-python-headless")),
    ],
)
def test_requests(text, asked):
    assert read_request(text) == asked


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kornia=0.8", "write for example kornia==0.8.2,0.9.0"),
        ("kornia==0.8,newest", "'newest' is not a version"),
        ("kornia @ file:///wheels/kornia.whl", "only a name and versions are read"),
        ("kornia[dev]>=0.8", "only a name and versions are read"),
        ("kornia>=0.8; python_version<'4'", "only a name and versions are read"),
        ("kornja", "unknown system 'kornja'"),
        ("vsac", "there is no probe for vsac"),
    ],
)
def test_a_request_that_cannot_be_read_is_one_line(text, message, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["audit", "--matrix", text])
    assert exit_info.value.code == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize("more", [[], ["--keep-environments"]])
def test_a_cache_that_cannot_be_is_one_line(tmp_path, monkeypatch, capsys, more):
    monkeypatch.setattr(matrix, "Packages", lambda *_: None)
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(SystemExit) as exit_info:
        main(["audit", "--matrix", "kornia==0.9.0", "--cache-dir", str(file / "cache"), *more])
    assert exit_info.value.code == 2
    error = capsys.readouterr().err
    assert "cannot be used as cache folder" in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["--matrix", "kornia", "--bisect", "kornia"],
        ["--matrix", "kornia", "opencv"],
        ["--bisect", "kornia", "--patched"],
        ["--cache-dir", "somewhere"],
        ["--keep-environments"],
    ],
)
def test_options_that_do_not_belong_together(arguments):
    assert CliRunner().invoke(audit_command.command, arguments).exit_code == 2


# --- what is printed -----------------------------------------------------------------------


def schema(name="releases"):
    return json.loads(files("ransac_fix.report").joinpath(f"schemas/{name}.json").read_text())


def validate(document):
    """Check against the published schema, which refers to that of an audit."""
    registry = Registry().with_resource("audit.json", DRAFT202012.create_resource(schema("audit")))
    jsonschema.Draft202012Validator(schema(), registry=registry).validate(document)


def test_the_published_schema_is_that_of_the_model():
    shared = schema("audit")["$defs"]
    own = msgspec.json.schema(ReleaseReport)
    own["$defs"] = {name: one for name, one in own["$defs"].items() if name not in shared}
    text = json.dumps(own)
    for name in shared:
        text = text.replace(f'"#/$defs/{name}"', f'"audit.json#/$defs/{name}"')
    assert schema() == json.loads(text)


def test_json_follows_the_schema():
    document = json.loads(releases_json(REPORT))
    validate(document)
    document["releases"][1]["verdicts"][0]["verdict"] = "perhaps"
    with pytest.raises(jsonschema.ValidationError):
        validate(document)


@pytest.mark.parametrize("width", [80, 200])
def test_text(width):
    console = Console(width=width, record=True, file=io.StringIO())
    print_releases(REPORT, console)
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= min(width, 100)
    lines = text.splitlines()
    # The oldest release first, and 0.10 after 0.9.
    heads = [line.split("  ")[0] for line in lines if line.startswith("kornia")]
    assert heads == ["kornia 0.8", "kornia 0.9", "kornia 0.10"]
    assert "  not measured  has no wheel for CPython 3.11" in lines
    assert "  undersamples  fit  ceil(ln(1-s)/ln(1-(I/n)^4))" in lines
    assert "kornia 0.9  Python 3.11.7, with numpy<2; with NumPy 2: crashed" in lines
    assert "fit: undersamples in 0.9, exact in 0.10" in lines
    assert "2 of 3 releases measured; 1 passed over" in " ".join(lines)


def test_markdown():
    text = releases_markdown(REPORT)
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 5
    assert "| 0.9 | fit | ❌ undersamples | `ceil(ln(1-s)/ln(1-(I/n)^4))` |" in rows
    assert "- fit: undersamples in 0.9, exact in 0.10" in text


def test_junit():
    suites = ElementTree.fromstring(releases_junit(REPORT))
    found = {suite.get("name"): suite for suite in suites}
    assert list(found) == ["kornia 0.8", "kornia 0.9", "kornia 0.10", "controls"]
    assert found["kornia 0.9"].get("failures") == "1"
    assert found["kornia 0.8"].get("skipped") == "1"
    assert "no wheel" in found["kornia 0.8"].find("testcase/skipped").get("message")
    assert found["kornia 0.10"].get("failures") == "0"


EXPECTED = """
[[expect]]
system = "kornia"
entry_point = "fit"
verdict = "undersamples"
reason = "we cannot upgrade everywhere"
releases = "{releases}"
"""


@pytest.mark.parametrize(
    ("releases", "code", "said"),
    [
        ("<0.10", 0, ""),
        ("", 1, "unexpected: kornia 0.10 fit: exact, not undersamples as expected"),
        (">=0.11", 1, "unexpected: kornia 0.9 fit: undersamples: why it is so"),
        (">=0.11", 1, "expected but not seen: kornia>=0.11 fit: undersamples"),
    ],
)
def test_one_expectations_file_serves_every_release(monkeypatch, tmp_path, releases, code, said):
    report = report_on(
        [
            release(number, replace(verdict(judgement), version=number))
            for number, judgement in (("0.9", "undersamples"), ("0.10", "exact"))
        ],
        (CONTROL,),
        1.0,
    )
    monkeypatch.setattr(matrix, "measure_releases", lambda requests, options, progress: report)
    file, markdown, junit = (tmp_path / name for name in ("audit.toml", "a.md", "a.xml"))
    file.write_text(EXPECTED.format(releases=releases))
    arguments = ["--matrix", "kornia", "--cache-dir", str(tmp_path), "--expect", str(file)]
    arguments += ["--output", f"markdown:{markdown}", "--output", f"junit:{junit}"]
    done = CliRunner().invoke(audit_command.command, arguments)
    assert done.exit_code == code, done.output
    assert said in done.stderr
    failures = ElementTree.fromstring(junit.read_text()).findall(".//failure")
    told = [one for one in done.stderr.splitlines() if not one.startswith("everything")]
    assert len(failures) == len(told)
    for line, failure in zip(told, failures, strict=True):
        name, _, what = line.removeprefix("unexpected: ").rpartition(" fit: ")
        assert failure.get("message").endswith(what)
        assert f"- ❌ **{name.removeprefix('expected but not seen: ')} fit" in (
            markdown.read_text().replace("\\", "")
        )
    assert ("Everything is as expected" in markdown.read_text()) == (code == 0)


@pytest.mark.parametrize("option", ["--matrix", "--bisect"])
@pytest.mark.parametrize(
    ("report", "code"),
    [
        (REPORT, 1),
        (report_on([release("1", verdict("exact"))], (CONTROL,), 1), 0),
        (report_on([release("1", unmeasured="why")], (CONTROL,), 1), 2),
        (report_on(REPORT.releases, (replace(CONTROL, passed=False),), 1), 2),
    ],
)
def test_exit_codes(monkeypatch, tmp_path, option, report, code):
    name = {"--matrix": "measure_releases", "--bisect": "find_changes"}[option]
    monkeypatch.setattr(matrix, name, lambda requests, options, progress: report)
    arguments = [option, "kornia", "--cache-dir", str(tmp_path), "--output-format", "json"]
    done = CliRunner().invoke(audit_command.command, arguments)
    assert done.exit_code == code, done.output
    validate(json.loads(done.output))


def test_without_controls_there_is_no_verdict():
    report = report_on(REPORT.releases, (replace(CONTROL, passed=False),), 1)
    assert not any(one.verdicts for one in report.releases)
    assert report.changes == ()
    assert "a control was misidentified (exact)" in report.releases[0].unmeasured


def test_where_results_are_kept_by_default(monkeypatch):
    from ransac_fix.folders import cache_folder

    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    if sys.platform != "win32":
        assert cache_folder() == Path("/somewhere/ransac-fix")
