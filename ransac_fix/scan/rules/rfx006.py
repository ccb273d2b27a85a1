"""RFX006, the confidence that is not used."""

import re
from collections.abc import Iterator
from typing import ClassVar

from ransac_fix.scan import words
from ransac_fix.scan.findings import Finding
from ransac_fix.scan.form import Call, Function, If, Loop, Name, Stmt
from ransac_fix.scan.rules.base import Rule, ScannedFile
from ransac_fix.scan.walk import expressions, functions

_CONFIDENCE = re.compile(
    r"(?:stop_?|success_?|desired_?|wanted_?|ransac_?)?(?:confidence|conf|prob(?:ability)?)"
    r"|prob(?:ability)?_(?:of_)?success"
)
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
# Followed by parameters, of types or of values.
_NAMED_SO = re.compile(rb"(?:ransac|consensus)\w*\s*[(\[]")


class UnusedConfidence(Rule):
    """Confidence that a RANSAC function takes and does not use.

    What it does
    ------------
    Finds functions with RANSAC in their name and a loop in their body that take a parameter such
    as ``confidence`` or ``stop_probability`` and never read it. In C and C++ nothing may name it
    again, not even a macro, a pragma or ``(void)confidence``; a parameter without a name is not
    looked at.

    Why is this bad
    ---------------
    Who calls the function believes to have chosen how likely it is that no better model was
    missed. What was chosen is the number of trials alone.

    Use instead
    -----------
    End the loop at ``ransac_fix.required_trials(n_inliers, n_samples, sample_size, confidence)``
    trials, worked out again whenever a better model is found; or take the parameter away.

    Fix safety
    ----------
    There is no fix: it takes a rule that is not there.
    """

    code = "RFX006"
    name = "unused-confidence"
    summary = "confidence that a RANSAC function takes and does not use"
    reads_everything = True
    valid: ClassVar[dict[str, str]] = {
        "It is used.": """
def ransac(points, fit, confidence=0.99):
    trials = 100
    while trials > 0:
        inliers = fit(points)
        trials = min(trials, required_trials(len(inliers), len(points), 3, confidence))
""",
        "Nothing is done here: a stub, or an interface.": """
def ransac(points, confidence=0.99):
    raise NotImplementedError
""",
        "It is handed on.": """
def ransac(points, fit, confidence=0.99, **options):
    for _ in range(9):
        fit(points, stop=confidence)
""",
    }
    cpp_valid: ClassVar[dict[str, str]] = {
        "A macro sees it.": """
Model ransac(const Points& points, double confidence, int max_trials) {
  Model best;
  for (int trial = 0; trial < TRIALS(confidence, max_trials); ++trial) best.improve(points);
  return best;
}
""",
        "It has no name: the interface asks for it.": """
Model ransac(const Points& points, double /*confidence*/, int max_trials) {
  Model best;
  for (int trial = 0; trial < max_trials; ++trial) best.improve(points);
  return best;
}
""",
    }
    cpp_invalid: ClassVar[dict[str, str]] = {
        "The same in C++.": """
Model ransac(const Points& points, double confidence = 0.99, int max_trials = 100) {
  Model best;
  for (int trial = 0; trial < max_trials; ++trial) best.improve(points);  // confidence: later
  return best;
}
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "A fixed number of trials.": """
def ransac(points, fit, confidence=0.99, max_trials=100):
    best = []
    for _ in range(max_trials):
        inliers = fit(points)
        best = max(best, inliers, key=len)
    return best
""",
        "A method.": """
class RansacPlane:
    def fit_ransac(self, points, stop_probability):
        for _ in range(self.max_trials):
            self.step(points)
""",
    }

    def needs(self) -> tuple[bytes, ...]:
        """Ask for the words that the name of such a function has."""
        return (b"ransac", b"consensus")

    def concerns(self, lowered: bytes) -> bool:
        """Ask for every file that may define something named after RANSAC and a probability."""
        if b"ransac" not in lowered and b"consensus" not in lowered:
            return False
        named = b"conf" in lowered or b"prob" in lowered
        return named and _NAMED_SO.search(lowered) is not None

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the parameters that nothing reads."""
        for function in functions(file.everything().body):
            if not _has_loop(function.body) or not words.is_ransac(function.name):
                continue
            read = _names_read(function)
            for one in function.parameters:
                wanted = _CONFIDENCE.fullmatch(one.name.lower()) and one.span is not None
                if not wanted or one.name in read or "locals" in read:
                    continue
                if file.language == "c++" and _is_written_again(one.name, function, file):
                    continue
                yield Finding(
                    self.code,
                    file.location(one.span or function.span),
                    "medium",
                    f"{function.name} takes {one.name} and does not use it: it decides nothing",
                    {"confidence": one.name},
                    one.name,
                )


def _is_written_again(name: str, function: Function, file: ScannedFile) -> bool:
    """Whether a parameter is named in its function at all, such as by a macro or a pragma."""
    code = _COMMENT.sub(" ", file.text.block(function.span))
    return len(re.findall(rf"\b{re.escape(name)}\b", code)) > 1


def _has_loop(body: tuple[Stmt, ...]) -> bool:
    return any(
        isinstance(stmt, Loop)
        or (isinstance(stmt, If) and (_has_loop(stmt.body) or _has_loop(stmt.orelse)))
        for stmt in body
    )


def _names_read(function: Function) -> set[str]:
    found: set[str] = set()
    for expr, _, _ in expressions(function.body, function, 0):
        if isinstance(expr, Name):
            found.add(expr.name.partition(".")[0])
        elif isinstance(expr, Call) and expr.base is None:
            found.add(expr.name)
    return found
