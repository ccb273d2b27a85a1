"""Every format that findings are written in."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.errors import RansacFixError
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
    for rule in document["runs"][0]["tool"]["driver"]["rules"]:
        assert "\n## What it does\n" in rule["help"]["markdown"]
        assert "``" not in rule["help"]["markdown"].replace("```", "")
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


EVIL = """# ransac <script>alert(1)</script> |
import math
def trials(n_inliers, n, k, s):
    return math.log(1 - s) / math.log(1 - ({name} / n) ** k)
"""
NAME = "n_inliers['<img src=x onerror=alert(1)>|`](x)\x01'.count('&')]"


def evil(folder: Path) -> Path:
    path = folder / "<b>&amp;|`x`.py"
    path.write_text(EVIL.format(name=NAME.replace("\x01", "\\x01")))
    return path


def test_html_escapes_all_that_is_scanned(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = evil(tmp_path)
    page = run(path.name, "--output-format", "html")
    assert "<script>alert" not in page
    assert "<img" not in page
    assert "<b>" not in page
    assert "&lt;img src=x onerror=alert(1)&gt;" in page
    assert "&lt;b&gt;&amp;amp;|`x`.py" in page
    assert "http" not in page.replace("http-equiv", "")  # nothing is fetched
    # Well formed: every element that is opened is closed.
    stack: list[str] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag not in ("meta", "br"):
                stack.append(tag)

        def handle_endtag(self, tag):
            assert stack.pop() == tag

    Reader().feed(page)
    assert not stack


def test_html_tells_fixes_errors_and_what_was_set_aside(project):
    page = run(".", "--output-format", "html")
    assert "Unsafe fix: draw distinct samples, and use the probability" in page
    assert "measured: it is 100% fine" in page
    assert "Not read" in page
    assert page.count("<article>") == 2
    (project / "a b.py").unlink()
    (project / "c.py").unlink()
    assert "Nothing found" in run(".", "--output-format", "html", code=0)


def test_junit(project):
    suite = ElementTree.fromstring(run(".", "--output-format", "junit"))
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")
    assert (suite.get("errors"), suite.get("skipped")) == ("1", "1")
    failed, skipped, error = suite
    assert (failed.get("file"), failed.get("line"), failed.get("name")) == (
        "a b.py",
        "7",
        "RFX003 line 7",
    )
    assert failed[0].tag == "failure"
    assert skipped[0].get("message") == "measured: it is 100% fine"
    assert error.get("file") == "broken.py"
    for path in project.glob("*.py"):
        path.unlink()
    suite = ElementTree.fromstring(run(".", "--output-format", "junit", code=0))
    assert (suite.get("tests"), suite.get("failures"), len(suite)) == ("1", "0", 1)


def test_junit_holds_what_xml_cannot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = evil(tmp_path)
    path.write_text(EVIL.format(name=NAME))
    ElementTree.fromstring(run(path.name, "--output-format", "junit"))


def test_gitlab(project):
    (entry,) = json.loads(run(str(project), "--output-format", "gitlab"))
    assert entry["check_name"] == "RFX003"
    assert entry["severity"] == "major"
    assert entry["location"] == {"path": "a b.py", "lines": {"begin": 7, "end": 7}}
    assert entry["fingerprint"]


def test_markdown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = evil(tmp_path)
    text = run(path.name, "--output-format", "markdown")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert len(rows) == 3
    assert all(len(re.findall(r"(?<!\\)\|", row)) == 6 for row in rows)
    assert r"\<b\>&amp;\|\`x\`.py:4" in rows[2]


@pytest.mark.parametrize("name", ["full", "concise", "json", "json-lines", "markdown", "html"])
def test_a_clean_scan_can_be_written_in_every_format(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert run(".", "--output-format", name, code=0) or name == "json-lines"


def test_a_file_that_cannot_be_written_is_an_error(project):
    with pytest.raises(RansacFixError, match="cannot write no/such/file: No such file"):
        CliRunner().invoke(
            cli,
            ["scan", "--jobs", "1", ".", "--output", "html:no/such/file"],
            catch_exceptions=False,
        )


@pytest.mark.parametrize("value", ["sarif", "xml:out", "json:"])
def test_a_wrong_output_is_an_error(project, value):
    run(".", "--output", value, code=2)
