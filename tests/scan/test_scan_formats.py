"""GitHub annotations and SARIF."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.scan.rules import all_rules

RULE = """import math
import numpy as np

def ransac_trials(n_inliers, n_samples, k, s):
    sample = [np.random.choice(n_samples, k) for _ in range(9)]
    w = n_inliers / n_samples
    return math.log(1 - s) / math.log(1 - w**k){comment}
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a b.py").write_text(RULE.format(comment=""))
    (tmp_path / "c.py").write_text(
        RULE.format(comment="  # ransac-fix: ignore[RFX003] -- measured: it is 100% fine")
    )
    (tmp_path / "broken.py").write_text("def ransac(:\n    log(1 - w**k)\n")
    return tmp_path


def run(*args: str, code: int = 1) -> str:
    result = CliRunner().invoke(cli, ["scan", "--jobs", "1", *args])
    assert result.exit_code == code, result.output
    return result.output


def test_github_annotations(project):
    annotation, unread = run(".", "--output-format", "github").splitlines()
    assert annotation.startswith(
        "::error title=ransac-fix (RFX003),file=a b.py,line=7,endLine=7,col=12,endColumn=48::"
    )
    assert unread.startswith("::warning title=ransac-fix (RFX900),file=broken.py,line=1::")


def test_sarif(project):
    document = json.loads(run(".", "--output-format", "sarif"))
    assert document["version"] == "2.1.0"
    (scan,) = document["runs"]
    assert [rule["id"] for rule in scan["tool"]["driver"]["rules"]] == [
        rule.code for rule in all_rules()
    ]
    found, suppressed = scan["results"]
    place = found["locations"][0]["physicalLocation"]
    assert place["artifactLocation"] == {"uri": "a%20b.py", "uriBaseId": "ROOT"}
    assert place["region"] == {"startLine": 7, "startColumn": 12, "endLine": 7, "endColumn": 48}
    assert scan["tool"]["driver"]["rules"][found["ruleIndex"]]["id"] == "RFX003"
    assert found["relatedLocations"][0]["physicalLocation"]["region"]["startLine"] == 5
    (fix,) = found["fixes"]
    (change,) = fix["artifactChanges"]
    # The sampler, the function, the power, and the ratio that nothing else uses.
    assert len(change["replacements"]) == 4
    assert "suppressions" not in found
    assert suppressed["suppressions"][0]["justification"] == "measured: it is 100% fine"
    (notification,) = scan["invocations"][0]["toolExecutionNotifications"]
    assert notification["descriptor"]["id"] == "RFX900"


def test_a_fingerprint_does_not_depend_on_the_line(project):
    def fingerprints() -> list[str]:
        results = json.loads(run(".", "--output-format", "sarif"))["runs"][0]["results"]
        return [one["partialFingerprints"]["expression/v1"] for one in results]

    before = fingerprints()
    path = project / "a b.py"
    path.write_text("# moved\n\n" + path.read_text())
    assert fingerprints() == before
    path.write_text(path.read_text() + path.read_text().replace("ransac_trials", "again"))
    after = fingerprints()
    assert len(set(after)) == 3
    assert before[0] in after


def test_more_formats_into_files(project):
    run(".", "--output", "sarif:out.sarif", "--output", "json:out.json")
    assert json.loads(Path("out.sarif").read_text())["version"] == "2.1.0"
    assert json.loads(Path("out.json").read_text())["schema_version"] == 1


@pytest.mark.parametrize("value", ["sarif", "xml:out", "json:"])
def test_a_wrong_output_is_an_error(project, value):
    run(".", "--output", value, code=2)
