"""The baseline: what is known is not reported, wherever it moves to in its file."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.errors import RansacFixError
from ransac_fix.scan import scan_paths
from ransac_fix.scan.baseline import compare, write_baseline

RULE = """import math

def ransac_trials(n_inliers, n_samples, k, s):
    w = n_inliers / n_samples
    return math.log(1 - s) / math.log(1 - w**k)
"""


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "src" / "ransac.py"
    path.parent.mkdir()
    path.write_text(RULE)
    return path


def test_known_findings_are_not_reported(tmp_path, source):
    baseline = tmp_path / "known.json"
    updated = CliRunner().invoke(
        cli, ["baseline", "update", str(source), "--baseline", str(baseline)]
    )
    assert updated.output == f"{baseline}: 1 finding.\n"
    args = ["scan", str(source), "--baseline", str(baseline)]
    assert CliRunner().invoke(cli, args).exit_code == 0

    source.write_text(RULE.replace("1 - s", "1 - s / 2"))
    assert CliRunner().invoke(cli, args).exit_code == 1
    source.write_text(RULE.replace("1 - s", "1  -  s"))
    assert CliRunner().invoke(cli, args).exit_code == 0
    source.write_text(f"# moved\n\n{RULE}")
    assert CliRunner().invoke(cli, args).exit_code == 0
    source.write_text(RULE + RULE.replace("ransac_trials", "again"))
    again = CliRunner().invoke(cli, args)
    assert again.exit_code == 1
    assert "1 finding known to the baseline" in again.stderr

    source.write_text("")
    gone = CliRunner().invoke(cli, args)
    assert gone.exit_code == 0
    assert "1 more in it gone since" in gone.stderr


def test_paths_are_relative_to_the_baseline(tmp_path, source, monkeypatch):
    baseline = tmp_path / "known.json"
    assert write_baseline(scan_paths([source]).findings, baseline) == 1
    (entry,) = json.loads(baseline.read_text())["findings"]
    assert entry["path"] == "src/ransac.py"
    monkeypatch.chdir(source.parent)
    assert compare(scan_paths(["ransac.py"]), baseline, ["ransac.py"]).known == 1


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"schema_version": 9}', '{"schema_version": 1}', None]
)
def test_what_is_no_baseline_is_an_error(tmp_path, source, text):
    baseline = tmp_path / "known.json"
    if text is not None:
        baseline.write_text(text)
    with pytest.raises(RansacFixError, match="cannot read the baseline"):
        compare(scan_paths([source]), baseline, [source])


def test_of_files_that_were_not_scanned_nothing_is_said(tmp_path, source, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other = tmp_path / "src" / "other.py"
    other.write_text(RULE)
    update = ["baseline", "update", "src"]
    assert CliRunner().invoke(cli, update).output == "ransac-fix-baseline.json: 2 findings.\n"
    scan = ["scan", "--baseline", "ransac-fix-baseline.json"]
    said = CliRunner().invoke(cli, [*scan, "src/other.py"]).output
    assert said.startswith("1 finding known to the baseline.\n")
    other.unlink()
    said = CliRunner().invoke(cli, [*scan, "./src"]).output
    assert said.startswith("1 finding known to the baseline, 1 more in it gone since: ")


def test_no_baseline_is_written_without_a_named_file(tmp_path):
    broken, baseline = tmp_path / "broken.py", tmp_path / "known.json"
    broken.write_text("def ransac(:\n    log(1 - w**k)\n")
    with pytest.raises(RansacFixError, match="could not be scanned"):
        CliRunner().invoke(
            cli,
            ["baseline", "update", str(broken), "--baseline", str(baseline)],
            catch_exceptions=False,
        )
    assert not baseline.exists()
