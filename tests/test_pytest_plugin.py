"""The pytest plugin, and the page that shows it."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import ransac_fix
from ransac_fix.audit import session
from ransac_fix.audit.model import Control, Report, Verdict

pytest_plugins = "pytester"

PAGE = (Path(__file__).parent.parent / "docs" / "testing.md").read_text("utf-8")
EXAMPLES = dict(re.findall(r'```\w+ title="([\w.]+)"\n(.*?)```', PAGE, re.DOTALL))

CONTROL = Control("exact", "a; distinct", "a; distinct", True, 100)
SHORT = Verdict(
    *("opencv", "findHomography(RANSAC)", "5.0.0.93", "undersamples"),
    *("assumes P = (I/n)^4", "Raise maxIters."),
)
EXACT = Verdict("kornia", "RANSAC(homography)", "0.9.0", "exact", "agrees")
BROKEN = Verdict("poselib", "-", None, "not measured", "not installed")


def report(*verdicts, controls=(CONTROL,)):
    return Report(1, verdicts, controls, (), 600, 2.0)


@pytest.fixture
def audited(pytester, monkeypatch):
    """Run pytest where an audit finds these verdicts; return the outcome and what was asked."""

    def run(found, ini, *arguments):
        asked = []

        def audit(options):
            asked.append(options)
            return found

        monkeypatch.setattr(session, "audit", audit)
        # The other plugins take longer to load than the test.
        monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
        pytester.makeini(f"[pytest]\n{ini}")
        pytester.makepyfile("def test_one(): pass")
        return pytester.runpytest("-p", "ransac_fix.pytest_plugin", *arguments), asked

    return run


def test_nothing_is_audited_unless_asked_for(audited):
    result, asked = audited(report(SHORT), "")
    result.assert_outcomes(passed=1)
    assert asked == []


def test_a_library_that_undersamples_fails_the_session(audited):
    result, (options,) = audited(report(SHORT, EXACT), "ransac_fix_audit = cv2 kornia")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["collected 2 items"])
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    assert (options.systems, options.python, options.quick) == (
        ("opencv", "kornia"),
        sys.executable,
        True,
    )
    result.stdout.fnmatch_lines(
        [
            "opencv 5.0.0.93 findHomography(RANSAC): undersamples: assumes P = (I/n)^4",
            "  Raise maxIters.",
            "FAILED ransac-fix::audit*",
        ]
    )
    assert "Traceback" not in result.stdout.str()


def test_an_exact_library_passes(audited):
    result, (options,) = audited(
        report(EXACT), "ransac_fix_audit = all\nransac_fix_every_entry_point = true"
    )
    result.assert_outcomes(passed=2)
    assert (options.systems, options.quick) == ((), False)


EXPECT = """
[[expect]]
system = "opencv"
entry_point = "*"
verdict = "{}"
reason = "known"
"""


@pytest.mark.parametrize(
    ("found", "expected", "said"),
    [
        (report(SHORT), "undersamples", None),
        (report(replace(SHORT, verdict="not measured")), "not measured", None),
        (report(replace(SHORT, verdict="exact")), "undersamples", "expected but not seen"),
        (report(SHORT), "exact", "undersamples, not exact as expected"),
        (report(EXACT), "undersamples", "expected but not seen: opencv *: undersamples"),
    ],
)
def test_expectations_fail_in_either_direction(audited, pytester, found, expected, said):
    pytester.mkdir("config").joinpath("audit.toml").write_text(EXPECT.format(expected))
    result, _ = audited(found, "ransac_fix_audit = opencv\nransac_fix_expect = config/audit.toml")
    if said is None:
        result.assert_outcomes(passed=2)
    else:
        result.assert_outcomes(passed=1, failed=1)
        result.stdout.fnmatch_lines([f"*{said}*"])


def test_other_verdicts_can_fail(audited):
    slow = replace(SHORT, verdict="oversamples")
    ini = "ransac_fix_audit = opencv\nransac_fix_fail_on =\n  undersamples\n  oversamples"
    audited(report(slow), ini)[0].assert_outcomes(passed=1, failed=1)


def test_what_could_not_be_measured_at_all_fails(audited):
    result, _ = audited(report(EXACT, BROKEN), "ransac_fix_audit = kornia poselib")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["poselib: nothing could be measured: not installed"])
    some = replace(BROKEN, system="kornia", entry_point="other")
    audited(report(EXACT, some), "ransac_fix_audit = kornia")[0].assert_outcomes(passed=2)


def test_without_its_controls_an_audit_fails(audited):
    found = report(EXACT, controls=(replace(CONTROL, passed=False),))
    result, _ = audited(found, "ransac_fix_audit = kornia")
    result.stdout.fnmatch_lines(["ransac-fix: control exact was not identified*"])


@pytest.mark.parametrize(
    ("ini", "message"),
    [
        ("ransac_fix_audit = opencvv", "ransac-fix: unknown system 'opencvv'"),
        ("ransac_fix_audit = kornia\nransac_fix_expect = no.toml", "no.toml: No such file"),
        ("ransac_fix_audit = kornia\nransac_fix_fail_on = bad", "there is no verdict 'bad'"),
    ],
)
def test_a_wrong_configuration_is_one_line(audited, ini, message):
    result, asked = audited(report(EXACT), ini)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert asked == []
    (line,) = (line for line in result.stderr.lines if line.startswith("ERROR"))
    assert message in line


@pytest.mark.parametrize("arguments", [("-k", "one"), ("test_audited.py::test_one",)])
def test_choosing_tests_leaves_it_out(audited, pytester, arguments):
    pytester.makepyfile(test_audited="def test_one(): pass")
    result, asked = audited(report(SHORT), "ransac_fix_audit = opencv", *arguments)
    assert result.ret == 0
    assert asked == []


def test_pytest_does_not_mind_a_package_imported_at_start_up():
    """Of an installed wheel pytest would rewrite the assertions, and warn that it is too late."""
    assert "PYTEST_DONT_REWRITE" in ransac_fix.__doc__


def test_starting_pytest_stays_light():
    code = "import sys, pytest; a = set(sys.modules); import ransac_fix.pytest_plugin; "
    code += "print(*{name for name in set(sys.modules) - a if 'ransac' in name or '.' not in name})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) <= {
        *("ransac_fix", "ransac_fix._version", "ransac_fix.pytest_plugin")
    }


# --- the page ------------------------------------------------------------------------------


@pytest.fixture
def examples(pytester):
    for name, text in EXAMPLES.items():
        if name.endswith((".py", ".cpp")):
            pytester.path.joinpath(name).write_text(text, "utf-8")
    return pytester


def test_the_function_and_the_class_of_the_page_pass(examples):
    result = examples.runpytest_subprocess("test_lines.py", "test_planes.py")
    result.assert_outcomes(passed=2)


def test_the_textbook_rule_fails_as_the_page_says(examples):
    module = examples.path / "lines.py"
    exact = "required_trials(int(inliers.sum()), n, 2, confidence)"
    textbook = "approximate_required_trials(int(inliers.sum()), n, 2, confidence)"
    text = module.read_text("utf-8").replace(exact, textbook)
    module.write_text(text.replace("import required", "import approximate_required"), "utf-8")
    result = examples.runpytest_subprocess("test_lines.py")
    result.assert_outcomes(failed=1)
    assert EXAMPLES["failure"].strip() in result.stdout.str()


def test_the_pybind11_module_of_the_page_passes(examples):
    command = EXAMPLES["build"].replace("python", sys.executable)
    subprocess.run(["bash", "-ec", command], cwd=examples.path, check=True)
    result = examples.runpytest_subprocess("test_shifts.py")
    result.assert_outcomes(passed=1)


def test_the_audit_of_the_page_passes(examples):
    for name in ("pyproject.toml", "audit.toml"):
        examples.path.joinpath(name).write_text(EXAMPLES[name], "utf-8")
    examples.makepyfile("def test_one(): pass")
    result = examples.runpytest_subprocess("test_the_audit_of_the_page_passes.py")
    result.assert_outcomes(passed=2)


def test_without_numpy_the_extra_is_named(audited, monkeypatch):
    monkeypatch.setitem(sys.modules, "numpy", None)
    result, asked = audited(report(EXACT), "ransac_fix_audit = kornia")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: ransac-fix: this needs numpy: pip install *audit*"])
    assert asked == []
