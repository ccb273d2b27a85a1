"""The gates: what they set aside could not have been found, and what they keep is read alike."""

import ast
import io
import tokenize

import pytest

from ransac_fix.scan import facts, gates, triage
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.findings import Finding
from ransac_fix.scan.rules import all_rules, default_rules
from ransac_fix.scan.scanner import scan_data

RATIO_FROM_A_HELPER = """
import numpy as np

def bad_share(y):
    is_outlier = np.logical_or(y < -3, y > 3)
    return np.sum(is_outlier) / y.size

def ransac(y, p, k):
    outlier_ratio = bad_share(y)
    return np.log(1 - p) / np.log(1 - (1 - outlier_ratio) ** k)
"""
UNUSED_CONFIDENCE = """
def consensus(points, fit, confidence=0.99):
    best = []
    for _ in range(100):
        best = max(best, fit(points), key=len)
    return best
"""
# Bodies of a function of w, k, s, n, N and the module functions named beside them.
BODIES = {
    "a chance of missing that shrinks in a loop": """
    fail, trials = 1.0, 0
    while fail > 1 - s:
        trials += 1
        fail *= 1 - w**k
    return trials
""",
    "the same, without any power": """
    fail, trials = 1.0, 0
    while fail > 1 - s:
        trials += 1
        fail = fail * (1 - w * w * w)
    return trials
""",
    "by way of another name": """
    fail, miss = 1.0, 1 - w**k
    for trials in range(N):
        less = miss * fail
        fail = less
        if fail < 1 - s:
            break
""",
    "a power of products": """
    for trials in range(N):
        if (1 - w * w * w) ** trials < 1 - s:
            break
""",
    "the rule solved for the inliers": """
    return n * (1 - (1 - s) ** (1 / N)) ** (1 / k)
""",
    "solved for the inliers, for one size of sample": """
    return n * (1 - (1 - s) ** (1 / N)) ** (1 / 4)
""",
    "one by name": """
    one = 1.0
    return log(one - s) / log(one - w**k)
""",
    "taken away afterwards": """
    q = 1.0
    q -= w**k
    return log(1 - s) / log(q)
""",
    "minus the power less one": """
    return log(1 - s) / log(-(w**k - 1))
""",
    "exponentials": """
    return log(1 - s) / log1p(-exp(k * log(w)))
""",
    "expm1": """
    return log(1 - s) / log(-expm1(k * log(w)))
""",
    "a lambda": """
    missed = lambda p: 1 - p
    return log(1 - s) / log(missed(w**k))
""",
    "in an f-string": """
    return f"{log(1 - s) / log(1 - w**k):.0f} trials"
""",
    "in a comprehension": """
    return [log(1 - s) / log(1 - w**size) for size in range(2, k)]
""",
    "assigned in a condition": """
    if (q := 1 - w**k) > 0:
        return log(1 - s) / log(q)
""",
    "defined in branches": """
    if n:
        p = w**k
    else:
        p = w**4
    q = 1 - p if N else 1 - w**3
    return log(1 - s) / log(max(q, 1e-9))
""",
}
FILES = {
    "a name for the logarithm": """
from math import log as L
def ransac(w, k, s):
    return L(1 - s) / L(1 - w**k)
""",
    "a name for the logarithm of a module": """
import numpy as np
L = np.log
def ransac(w, k, s):
    return L(1 - s) / L(1 - w**k)
""",
    "through the parameters of a helper": """
from math import log
def quotient(a, b):
    return log(a) / log(b)
def ransac(w, k, s):
    return quotient(1 - s, 1 - w**k)
""",
    "by the names of parameters": """
from math import log
def trials(*, top, bottom):
    return log(top) / log(bottom)
def ransac(w, k, s):
    return trials(bottom=1 - w**k, top=1 - s)
""",
    "through the result of a helper that stands below": """
from math import log
def ransac(w, k, s):
    return log(1 - s) / log(missed(w, k))
def missed(w, k):
    return 1 - w**k
""",
    "through attributes": """
from math import log
class Ransac:
    def __init__(self, w, k, s):
        self.miss = 1 - w**k
        self.s = s
    def trials(self):
        return log(1 - self.s) / log(self.miss)
""",
    "through a property": """
from math import log
class Ransac:
    @property
    def miss(self):
        return 1 - self.w**self.k
    def trials(self, s):
        return log(1 - s) / log(self.miss)
""",
    "constants of the module": """
from math import log
W, K = 0.5, 4
MISS = 1 - W**K
RANSAC_TRIALS = log(1 - 0.99) / log(MISS)
""",
    "a function inside": """
from math import log
def ransac(w, k):
    miss = 1 - w**k
    def trials(s):
        return log(1 - s) / log(miss)
    return trials(0.99)
""",
}

ONE_POWER_AND_A_SQUARE = """
def ransac(votes, confidence):
    n = best = 0
    while True:
        n += 1
        best = max(best, votes())
        if 1 - pow(1 - best * best, n) > confidence:
            return best
"""
NO_POWER_SIGN = """
def ransac(votes, confidence):
    failure, best = 1.0, 0
    while failure > 1 - confidence:
        best = max(best, votes())
        failure *= 1 - best * best * best
    return best
"""

A_PROPERTY = """
from math import log

class Ransac:
    @property
    def miss(self):
        return log(1 - self.confidence)

    def trials(self, w):
        return self.miss / log(1 - w**self.k)
"""


def found(source: str, *, gate: bool) -> tuple[Finding, ...]:
    file = SourceFile("a.py", "python", named=False)
    return scan_data(source.encode(), file, gate=gate).findings


@pytest.mark.parametrize(
    ("source", "code"),
    [
        (RATIO_FROM_A_HELPER, "RFX001"),
        (UNUSED_CONFIDENCE, "RFX006"),
        (ONE_POWER_AND_A_SQUARE, "RFX001"),
        (NO_POWER_SIGN, "RFX001"),
        (A_PROPERTY, "RFX001"),
    ],
)
def test_what_is_found_without_them_is_found_with_them(source, code):
    with_gates = found(source, gate=True)
    assert [one.code for one in with_gates] == [code]
    assert with_gates == found(source, gate=False)


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_no_form_of_a_rule_is_lost(body):
    source = f"from math import *\n\ndef ransac_trials(w, k, s, n, N):{body}"
    without = found(source, gate=False)
    assert without
    assert found(source, gate=True) == without


@pytest.mark.parametrize("source", FILES.values(), ids=FILES)
def test_no_way_through_a_file_is_lost(source):
    without = found(source, gate=False)
    assert without
    assert found(source, gate=True) == without


@pytest.mark.parametrize("rule", all_rules(), ids=lambda rule: rule.code)
def test_the_examples_of_a_rule_pass(rule):
    for source in rule.invalid.values():
        path = "a.cpp" if "#include" in source or "std::" in source else "a.py"
        assert gates.gate_for((rule,)).keeps(path, source.encode())


@pytest.mark.parametrize(
    ("path", "data", "kept"),
    [
        ("a.py", b"x = 1\n", False),
        ("a.py", b"# RANSAC\n", True),
        ("a.py", b"class PointCloud: pass\n", True),
        ("RanSac/a.py", b"x = 1\n", True),
        ("a.py", b"x = 1  # noqa: RFX001\n", True),
        ("a.py", b"prefix = 1\n", False),
        ("a.py", b"import cv2\n", False),
        ("a.py", b"import cv2\ncv2.findHomography(a, b)\n", True),
    ],
)
def test_bytes_are_searched_for_the_words_of_the_rules(path, data, kept):
    assert gates.gate_for(default_rules()).keeps(path, data) is kept


@pytest.mark.parametrize(
    "source",
    [
        "from math import log\nx = log(1 - 0.99)\n",  # an inlier ratio without a power
        "import numpy as np\ndef outliers(x):\n    return np.log(1 + x**2)\n",
        "def inliers(x, p):\n    return (1 - x) ** p < 3\n",
        "def consensus(b, t, lr):\n    return lr / (1 - b**t)\n",
    ],
)
def test_what_takes_no_power_of_a_complement_of_a_power_is_not_read(source):
    tree = ast.parse(source)
    assert not facts.may_hold_a_rule(tree)


@pytest.mark.parametrize(
    "module", [ast, io, tokenize, facts, pytest], ids=lambda module: module.__name__
)
def test_comments_and_strings_are_told_from_code_as_python_does(module):
    with open(module.__file__, encoding="utf-8") as stream:  # noqa: PTH123
        source = stream.read()

    def tokens(text: str) -> list[str]:
        skipped = (tokenize.COMMENT, tokenize.NL, tokenize.STRING)
        read = tokenize.generate_tokens(io.StringIO(text).readline)
        return [one.string for one in read if one.type not in skipped]

    code = triage.split(source)[0]
    assert code.count("\n") == source.count("\n")
    assert tokens(code) == tokens(source)


@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("a = 1 # 'b\nc = 'd'", 'a = 1 \nc = ""'),
        ("a = '''b # c\n''' # d", 'a = ""\n '),
        ("a = rf'{b}' + rb'c'", "a = rf'{b}' + rb\"\""),
        ("print('a')", 'print("")'),
        (r"a = '\'' + 'b'", 'a = "" + ""'),
        ('a = "it\'s" # "', 'a = "" '),
    ],
)
def test_strings_and_comments_are_blank(source, code):
    assert triage.split(source)[0] == code


def test_comments_of_cpp_are_blank():
    source = 'int a; // log(1 - p)\n/* pow(w, k)\n */ char b = \'"\'; f("// c");\n'
    assert triage.split(source, "c++")[0] == 'int a; \n\n char b = ""; f("");\n'
