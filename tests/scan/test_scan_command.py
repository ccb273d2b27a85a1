"""``ransac-fix scan`` as a user runs it."""

import json
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.scan import scan_paths

RULE = """import math

def ransac_trials(n_inliers, n_samples, k, s):
    w = n_inliers / n_samples
    return math.log(1 - s) / math.log(1 - w**k)
"""
CLEAN = "def ransac():\n    pass\n"
SCHEMA = json.loads((files("ransac_fix.report") / "schemas" / "scan.json").read_text())


def run(*args: object, code: int) -> str:
    result = CliRunner().invoke(cli, ["scan", "--jobs", "1", *map(str, args)])
    assert result.exit_code == code, result.output + str(result.exception)
    return result.output


@pytest.fixture
def rule(tmp_path: Path) -> Path:
    path = tmp_path / "ransac.py"
    path.write_text(RULE)
    return path


def test_exit_codes(tmp_path, rule):
    clean = tmp_path / "clean.py"
    clean.write_text(CLEAN)
    broken = tmp_path / "broken.py"
    broken.write_text("def ransac(:\n    log(1 - w**k)\n")
    run(clean, code=0)
    run(rule, code=1)
    run(rule, "--exit-zero", code=0)
    # A file that was not named does not fail the scan.
    assert "RFX900" in run(tmp_path, code=1)
    assert "RFX900" in run(broken, code=2)


def test_full_text(rule):
    text = run(rule, code=1)
    assert f"{rule}:5:12: RFX001 " in text
    assert "w**k" in text
    assert "inliers: n_inliers; samples: n_samples" in text
    assert text.endswith("1 finding in 1 of 1 file.\n")


def test_concise_text(rule):
    lines = run(rule, "--output-format", "concise", code=1).splitlines()
    assert len(lines) == 2
    assert lines[0].startswith(f"{rule}:5:12: RFX001 ")
    assert lines[0].endswith("[high]")


def test_json_follows_its_schema(tmp_path, rule):
    (tmp_path / "broken.py").write_text("def ransac(:\n    log(1 - w**k)\n")
    document = json.loads(run(tmp_path, "--output-format", "json", code=1))
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    (finding,) = document["findings"]
    assert finding["path"] == str(rule)
    assert (finding["start_line"], finding["start_column"]) == (5, 12)
    assert (finding["end_line"], finding["end_column"]) == (5, 48)
    assert RULE.splitlines()[4][11:47] == finding["expression"]
    assert finding["roles"]["sample_size"] == "k"
    (error,) = document["errors"]
    assert (error["code"], error["line"], error["named"]) == ("RFX900", 1, False)


def test_json_lines(rule):
    (line,) = run(rule, "--output-format", "json-lines", code=1).splitlines()
    assert json.loads(line)["code"] == "RFX001"


def test_select_and_ignore(rule):
    run(rule, "--select", "RFX002", code=0)
    run(rule, "--ignore", "RFX", code=0)
    run(rule, "--select", "RFX00", code=1)
    result = CliRunner().invoke(cli, ["scan", str(rule), "--select", "E501"])
    assert "no rule 'E501'" in str(result.exception)


def test_the_configuration_is_the_closest_and_isolated_ignores_it(tmp_path, rule):
    (tmp_path / "pyproject.toml").write_text('[tool.ransac-fix]\nignore = ["RFX001"]\n')
    run(rule, code=0)
    run(rule, "--isolated", code=1)
    run(rule, "--ignore", "RFX002", code=1)
    (tmp_path / "ransac-fix.toml").write_text('extend-exclude = ["other"]\n')
    run(rule, code=1)


@pytest.mark.parametrize(
    "text",
    [
        *("[tool.ransac-fix]\nselects = []\n", "[tool.ransac-fix]\nselect = 3\n"),
        *("[tool.ransac-fix]\nselect = ['XX']\n", "[tool.ransac-fix\n"),
    ],
)
def test_a_wrong_configuration_is_an_error(tmp_path, rule, text):
    (tmp_path / "pyproject.toml").write_text(text)
    result = subprocess.run(
        [sys.executable, "-m", "ransac_fix", "scan", rule],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr.startswith("ransac-fix: error: cannot ")
    assert str(tmp_path / "pyproject.toml") in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("name", ["nowhere.py", "notes.txt"])
def test_a_wrong_path_is_an_error(tmp_path, name):
    (tmp_path / "notes.txt").write_text("")
    result = subprocess.run(
        [sys.executable, "-m", "ransac_fix", "scan", tmp_path / name],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr.startswith("ransac-fix: error: cannot scan ")
    assert "Traceback" not in result.stderr


def test_workers_find_the_same(tmp_path, rule):
    for number in range(250):
        (tmp_path / f"m{number}.py").write_text(CLEAN)
    assert scan_paths([tmp_path], jobs=2) == scan_paths([tmp_path], jobs=1)


def test_scanned_code_is_never_run(tmp_path):
    marker = tmp_path / "ran"
    source = f"open({str(marker)!r}, 'w').close()  # ransac\n{RULE}"
    (tmp_path / "evil.py").write_text(source)
    run(tmp_path / "evil.py", code=1)
    assert not marker.exists()


def test_rules_are_listed_and_explained():
    listed = CliRunner().invoke(cli, ["rules"]).output
    assert listed.startswith("RFX001  approximate-stopping-rule")
    explained = CliRunner().invoke(cli, ["rule", "RFX003"]).output
    assert explained.startswith("# RFX003 sample-with-replacement\n")
    assert "Why is this bad" in explained


SUPPRESSED = RULE.replace("w**k)\n", "w**k)  # ransac-fix: ignore[RFX001] -- as published\n")


def test_a_comment_sets_a_finding_aside(rule):
    rule.write_text(SUPPRESSED)
    assert "1 set aside by comments" in run(rule, code=0)
    result = scan_paths([rule])
    assert [one.suppression for one in result.suppressed] == ["as published"]


@pytest.mark.parametrize(
    ("comment", "code"),
    [
        ("# noqa: RFX001", 0),
        ("# noqa: E501,RFX001", 0),
        ("# ransac-fix: ignore", 0),
        ("# noqa", 1),
        ("# ransac-fix: ignore[RFX003]", 1),
        ("# ransac-fix: ignore[rfx001]", 0),
        ("# ransac-fix: ignore[approximate-trial-budget]", 1),
        ("# ransac-fix: ignore[RFX001 -- no bracket", 1),
    ],
)
def test_comments_that_set_aside(rule, comment, code):
    rule.write_text(SUPPRESSED.replace("# ransac-fix: ignore[RFX001] -- as published", comment))
    run(rule, "--select", "RFX001", code=code)


@pytest.mark.parametrize("codes", ["RFX999", "FOO", "approximate-stopping-rule"])
def test_a_comment_for_no_rule_is_reported(rule, codes):
    rule.write_text(SUPPRESSED.replace("RFX001", codes))
    text = run(rule, "--output-format", "concise", code=1)
    assert f"RFX901 nothing on this line breaks {codes.upper()}: " in text
    assert "RFX001" in text


def test_a_comment_in_a_string_sets_nothing_aside(rule):
    rule.write_text(RULE.replace("w**k)\n", "w**k), '# ransac-fix: ignore'\n"))
    run(rule, code=1)


def test_what_a_fix_leaves_is_reported_where_it_stands_now(tmp_path):
    loop = tmp_path / "loop.py"
    loop.write_text(
        "import math\n"
        "def ransac(points, fit, s):\n"
        "    trials, best, t = 1000, 0, 0\n"
        "    while t < trials:\n"
        "        inliers = fit(points)\n"
        "        if len(inliers) > best:\n"
        "            best = len(inliers)\n"
        "            trials = math.log(1 - s) / math.log(1 - (best / len(points)) ** 3)\n"
        "        t += 1\n"
    )
    text = run(loop, "--fix", "--output-format", "concise", code=1)
    line = (
        loop.read_text()
        .splitlines()
        .index(
            "            trials = math.log(1 - s) / math.log("
            "1 - _all_inlier_probability(best, len(points), 3))"
        )
    )
    assert f"{loop}:{line + 1}:22: RFX005 " in text
    assert text.endswith("1 finding in 1 of 1 file.\n")


def test_a_diff_does_not_hide_that_a_file_could_not_be_read(tmp_path, rule):
    broken = tmp_path / "broken.py"
    broken.write_text("def ransac(:\n    log(1 - w**k)\n")
    assert "RFX900" in run(broken, "--diff", code=2)
    report = tmp_path / "report.json"
    run(rule, "--diff", "--output", f"json:{report}", code=1)
    assert [one["code"] for one in json.loads(report.read_text())["findings"]] == ["RFX001"]


def test_a_diff_says_what_it_does_not_show(rule):
    rule.write_text(RULE.replace("w = n_inliers / n_samples", "w = ratio()"))
    assert run(rule, "--diff", code=0) == "1 without a fix: leave out --diff to see them.\n"
    rule.write_text(
        RULE.replace("(n_inliers, n_samples, k, s)", "(w, k, s)").replace(
            "    w = n_inliers / n_samples\n", ""
        )
        + "\ndef run(n_inliers, n_samples):\n"
        "    return ransac_trials(n_inliers / n_samples, 3, 0.99)\n"
    )
    assert run(rule, "--diff", code=0) == "--unsafe-fixes would fix 1 more.\n"


def test_options_that_cannot_be_are_errors(rule):
    assert "there is no program" in run(rule, "--python", "/no/such/python", code=2)
    assert "--jobs 0: " in run(rule, "--jobs", "0", code=2)
