"""Formulas in comments and docstrings: which are read, and what a note does."""

import ast
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix.cli import cli
from ransac_fix.scan import scan_paths, scan_text
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.form import Span
from ransac_fix.scan.prose import Prose, formulas, python_prose
from ransac_fix.scan.scanner import scan_data


def kinds(text: str) -> list[str]:
    return [one.kind for one in formulas(Prose(text, Span(1, 0, 1, len(text))))]


@pytest.mark.parametrize(
    "text",
    [
        "N = log(1 - p) / log(1 - w**k)",
        "N=log(1-p)/log(1-w^n), rounded up",
        "k = std::log(z) / std::log(1.0 - std::pow(w, n))",
        "k parameter (k=log(z)/log(1-w^n))",
        "np.log(1 - p) / np.log(1 - np.power(inliers / total points, sample size))",
        "N = log(1-p) / log[1 - (1-e)^s]",
        "N = ln(1\N{MINUS SIGN}p)/ln(1\N{MINUS SIGN}w\N{SUPERSCRIPT LATIN SMALL LETTER N})",
        "(log10(1-p)) / (log10(1-w*w*w))",
        "log(1-p) divided by log(1-w^n)",
        "log(1-p) over log(1-w^n)",
        r"$N = \frac{\log(1-p)}{\log(1-(1-\epsilon)^s)}$",
        r"\\frac{\\log\\left(1 - p\\right)}{\\log\\left(1 - w^{n}\\right)}",
        r"@f$ \dfrac{\ln(\eta_0)}{\ln(1 - w^s)} @f$",
        "          log(1 - p)\n#  N  =  --------------\n#        log(1 - w^n)",
        "  log(1 - p)\n * k = ____________\n *      log(1 - w^n)",
        "1 - p = (1 - w^n)^k",
        "success = 1. - (1 - inlier_ratio ** sample_size) ** n_trials",
    ],
)
def test_the_spellings_of_the_power_are_read(text):
    assert kinds(f"# {text}") == ["approximate"]


@pytest.mark.parametrize(
    "text",
    [
        "N = log(1-p)/log(1-e)",
        "log(a) - log(1 - w^n)",
        "log(u)/log(1 - p**u)",
        "log(1-p)/log(1-w^n",
        "rho = (1 - (1 - s / a^2)^3)",
        "n(l) = k (1 - g(1 - A(i)^(-h(i))))^2",
        "the log file / log(1) of 2**3",
        "log ( ( ( (",
    ],
)
def test_other_formulas_are_not_rules(text):
    assert "approximate" not in kinds(f"# {text}")


def test_a_product_is_read_as_exact():
    product = "I*(I-1)*(I-2) / (n*(n-1)*(n-2))"
    assert kinds(f"# ransac: log(1-p) / log(1 - {product})") == ["exact"]


@given(st.text(alphabet="log(1-w^n)/{}\\fracp =_-*\n #", max_size=120))
@settings(max_examples=300, deadline=None)
def test_no_text_is_too_odd(text):
    list(formulas(Prose(text, Span(1, 0, 1, 1))))


def test_what_is_prose_in_python():
    source = '''"""Module."""
x = """not prose"""
# one
# two

# three
def f(a):
    r"""Function."""
    y = 1  # four
    "five"
    return a
'''
    found = [prose.text for prose in python_prose(source, ast.parse(source))]
    assert found == [
        '"""Module."""',
        'r"""Function."""',
        '"five"',
        "# one\n# two\n\n# three",
        "# four",
    ]


FIXABLE = '''import math


def ransac_trials(n_inliers, n_samples, k, s):
    """Return the number of trials.

    It is log(1 - s) / log(1 - w^k).
    """
    w = n_inliers / n_samples
    return math.log(1 - s) / math.log(1 - w**k)
'''
STALE = "# ransac: N = log(1 - p) / log(1 - w^k)\nN = 100\n"


def run(*args: object, code: int) -> str:
    result = CliRunner().invoke(cli, ["scan", "--jobs", "1", *map(str, args)])
    assert result.exit_code == code, result.output + str(result.exception)
    return result.output


def test_the_place_is_that_of_the_formula():
    (found,) = scan_text(FIXABLE.encode(), "a.py", select=["RFX007"]).findings
    place = found.location
    assert (place.start_line, place.start_column) == (7, 11)
    assert (place.end_line, place.end_column) == (7, 36)
    assert "as the rule in line 10 does: change both" in found.message


def test_after_a_fix_the_comment_is_left_and_noted_as_stale(tmp_path):
    path = tmp_path / "a.py"
    path.write_text(FIXABLE)
    run(path, "--fix", code=0)
    assert "log(1 - s) / log(1 - w^k)." in path.read_text()
    (found,) = scan_paths([path]).findings
    assert (found.code, found.severity, found.fix) == ("RFX007", "note", None)
    assert "is exact: the comment is stale" in found.message
    assert "C(I, k) / C(n, k)" in found.no_fix


def test_a_note_fails_the_scan_only_where_it_is_selected(tmp_path):
    path = tmp_path / "a.py"
    path.write_text(STALE)
    assert "[note, high]" in run(path, code=0)
    assert run(path, code=0).endswith("1 note in 1 of 1 file.\n")
    assert "[high]" in run(path, "--select", "RFX007", code=1)
    run(path, "--select", "RFX", code=1)
    assert run(path, "--ignore", "RFX007", code=0).startswith("Nothing found")
    (tmp_path / "ransac-fix.toml").write_text('select = ["RFX007"]\n')
    run(path, code=1)


def test_every_format_tells_a_note_from_a_warning(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.py").write_text(STALE)
    assert run(".", "--output-format", "github", code=0).startswith("::notice ")
    (entry,) = json.loads(run(".", "--output-format", "gitlab", code=0))
    assert entry["severity"] == "info"
    (result,) = json.loads(run(".", "--output-format", "sarif", code=0))["runs"][0]["results"]
    assert result["level"] == "note"
    (found,) = json.loads(run(".", "--output-format", "json", code=0))["findings"]
    assert found["severity"] == "note"
    suite = ElementTree.fromstring(run(".", "--output-format", "junit", code=0))
    assert (suite.get("tests"), suite.get("failures")) == ("1", "0")
    assert suite.find("testcase/system-out") is not None
    assert "note, high" in run(".", "--output-format", "markdown", code=0)
    assert "note, high" in run(".", "--output-format", "html", code=0)


def test_a_comment_behind_a_docstring_sets_its_notes_aside():
    aside = FIXABLE.replace(
        '    """\n    w', '    """  # ransac-fix: ignore[RFX007] -- cited\n    w'
    )
    result = scan_text(aside.encode(), "a.py")
    assert [one.code for one in result.findings] == ["RFX001"]
    assert [one.suppression for one in result.suppressed] == ["cited"]


@pytest.mark.parametrize("language", ["python", "notebook", "c++"])
def test_it_is_noted_in_every_language_with_gates_and_without(language):
    source = STALE
    if language == "notebook":
        cells = [{"cell_type": "code", "source": STALE, "metadata": {}, "outputs": []}]
        source = json.dumps({"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5})
    if language == "c++":
        source = "/* ransac:\n * N = log(1 - p) / log(1 - w^k)\n */\nint N = 100;\n"
    file = SourceFile("a", language, named=False)
    gated = scan_data(source.encode(), file).findings
    assert [one.code for one in gated] == ["RFX007"]
    assert gated == scan_data(source.encode(), file, gate=False).findings


def test_a_comment_of_several_lines_sets_what_it_says_itself_aside():
    source = """/* ransac: N = log(1 - p) / log(1 - w^k)
   ransac-fix: ignore[RFX007] -- cited */
int N;
"""
    result = scan_text(source.encode(), "a.cpp")
    assert (result.findings, [one.code for one in result.suppressed]) == ((), ["RFX007"])
