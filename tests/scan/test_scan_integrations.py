"""The hooks for pre-commit, the GitHub Action, and the schema of the configuration."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner
from jsonschema import Draft202012Validator

from ransac_fix.cli import cli
from ransac_fix.scan.configuration import configuration_schema

ROOT = Path(__file__).parents[2]
RULE = """import math
def ransac(n_inliers, n_samples, k, s):
    return math.log(1 - s) / math.log(1 - (n_inliers / n_samples) ** k)
"""


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fit.py").write_text(RULE)
    return tmp_path


def hook(identifier: str) -> list[str]:
    hooks = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    (found,) = [one for one in hooks if one["id"] == identifier]
    assert found["language"] == "python"
    assert found["types_or"] == ["python", "pyi", "jupyter", "c", "c++", "cuda"]
    command, *arguments = shlex.split(found["entry"])
    assert command == "ransac-fix"
    return [*arguments, "fit.py"]


def test_the_hook_fails_on_a_finding(project):
    assert CliRunner().invoke(cli, hook("ransac-fix")).exit_code == 1
    (project / "fit.py").write_text("N = 100\n")
    assert CliRunner().invoke(cli, hook("ransac-fix")).exit_code == 0


def test_the_fixing_hook_fails_when_it_changed_a_file_and_then_no_more(project):
    assert CliRunner().invoke(cli, hook("ransac-fix-fix")).exit_code == 1
    assert "**" not in (project / "fit.py").read_text().partition("def ransac")[2]
    assert CliRunner().invoke(cli, hook("ransac-fix-fix")).exit_code == 0


def run_action(project: Path, **inputs: str) -> tuple[int, str, dict[str, str], str]:
    (project / "temp").mkdir(exist_ok=True)
    commands = project / "bin"
    commands.mkdir(exist_ok=True)
    launcher = commands / "ransac-fix"
    launcher.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m ransac_fix "$@"\n')
    launcher.chmod(0o755)
    bash = shutil.which("bash")
    assert bash is not None
    done = subprocess.run(
        [bash, ROOT / "action" / "scan.sh"],
        cwd=project,
        capture_output=True,
        text=True,
        env={
            **os.environ,
            "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}",
            "RUNNER_TEMP": str(project / "temp"),
            "GITHUB_OUTPUT": str(project / "temp" / "output"),
            "GITHUB_STEP_SUMMARY": str(project / "temp" / "summary"),
            **{f"INPUT_{name.upper()}": value for name, value in inputs.items()},
        },
    )
    output = project / "temp" / "output"
    lines = output.read_text().splitlines() if output.exists() else []
    summary = project / "temp" / "summary"
    return (
        done.returncode,
        done.stdout + done.stderr,
        dict(line.split("=", 1) for line in lines),
        summary.read_text() if summary.exists() else "",
    )


def test_the_action_annotates_and_sums_up(project):
    status, output, outputs, summary = run_action(project, paths="fit.py\n", fail="true")
    assert status == 1
    assert output.startswith("::error title=ransac-fix (RFX001),file=fit.py,line=3")
    assert json.loads(Path(outputs["sarif"]).read_text())["runs"][0]["results"]
    assert "| fit.py:3:12 | RFX001 | high |" in summary


def test_the_action_may_pass_with_findings_but_not_with_errors(project):
    assert run_action(project, paths="fit.py", fail="false")[0] == 0
    status, output, _, _ = run_action(project, paths="none.py", fail="false")
    assert status == 2
    assert "no such file or folder" in output


def test_inputs_of_the_action_are_never_run(project):
    evil = project / "$(touch hacked) `touch hacked`; x.py"
    evil.write_text(RULE)
    status, output, _, _ = run_action(project, paths=f"{evil.name}\n", select="RFX001")
    assert status == 1
    assert not (project / "hacked").exists()
    assert "touch hacked" in output


def test_the_action_takes_its_inputs_through_the_environment():
    action = yaml.safe_load((ROOT / "action.yml").read_text())
    scan = action["runs"]["steps"][-1]
    script = (ROOT / "action" / "scan.sh").read_text()
    for name in action["inputs"]:
        assert scan["env"][f"INPUT_{name.upper()}"] == f"${{{{ inputs.{name} }}}}"
        assert f"INPUT_{name.upper()}" in script
    for step in action["runs"]["steps"]:
        assert "${{" not in step["run"]
    assert set(action["outputs"]) == set(re.findall(r'echo "(\w+)=', script))


def test_the_schema_of_the_configuration_is_the_one_shipped():
    path = ROOT / "ransac_fix" / "report" / "schemas" / "configuration.json"
    shipped = json.loads(path.read_text())
    assert shipped == json.loads(json.dumps(configuration_schema()))
    validator = Draft202012Validator(shipped)
    validator.check_schema(shipped)
    assert validator.is_valid(
        {"select": ["RFX"], "fix-style": "import", "respect-gitignore": False}
    )
    assert not validator.is_valid({"selct": []})
    assert not validator.is_valid({"fix-style": "other"})


def test_the_configuration_chooses_the_style_of_fixes(project):
    (project / "ransac-fix.toml").write_text('fix-style = "import"\n')
    assert CliRunner().invoke(cli, ["scan", "--fix", "fit.py"]).exit_code == 0
    assert "from ransac_fix import all_inlier_probability" in (project / "fit.py").read_text()
