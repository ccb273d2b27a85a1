"""Fixes: exact by execution, idempotent, and nothing else changed."""

import ast
import json
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
from ransac_fix.scan import scan_text
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.fixes import apply_edits
from ransac_fix.scan.fixing import fix_findings
from ransac_fix.scan.rules import Settings
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
    "a count that changed since the outliers were counted": """
from math import log

def trials(n_inliers, n_samples, k, s):
    n_outliers = n_samples - n_inliers
    n_inliers = 0
    w = 1 - n_outliers / n_samples
    return log(1 - s) / log(1 - w**k) + n_inliers
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
    "counts passed to a helper": """
import math

def _needed(s, w, k):  # for ransac
    if w == 0:
        return 0.0
    return math.log(1 - s) / math.log(1 - w**k)

def trials(n_inliers, n_samples, k, s):
    ratio = n_inliers / n_samples
    return _needed(s, ratio, k)
""",
    "counts passed to a method, by name": """
import math

class Ransac:
    def _needed(self, outlier_ratio, k, s):
        return math.log(1 - s) / math.log(1 - (1 - outlier_ratio) ** k)

    def update(self, n_inliers, n_samples, k, s):
        return self._needed(s=s, k=k, outlier_ratio=1 - n_inliers / n_samples)

def trials(n_inliers, n_samples, k, s):
    return Ransac().update(n_inliers, n_samples, k, s)
""",
    "counts passed to a helper that bounds its ratio": """
import numpy as np

def _update(p, ep, model_points):  # of ransac
    ep = max(ep, 0.0)
    ep = min(ep, 1.0)
    denom = 1.0 - np.power(1.0 - ep, model_points)
    return np.log(1.0 - p) / np.log(denom)

def trials(n_good, count, k, s):
    return _update(s, (count - n_good) / count, k)
""",
    "one over a power of the inverse": """
import math

def trials(n_inliers, n_samples, k, s):  # of ransac
    return math.log(1 - s) / math.log(1 - 1 / (n_samples / n_inliers)**k)
""",
    "a negative power of the inverse": """
import math

def trials(n_inliers, n_samples, k, s):  # of ransac
    return math.log(1 - s) / math.log(1 - (n_samples / n_inliers)**(-k))
""",
    "a dictionary": """
import math

def trials(n_inliers, n_samples, k, s):  # of ransac
    state = {"w": n_inliers / n_samples, "miss": 1 - s}
    state["good"] = state["w"] ** k
    return math.log(state["miss"]) / math.log(1 - state["good"])
""",
    "guards that choose": """
import math

def trials(n_inliers, n_samples, k, s):  # of ransac
    good = (n_inliers / n_samples) ** k
    good = good if good > 0 else 1e-300
    if good == 1:
        return 0.0
    return math.log(1 - s) / math.log1p(-good)
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
        largest = -math.log1p(-confidence) * 2.0**53  # where 1 - p is the last float below 1
        assert new >= min(old, largest) * (1 - 1e-6)
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
    # ... but for the power, and the ratio that nothing else uses.
    kept = [line for line in text.splitlines() if "**" not in line and line.split()[:1] != ["w"]]
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
        "may have changed since the ratio was made of it in line",
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
        "may have changed since the ratio was made of it in line",
    ),
}


@pytest.mark.parametrize(("source", "why"), UNFIXABLE.values(), ids=UNFIXABLE.keys())
def test_says_why_there_is_no_fix(source, why):
    source = f"from math import log\n{source}\n"
    findings, _ = scan_source(source, SourceFile("a.py", "python", named=True))
    finding = findings[0]
    assert finding.fix is None
    assert why in finding.no_fix


ARRAYS = (
    "_, c = np.unique(labels, return_counts=True); n = c.sum()",
    "c = np.bincount(labels); n = len(labels)",
    "c = np.array([5, 6, 7]); n = 10",
    "c = np.arange(1, n)",
    "c = np.arange(1, n)[labels > 0] + 1",
    "c = (labels == 1).sum(axis=1)",
    "c = (labels == 1).sum(0)",
    "c = np.sum(labels == 1, 1).astype(float)",
    "c: np.ndarray = labels",
    "c = [len(one) for one in labels]; c = np.asarray(c)",
    "c = 3; k = np.arange(2, 9)",
)
NUMBERS = (
    "c = np.bincount(labels)[1]",
    "c = np.bincount(labels).max()",
    "c = np.sum(labels == 1)",
    "c = int((labels == 1).sum())",
    "c = (labels == 1).sum(axis=None)",
    "c = len(np.unique(labels))",
    "c = labels.size(0)",
    "c = len(np.where(labels)[0])",
    "c = np.sum(labels == 1, axis=0); best = c if c > s else 0",
)


def _of_many(counts: str) -> str:
    return f"""
import numpy as np

def ransac(labels, n, k, s):
    {counts}
    w = c / n
    return np.log(1 - s) / np.log(1 - w**k)
"""


@pytest.mark.parametrize("counts", ARRAYS)
def test_passes_no_array_where_a_number_is_taken(counts):
    findings, _ = scan_source(_of_many(counts), SourceFile("a.py", "python", named=True))
    assert [one.fix for one in findings if one.code == "RFX001"] == [None]
    assert "may be an array, and the probability takes numbers" in findings[0].no_fix


@pytest.mark.parametrize("counts", NUMBERS)
def test_passes_a_number_that_is_made_of_an_array(counts):
    findings, _ = scan_source(_of_many(counts), SourceFile("a.py", "python", named=True))
    assert [one.fix is not None for one in findings if one.code == "RFX001"] == [True]


def test_passes_no_array_that_a_call_gives():
    source = """
import numpy as np

def _ransac_trials(w, k, s):
    return np.log(1 - s) / np.log(1 - w**k)

def table(n, k, s):
    n_inliers = np.arange(1, n)
    return _ransac_trials(n_inliers / n, k, s)
"""
    (finding,), _ = scan_source(source, SourceFile("a.py", "python", named=True))
    assert finding.fix is None
    assert "may be an array" in finding.no_fix


def test_a_helper_that_others_may_call_takes_counts_only_when_asked():
    source = """
from math import log

def trials(w, k, s):
    return log(1 - s) / log(1 - w**k)

def ransac(inliers, points):
    return trials(len(inliers) / len(points), 3, 0.99)
"""
    assert fixed(source) == source
    after = fixed(source, unsafe=True)
    assert "def trials(n_inliers, n_samples, k, s):" in after
    assert "return trials(len(inliers), len(points), 3, 0.99)" in after
    assert fixed(after, unsafe=True) == after


def test_a_call_passes_names_and_not_what_they_stand_for():
    source = """
from math import log

def _trials(ep: float, k):
    return log(0.1) / log(1 - (1 - ep) ** k)

def ransac(points, fit):
    count = len(points)
    n_good = fit(points)
    return _trials((count - n_good) / count, 3)
"""
    after = fixed(source)
    assert "def _trials(n_inliers: int, n_samples: int, k):" in after
    assert "return _trials(n_good, count, 3)" in after


KEPT_HELPERS = {
    "a default": "def trials(k, w=0.5):\n    return log(0.1) / log(1 - w**k)\ntrials(3)\n",
    "a call with the ratio alone": (
        "def trials(w, k):\n    return log(0.1) / log(1 - w**k)\n"
        "def ransac(inliers, n):\n    return trials(len(inliers) / n, 3) + trials(0.5, 3)\n"
    ),
    "passed on": (
        "def trials(w, k):\n    return log(0.1) / log(1 - w**k)\n"
        "def ransac(inliers, n):\n    return run(trials), trials(len(inliers) / n, 3)\n"
    ),
    "unpacked": (
        "def trials(w, k):\n    return log(0.1) / log(1 - w**k)\n"
        "def ransac(both):\n    return trials(*both)\n"
    ),
    "compiled": (
        "@numba.njit\ndef trials(inliers, n, k):\n    return log(0.1) / log(1 - (inliers / n)**k)\n"
    ),
    "made twice": (
        "def trials(points, n, k):\n    w = count_inliers(points) / n\n"
        "    return log(0.1) / log(1 - w**k)\n"
    ),
    "a percentage": "def trials(percent, k):\n    return log(0.1) / log(1 - (percent / 100)**k)\n",
    "more entries meanwhile": (
        "def trials(inliers, n, k):\n    w = len(inliers) / n\n    inliers.append(n)\n"
        "    return log(0.1) / log(1 - w**k)\n"
    ),
}


@pytest.mark.parametrize("source", KEPT_HELPERS.values(), ids=KEPT_HELPERS.keys())
def test_leaves_a_helper_alone_that_cannot_be_changed(source):
    source = f"# ransac\nfrom math import log\n{source}"
    findings, _ = scan_source(source, SourceFile("a.py", "python", named=True))
    assert [(one.fix, bool(one.no_fix)) for one in findings] == [(None, True)]


def test_the_import_style_uses_this_package():
    source = SOURCE.replace("import math\n", "import math\nimport sys\n")
    findings, _ = scan_source(
        source, SourceFile("ransac.py", "python", named=True), settings=Settings(fix_style="import")
    )
    (finding,) = findings
    assert finding.fix is not None
    after = apply_edits(source, finding.fix.edits)
    assert "import math\nimport sys\nfrom ransac_fix import all_inlier_probability\n\n" in after
    assert "def _all" not in after
    trials = load(after).trials
    p = all_inlier_probability(7, 20, 3)
    assert trials(7, 20, 3, 0.99) == pytest.approx(math.log(0.01) / math.log1p(-p))
    assert math.isfinite(trials(2, 20, 3, 0.99))
    assert not scan_source(after, SourceFile("ransac.py", "python", named=True))[0]


def _notebook(*cells: object) -> str:
    document = {
        "cells": [
            {
                "cell_type": "code",
                "execution_count": None,
                "metadata": {},
                "outputs": [{"name": "stdout", "output_type": "stream", "text": ["w**k \u00e9"]}],
                "source": cell,
            }
            for cell in cells
        ],
        "metadata": {"kernelspec": {"language": "python", "name": "python3"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


CELL = """%matplotlib inline
import math
s = "caf\u00e9 \\"ransac\\" \U0001f600"; inliers, n = [1] * 5, 20
N = math.log(0.01) / math.log(1 - (len(inliers) / n)**3)"""


@pytest.mark.parametrize("listed", [True, False], ids=["a string a line", "one string"])
@pytest.mark.parametrize("escaped", [True, False], ids=["escaped", "plain"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"], ids=["lf", "crlf"])
def test_a_notebook_is_fixed_in_its_cell_and_nowhere_else(tmp_path, listed, escaped, ends):
    cell = CELL.splitlines(keepends=True) if listed else CELL
    text = _notebook(["import os\n"], cell, ["N = math.log(0.01) / math.log(1 - 0.5**3)  # fixed"])
    if escaped:
        text = json.dumps(json.loads(text), indent=1) + "\n"
    text = text.replace("\n", ends)
    path = tmp_path / "ransac.ipynb"
    path.write_bytes(text.encode())
    result = CliRunner().invoke(cli, ["scan", "--fix", "--select", "RFX001", str(path)])
    assert result.exit_code in (0, 1), result.output
    after = path.read_bytes().decode()
    old, new = json.loads(text), json.loads(after)
    assert [one for n, one in enumerate(old["cells"]) if n != 1] == [
        one for n, one in enumerate(new["cells"]) if n != 1
    ]
    source = new["cells"][1]["source"]
    assert isinstance(source, list) == listed
    if listed:
        assert all(line.endswith("\n") and line.count("\n") == 1 for line in source[:-1])
    code = "".join(source)
    assert code.startswith("%matplotlib inline\nimport math\n")
    assert "(len(inliers), n, 3))" in code
    assert code.count("def _all_inlier_probability") == 1
    # Only what was edited changed in the text itself.
    assert after.count(ends) == after.count("\n") if ends == "\r\n" else "\r" not in after
    removed = [line for line in text.split(ends) if line not in after.split(ends)]
    assert len(removed) <= 1
    again = CliRunner().invoke(cli, ["scan", "--fix", "--select", "RFX001", str(path)])
    assert "Fixed 0 findings" in again.stderr


def test_standard_input_is_written_fixed_to_standard_output():
    result = CliRunner().invoke(
        cli, ["scan", "--fix", "--stdin-filename", "ransac.py", "-"], input=SOURCE
    )
    assert result.exit_code == 0
    assert result.stdout == fixed(SOURCE)
    assert "Fixed 1 finding" in result.stderr
    result = CliRunner().invoke(cli, ["scan", "--diff", "-"], input=SOURCE)
    assert result.exit_code == 1
    assert result.stdout.startswith("--- <stdin>\n+++ <stdin>\n")
    result = CliRunner().invoke(cli, ["scan", "-"], input=SOURCE)
    assert result.exit_code == 1
    assert result.stdout.startswith("<stdin>:6:12: RFX001")
    assert CliRunner().invoke(cli, ["scan", "-", "."], input=SOURCE).exit_code == 2


def test_a_folder_that_cannot_be_written_to_is_an_error(tmp_path, monkeypatch):
    path = tmp_path / "ransac.py"
    path.write_text(SOURCE)

    def refuse(*_args: object, **_keywords: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkstemp", refuse)
    result = CliRunner().invoke(cli, ["scan", "--fix", "--no-cache", str(path)])
    assert result.exit_code == 2
    assert "cannot be written: Permission denied" in result.output
    assert path.read_text() == SOURCE


def test_fixes_that_meet_are_made_one_after_the_other(tmp_path):
    path = tmp_path / "ransac.py"
    path.write_text(
        "from math import log\n\n\ndef _trials(w, k):  # ransac\n"
        "    return log(0.1) / log(1 - w**k), log(0.2) / log(1 - w**k)\n\n\n"
        "def run(inliers, n):\n    return _trials(len(inliers) / n, 3)\n"
    )
    for _ in range(2):
        CliRunner().invoke(cli, ["scan", "--fix", "--no-cache", str(path)])
    after = path.read_text()
    assert "**" not in after.partition("def _trials")[2]
    assert "return _trials(len(inliers), n, 3)" in after
    assert load(after).run([1] * 5, 9)


SAMPLERS = {
    "np.random.choice(n_points, 3)": "np.random.choice(n_points, 3, replace=False)",
    "np.random.choice(n_points, size=3)": "np.random.choice(n_points, size=3, replace=False)",
    "np.random.choice(n_points, 3, True)": "np.random.choice(n_points, 3, replace=False)",
    "np.random.randint(0, n_points, 3)": "np.random.choice(n_points, size=3, replace=False)",
    "np.random.randint(n_points, size=3)": "np.random.choice(n_points, size=3, replace=False)",
    "rng.integers(0, n_points, size=3)": "rng.choice(n_points, size=3, replace=False)",
    "random.choices(points, k=3)": "random.sample(points, k=3)",
    "[random.randrange(n_points) for _ in range(3)]": "random.sample(range(n_points), 3)",
    "[points[random.randint(0, n_points - 1)] for _ in range(3)]": (
        "[points[i] for i in random.sample(range(n_points), 3)]"
    ),
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
    assert "is not known yet there" in finding.no_fix


def test_a_wrong_exponent_is_settled_first():
    source = """
from math import log
import random

def ransac(points, fit):
    N = 100.0
    while N > 0:
        inliers = fit(random.sample(points, 4))
        w = len(inliers) / len(points)
        N = log(0.01) / log(1 - w**8)
"""
    findings, _ = scan_source(source, SourceFile("a.py", "python", named=True))
    assert {one.code: one.no_fix for one in findings} == {
        "RFX001": "8 is not the size of the sample, 4: see RFX004",
        "RFX004": "either draw 8, or make the exponent 4",
    }


def test_a_factor_beside_the_power_stays():
    source = """
from math import log

def ransac_trials(n_inliers, n, s):
    p = (1.0 / 3.0) * ((n_inliers / n) ** 2)
    return int(log(1 - s) / log(1.0 - p))
"""
    after = fixed(source, unsafe=True)
    assert "p = (1.0 / 3.0) * (_all_inlier_probability(n_inliers, n, 2))" in after
    p = all_inlier_probability(7, 20, 2) / 3
    assert load(after).ransac_trials(7, 20, 0.99) == int(math.log(0.01) / math.log1p(-p))


def test_a_size_and_counts_that_are_floats_are_taken():
    helper = load(fixed(FORMS["plain"]))
    exact = helper.trials(7, 20, 3, 0.99)
    assert helper.trials(7.0, 20.0, 3.0, 0.99) == exact


def test_says_how_many_more_would_be_fixed_when_asked(tmp_path):
    path = tmp_path / "ransac.py"
    path.write_text(SOURCE.replace("n_inliers", "good"))
    result = CliRunner().invoke(cli, ["scan", "--fix", str(path)])
    assert result.exit_code == 1
    assert "--unsafe-fixes would fix 1 more." in result.stderr


def test_a_misplaced_confidence_is_passed_by_its_name():
    source = """import cv2
H, m = cv2.findHomography(a, b, cv2.RANSAC, 3.0,
                          opts.confidence)  # kept
A, i = cv2.estimateAffine3D(a, b, 0.9, maxIters=3)
x = cv2.solvePnPRansac(a, b, K, None, 100, None)
y = cv2.findHomography(a, b, cv2.RANSAC, 3.0, 0.99, 2000)
"""
    found = scan_text(source.encode(), "a.py", select=["RFX102"]).findings
    assert [None if one.fix is None else one.fix.safe for one in found] == [
        False,
        False,
        None,
        None,
    ]
    (fixed,) = fix_findings(found, unsafe=True, contents={"a.py": source.encode()})[0]
    assert fixed.after == source.replace("opts.", "confidence=opts.").replace(
        "0.9,", "confidence=0.9,"
    )
