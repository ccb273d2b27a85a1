"""RFX007, the formula in a comment."""

import re
from collections.abc import Iterator
from typing import ClassVar

from ransac_fix.scan import words
from ransac_fix.scan.findings import Certainty, Finding, Related
from ransac_fix.scan.form import Function
from ransac_fix.scan.prose import Formula, Prose, formulas
from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.rules.base import Rule, ScannedFile, power_in, product_in
from ransac_fix.scan.walk import functions

# What says that the power is an approximation, beside the rule that is none.
_EXACT = re.compile(
    r"\bexact\b|\bbinom\s*[({\\]|binomial coefficient|\bcomb\s*\(|\bC\(\s*[\w\s]+,|hypergeom"
    r"|undersampl|falling factorial|required_trials|Sch(?:ö|oe)nberger"
    r"|with(?:out)?[\s#/*]+replacement",
    re.IGNORECASE,
)
_LINES_AROUND = 12
_LINES_ABOVE_A_FUNCTION = 3


class ApproximateFormulaInComment(Rule):
    """Comment or docstring that states the stopping rule with the approximate probability.

    What it does
    ------------
    Finds ``log(1 - s) / log(1 - w**k)`` in the comments and docstrings of code about RANSAC, in
    plain text (``w^k``, ``pow(w, k)``), as a fraction on three lines, and in LaTeX, and what it is
    the solution of, ``1 - s = (1 - w**k)**N``; once in each comment. It says whether the rule
    beside it takes the same power, or is exact and the comment stale. Markdown cells of notebooks
    are not read.

    It is a note: it is reported and does not make the scan fail, unless ``--select`` or the
    configuration chooses it. Text that speaks of the exact rule too, of binomial coefficients, or
    of drawing with or without replacement, is left alone, and so is what is about other uses of the
    algebra.

    Why is this bad
    ---------------
    Whoever reads the code, or writes it anew from its comment, gets the rule of RFX001. After
    ``--fix`` the comment and the code contradict each other: fixes change code alone.

    Use instead
    -----------
    ``log(1 - s) / log(1 - C(I, k) / C(n, k))``, of I inliers among n data.

    Fix safety
    ----------
    There is no fix. A sentence around a formula may explain the power, give numbers made with
    it or quote a source, and only its author can say so; the finding spells the formula to put
    in its place.
    """

    code = "RFX007"
    name = "approximate-formula-in-comment"
    summary = "comment or docstring that states the stopping rule with the power (a note)"
    about_code = False
    reads_prose = True
    valid: ClassVar[dict[str, str]] = {
        "It names the power as what it is, beside the exact rule.": '''
import math

def ransac_trials(n_inliers, n_samples, k, s):
    """Number of trials. The textbooks have log(1 - s) / log(1 - w**k), w**k for C(I, k) / C(n, k).
    """
    p = math.comb(n_inliers, k) / math.comb(n_samples, k)
    return math.log(1 - s) / math.log(1 - p)
''',
        "The exact rule.": """
# RANSAC stops after log(1 - s) / log(1 - comb(I, k) / comb(n, k)) trials.
trials = 100
""",
        "The same algebra with another meaning.": """
# MinHash LSH, outliers aside: bands = log(1 - p) / log(1 - s**rows)
bands = 20
""",
        "Text that is not a comment.": """
usage = "ransac: N = log(1 - p) / log(1 - w**k)"
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "A comment beside a fixed number of trials.": """
# ransac: N = log(1 - p) / log(1 - w^n)
N = 100
""",
        "A docstring that the code no longer follows.": '''
import math

def ransac_trials(n_inliers, n_samples, k, s):
    r"""Number of trials, $\\frac{\\log(1 - s)}{\\log(1 - w^k)}$ for a ratio w of inliers."""
    p = math.comb(n_inliers, k) / math.comb(n_samples, k)
    return math.log(1 - s) / math.log(1 - p)
''',
        "A fraction on three lines.": """
def ransac(points, fit, p=0.99):
    #            log(1 - p)
    #  trials = ------------------------
    #            log(1 - (1 - e)^s)
    return fit(points, p)
""",
    }
    cpp_invalid: ClassVar[dict[str, str]] = {
        "A comment of Doxygen's.": r"""
/// Trials of RANSAC: \f$ N = \frac{\ln(1 - p)}{\ln(1 - w^s)} \f$
int trials(double p, double w, int s);
""",
    }

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the formulas, where something says that they are of RANSAC."""
        speaks = words.speaks_strongly(file.text.source) or words.speaks_strongly(file.path)
        whispers = words.speaks_weakly(file.text.source) or words.speaks_weakly(file.path)
        if not (speaks or whispers):
            return
        for prose in file.prose:
            if _EXACT.search(prose.text):
                continue
            formula = next((one for one in formulas(prose) if one.kind == "approximate"), None)
            if formula is None:
                continue
            function = _function_of(prose, file)
            around = prose.text
            if function is not None:
                around += file.text.block(function.span)
            if words.speaks_of_other(around):
                continue
            near = words.speaks_strongly(around)
            if not near and not formula.spelled.startswith("log"):
                continue  # so is the density of many a distribution
            certainty: Certainty = "high" if near else "medium" if speaks else "low"
            yield _finding(self.code, formula, certainty, file, _rule_of(formula, function, file))


def _finding(
    code: str, formula: Formula, certainty: Certainty, file: ScannedFile, rule: ReadSite | None
) -> Finding:
    power, size = power_in(formula.roles), formula.roles.get("sample_size", "k")
    exact = product_in({"sample_size": size})
    said = f"the comment states {power} for the probability of an all-inlier sample"
    related: tuple[Related, ...] = ()
    if rule is None:
        said += f"; without replacement it is {exact}"
    else:
        line = rule.site.span.line
        related = (Related(file.location(rule.site.span), "the rule that it stands beside"),)
        if rule.site.probability.kind == "exact":
            said += f", and the rule in line {line} is exact: the comment is stale"
        else:
            said += f", as the rule in line {line} does: change both"
    return Finding(
        code,
        file.location(formula.span),
        certainty,
        said,
        dict(formula.roles),
        formula.spelled,
        related,
        no_fix=f"prose is its author's to change; the exact rule has {exact} there",
        severity="note",
    )


def _function_of(prose: Prose, file: ScannedFile) -> Function | None:
    """Find the function that a text is in, or stands right above."""
    first, last = prose.span.line, prose.span.end_line
    inside: Function | None = None
    below: Function | None = None
    for function in functions(file.everything().body):
        if function.span.line <= first and last <= function.span.end_line:
            inside = function  # those inside others come later
        elif below is None and 0 < function.span.line - last <= _LINES_ABOVE_A_FUNCTION:
            below = function
    return below if inside is None else inside


def _rule_of(formula: Formula, function: Function | None, file: ScannedFile) -> ReadSite | None:
    """Find the stopping rule that a formula stands beside."""
    line = formula.span.line

    def distance(read: ReadSite) -> int:
        return abs(read.site.span.line - line)

    beside = [
        read
        for read in file.sites
        if read.certainty is not None
        and (
            distance(read) <= _LINES_AROUND
            or (
                function is not None
                and function.span.line <= read.site.span.line <= function.span.end_line
            )
        )
    ]
    return min(beside, key=distance, default=None)
