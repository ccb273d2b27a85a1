"""RFX102, the confidence in another parameter's place."""

import re
from collections.abc import Iterator
from typing import ClassVar

from ransac_fix.scan.findings import Edit, Finding, Fix
from ransac_fix.scan.form import Call, Expr, Import, Name, Num, Span
from ransac_fix.scan.rules.base import Rule, ScannedFile
from ransac_fix.scan.walk import expressions

# Function of cv2 -> parameters, by place, that hold arrays and that OpenCV ignores numbers in.
_ARRAYS = {
    "findHomography": {4: "mask"},
    "estimateAffine3D": {2: "out", 3: "inliers"},
    "solvePnPRansac": {4: "rvec", 5: "tvec"},
}
_CONFIDENCE = re.compile(r"(?:^|_|\.)(?:conf|prob)", re.IGNORECASE)
_NUMBERS = re.compile(r"(?:^|_)(?:conf|prob|thresh)", re.IGNORECASE)


class MisplacedConfidence(Rule):
    """Confidence or threshold passed to OpenCV in the place of an array.

    What it does
    ------------
    Finds calls such as ``cv2.findHomography(a, b, cv2.RANSAC, 3.0, 0.99)``, whose fifth parameter
    is not the confidence but the mask.

    Why is this bad
    ---------------
    OpenCV takes the number without a word and ignores it. The confidence stays at its default.

    Use instead
    -----------
    .. code-block:: python

        cv2.findHomography(a, b, cv2.RANSAC, 3.0, confidence=0.99)

    Fix safety
    ----------
    Unsafe: ``confidence=`` is put before a number between 0 and 1, or a name that says so,
    where it is the last one without a name. OpenCV uses it then, and may return other models
    than before. What any other number was meant for is for its author to say.
    """

    code = "RFX102"
    name = "misplaced-confidence"
    summary = "confidence passed to OpenCV in the place of an array, where it is ignored"
    reads_everything = True
    valid: ClassVar[dict[str, str]] = {
        "By name.": """
import cv2

def fit(a, b):
    return cv2.findHomography(a, b, cv2.RANSAC, 3.0, confidence=0.99)
""",
        "After the mask and the number of iterations.": """
import cv2

H, mask = cv2.findHomography([], [], cv2.RANSAC, 3.0, None, 2000, 0.99)
""",
        "A function of that name from elsewhere.": """
from mylib import findHomography

H = findHomography([], [], 0, 3.0, 0.99)
""",
        "The confidence is the fifth here.": """
import cv2

F, mask = cv2.findFundamentalMat([], [], cv2.FM_RANSAC, 3.0, 0.99)
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "The mask of findHomography.": """
import cv2

def fit(a, b):
    return cv2.findHomography(a, b, cv2.RANSAC, 3.0, 0.99)
""",
        "By another name, and a name for the number.": """
from cv2 import RANSAC, findHomography as find

def fit(a, b, confidence):
    return find(a, b, RANSAC, 3.0, confidence)
""",
        "The first guess of solvePnPRansac.": """
import cv2 as cv

def pose(points, pixels, K):
    ok, rvec, tvec, inliers = cv.solvePnPRansac(points, pixels, K, None, 100, None)
    return ok
""",
    }

    def needs(self) -> tuple[bytes, ...]:
        """Ask for the name of the library."""
        return (b"cv2",)

    def concerns(self, lowered: bytes) -> bool:
        """Ask for every file that names cv2 and one of the functions."""
        return b"cv2" in lowered and any(name.lower().encode() in lowered for name in _ARRAYS)

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the calls."""
        if file.language == "c++":
            return  # the compiler refuses it there
        body = file.everything().body
        imported = {stmt.name: stmt.target for stmt in body if isinstance(stmt, Import)}
        seen: set[Span] = set()
        for expr, _, _ in expressions(body, None, 0):
            # `H, mask = call()` has the call once for each name it binds.
            if not isinstance(expr, Call) or expr.span is None or expr.span in seen:
                continue
            seen.add(expr.span)
            name = _of_opencv(expr, imported)
            for place, parameter in _ARRAYS.get(name, {}).items():
                if len(expr.args) > place and _is_number(expr.args[place]):
                    fix = _named(expr, place, file)
                    yield Finding(
                        self.code,
                        file.location(expr.span),
                        "high",
                        f"OpenCV ignores the number in the place of `{parameter}`: pass the"
                        " confidence by its name",
                        expression=" ".join(file.text.at(expr.span).split()),
                        fix=None if isinstance(fix, str) else fix,
                        no_fix=fix if isinstance(fix, str) else "",
                    )
                    break


def _named(call: Call, place: int, file: ScannedFile) -> Fix | str:
    """Pass a confidence by its name, where it is one."""
    value = call.args[place]
    if isinstance(value, Num):
        meant = 0 < value.value < 1
    else:
        meant = isinstance(value, Name) and _CONFIDENCE.search(value.name) is not None
    given = {name for name, _ in call.keywords}
    last = place == len(call.args) - 1 and "confidence" not in given
    if not meant or not last or value.span is None:
        return "what the number is meant for is for its author to say"
    source = file.source()
    if isinstance(source, str):
        return source
    spelled = file.text.at(value.span)
    edit = Edit(file.location(value.span), f"confidence={spelled}")
    return Fix("pass the confidence by its name", safe=False, edits=(edit,))


def _of_opencv(call: Call, imported: dict[str, str]) -> str:
    if isinstance(call.base, Name) and imported.get(call.base.name) == "cv2":
        return call.name
    target = imported.get(call.name, "") if call.base is None else ""
    return target.removeprefix("cv2.") if target.startswith("cv2.") else ""


def _is_number(expr: Expr) -> bool:
    if isinstance(expr, Name):
        return bool(_NUMBERS.search(expr.name.rpartition(".")[2]))
    return isinstance(expr, Num)
