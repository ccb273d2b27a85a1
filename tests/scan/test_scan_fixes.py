"""Fixes: exact by execution, idempotent, and nothing else changed."""

import ast
import math
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix import all_inlier_probability
from ransac_fix.cli import cli
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.fixes import apply_edits
from ransac_fix.scan.scanner import scan_source

# Each defines trials(n_inliers, n_samples, sample_size, confidence).
FORMS = {
    "plain": """
import math

def trials(n_inliers, n_samples, sample_size, confidence):
    # ransac
    w = n_inliers / n_samples
    return math.log(1 - confidence) / math.log(1 - w**sample_size)
""",
    "scikit-learn's way": """
import numpy as np

_EPSILON = np.spacing(1)

def trials(n_inliers, n_samples, min_samples, probability):  # of ransac
    inlier_ratio = n_inliers / float(n_samples)
    nom = max(_EPSILON, 1 - probability)
    denom = max(_EPSILON, 1 - inlier_ratio**min_samples)
    if nom == 1:
        return 0
    if denom == 1:
        return float("inf")
    return np.log(nom) / np.log(denom)
""",
    "outliers and names bound again": """
import math

def trials(n_inliers, n_points, k, s):
    ransac_eps = 1.0 - float(n_inliers) / n_points
    d = 1 - math.pow(1 - ransac_eps, k)
    d = math.log(d)
    return math.log(1 - s) / d
""",
    "count of outliers": """
from math import log

def trials(n_inliers, n_samples, k, s):
    n_outliers = n_samples - n_inliers
    e = n_outliers / n_samples
    return log(1 - s) / log(1 - (1 - e) ** k)
""",
    "exp of log": """
import numpy as np

def trials(inliers, total, k, s):
    return np.log1p(-s) / np.log1p(-np.exp(k * np.log(inliers / total)))
""",
    "powers apart": """
from math import log

def trials(n_inliers, n_samples, k, s):
    return log(1 - s) / log(1 - n_inliers**k / n_samples**k)
""",
    "nested": """
import math

class Ransac:
    def _update(self, n_inliers, n_samples, k, s):
        if n_inliers > 0:
            w = n_inliers / n_samples
            if w < 1:
                return math.log(1 - s) / math.log(1 - w**k)
        return 0.0

def trials(n_inliers, n_samples, k, s):
    return Ransac()._update(n_inliers, n_samples, k, s)
""",
}


@cache
def fixed(source: str, *, unsafe: bool = False) -> str:
    findings, errors = scan_source(source, SourceFile("ransac.py", "python", named=True))
    assert not errors
    fixes = [one.fix for one in findings if one.fix and (unsafe or one.fix.safe)]
    return apply_edits(source, [edit for fix in fixes for edit in fix.edits])


@cache
def load(source: str) -> ModuleType:
    module = ModuleType("under_test")
    exec(compile(source, "under_test.py", "exec"), vars(module))
    return module


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_fixed_function_is_exact_wherever_both_are_defined(form, data):
    before, after = load(FORMS[form]), load(fixed(FORMS[form]))
    n_samples = data.draw(st.integers(2, 2000))
    sample_size = data.draw(st.integers(1, min(8, n_samples)))
    n_inliers = data.draw(st.integers(sample_size, n_samples))
    confidence = data.draw(st.floats(0.01, 0.9999))
    p = all_inlier_probability(n_inliers, n_samples, sample_size)
    try:
        old = before.trials(n_inliers, n_samples, sample_size, confidence)
    except (ValueError, ZeroDivisionError):
        # The original takes the logarithm of zero, or divides by the logarithm of one.
        assert n_inliers == n_samples or p < 1e-12
        return
    new = after.trials(n_inliers, n_samples, sample_size, confidence)
    if not 1e-9 < p < 1:
        assert new >= old * (1 - 1e-6) or new > 1e14  # as far as a float can tell
        return
    exact = math.log1p(-confidence) / math.log1p(-p)
    assert new == pytest.approx(exact, rel=1e-6)
    assert (
        (new == pytest.approx(old, rel=1e-9)) == (sample_size == 1 or n_inliers == n_samples)
        or (n_inliers >= n_samples - 1)
        or math.isclose(new, old, rel_tol=1e-6)
    )


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_fixed_function_stays_finite_where_the_original_was(form, data):
    before, after = load(FORMS[form]), load(fixed(FORMS[form]))
    n_samples = data.draw(st.integers(1, 500))
    sample_size = data.draw(st.integers(1, 10))
    n_inliers = data.draw(st.integers(0, n_samples))
    try:
        old = before.trials(n_inliers, n_samples, sample_size, 0.99)
    except (ValueError, ZeroDivisionError):
        return
    if math.isfinite(old):
        assert math.isfinite(after.trials(n_inliers, n_samples, sample_size, 0.99))


@pytest.mark.parametrize("form", FORMS)
def test_a_fixed_file_has_nothing_left_to_fix(form):
    once = fixed(FORMS[form])
    assert once != FORMS[form]
    findings, errors = scan_source(once, SourceFile("ransac.py", "python", named=True))
    assert not findings
    assert not errors
    assert fixed(once) == once


SOURCE = FORMS["plain"].lstrip("\n")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("    ", "\t"),
        lambda text: "\ufeff" + text,
        lambda text: "# -*- coding: latin-1 -*-\n# caf\u00e9\n" + text,
        lambda text: text.replace("# ransac", "# ransac \u2013 \u00e9\U0001f600"),
        lambda text: text.replace("w**sample_size", "w **sample_size  # why").replace(
            "why)", "why\n    )"
        ),
        lambda text: text.rstrip("\n"),
        lambda text: "#!/usr/bin/env python\n" + text,
        lambda text: text.replace("    w = ", "    \u03b5 = 1; w = "),
    ],
    ids=["crlf", "tabs", "bom", "latin-1", "unicode", "comments", "no newline", "shebang", "greek"],
)
def test_everything_else_stays(tmp_path, change):
    text = change(SOURCE)
    encoding = "latin-1" if "latin-1" in text else "utf-8"
    path = tmp_path / "ransac.py"
    path.write_bytes(text.encode(encoding))
    path.chmod(0o640)
    result = CliRunner().invoke(cli, ["scan", "--fix", str(path)])
    assert result.exit_code == 0, result.output
    after = path.read_bytes().decode(encoding)
    assert path.stat().st_mode & 0o777 == 0o640
    ast.parse(after.removeprefix("\ufeff"))
    ends = {line[len(line.rstrip("\r\n")) :] for line in after.splitlines(keepends=True)}
    assert ends - {""} == {"\r\n" if "\r\n" in text else "\n"}
    kept = [line for line in text.splitlines() if "**" not in line]
    assert [line for line in after.splitlines() if line in kept and line] == [
        line for line in kept if line
    ]
    assert list(tmp_path.iterdir()) == [path]


def test_the_diff_is_shown_and_nothing_is_written(tmp_path):
    path = tmp_path / "ransac.py"
    path.write_text(SOURCE)
    result = CliRunner().invoke(cli, ["scan", "--diff", str(path)])
    assert result.exit_code == 1
    assert "+    return math.log(1 - confidence) / math.log(1 - _all_inlier_probability(" in (
        result.output
    )
    assert path.read_text() == SOURCE


UNFIXABLE = {
    "only the ratio": (
        """
def trials(w, k, s):
    return log(1 - s) / log(1 - w**k)  # ransac
""",
        "only the ratio of inliers is known here",
    ),
    "a count that changes before it is used": (
        """
def ransac(n, k, s, fit):
    n_inliers = fit()
    w = n_inliers / n
    n_inliers = fit()
    N = log(1 - s) / log(1 - w**k)
    return N, n_inliers
""",
        "the counts may have changed",
    ),
    "a ratio from another branch": (
        """
def ransac(n, k, s, fit):
    w = 0.1
    for _ in range(9):
        n_inliers = fit()
        if n_inliers > 9:
            w = n_inliers / n
        N = log(1 - s) / log(1 - w**k)
    return N
""",
        "only the ratio of inliers is known here",
    ),
    "a loop that changes the count": (
        """
def ransac(n, k, s, fit):
    n_inliers = fit()
    w = n_inliers / n
    while n_inliers:
        N = log(1 - s) / log(1 - w**k)
        n_inliers = fit()
""",
        "the counts may have changed",
    ),
}


@pytest.mark.parametrize(("source", "why"), UNFIXABLE.values(), ids=UNFIXABLE.keys())
def test_says_why_there_is_no_fix(source, why):
    source = f"from math import log\n{source}\n"
    (finding,), _ = scan_source(source, SourceFile("a.py", "python", named=True))
    assert finding.fix is None
    assert why in finding.no_fix


SAMPLERS = {
    "np.random.choice(n_points, 3)": "np.random.choice(n_points, 3, replace=False)",
    "np.random.choice(n_points, size=3)": "np.random.choice(n_points, size=3, replace=False)",
    "np.random.choice(n_points, 3, True)": "np.random.choice(n_points, 3, replace=False)",
    "np.random.randint(0, n_points, 3)": "np.random.choice(n_points, size=3, replace=False)",
    "np.random.randint(n_points, size=3)": "np.random.choice(n_points, size=3, replace=False)",
    "rng.integers(0, n_points, size=3)": "rng.choice(n_points, size=3, replace=False)",
    "random.choices(points, k=3)": "random.sample(points, k=3)",
}


@pytest.mark.parametrize(("before", "after"), SAMPLERS.items())
def test_sampler_and_rule_change_together_and_only_when_asked(before, after):
    source = f"""
from math import log
def ransac(points, n_points, fit, s, rng):
    N = 100.0
    while N > 0:
        sample = {before}
        inliers = fit(sample)
        w = len(inliers) / n_points
        N = log(1 - s) / log(1 - w**3)
"""
    assert fixed(source) == source
    text = fixed(source, unsafe=True)
    assert f"sample = {after}\n" in text
    assert "_all_inlier_probability(len(inliers), n_points, 3)" in text


def test_several_rules_share_one_function(tmp_path: Path):
    path = tmp_path / "ransac.py"
    path.write_text(SOURCE + SOURCE.replace("def trials", "def again"))
    result = CliRunner().invoke(cli, ["scan", "--fix", str(path)])
    assert result.exit_code == 0
    assert path.read_text().count("def _all_inlier_probability") == 1
    again = CliRunner().invoke(cli, ["scan", "--fix", str(path)])
    assert "Fixed 0 findings in 0 files." in again.stderr


POPULATIONS = {
    "random.sample(range(n), k)": "round(w * n), n, k",
    "random.sample(points, k)": "round(w * len(points)), len(points), k",
    "np.random.choice(len(points), k, replace=False)": ("round(w * len(points)), len(points), k"),
    "np.random.choice(points.shape[0], k, False)": (
        "round(w * points.shape[0]), points.shape[0], k"
    ),
    "np.random.permutation(np.arange(n))[:k]": "round(w * n), n, k",
}


@pytest.mark.parametrize(("draw", "arguments"), POPULATIONS.items())
def test_a_budget_is_made_exact_with_the_number_of_data_when_asked(draw, arguments):
    source = f"""
from math import log
def ransac(points, n, k, w=0.5, s=0.99):
    N = int(log(1 - s) / log(1 - w**k))
    for _ in range(N):
        sample = {draw}
"""
    assert fixed(source) == source
    text = fixed(source, unsafe=True)
    assert f"log(1 - _all_inlier_probability({arguments}))" in text
    assert fixed(text, unsafe=True) == text


def test_a_budget_without_the_number_of_data_has_no_fix():
    source = """
from math import log
def ransac(points, k, w=0.5, s=0.99):
    N = int(log(1 - s) / log(1 - w**k))
    points = points[1:]
    for _ in range(N):
        sample = random.sample(points, k)
"""
    (finding,), _ = scan_source(source, SourceFile("a.py", "python", named=True))
    assert finding.fix is None
    assert "the number of data is not known yet" in finding.no_fix
