"""Which functions are followed: all that could show a rule, and few others."""

import pytest

from ransac_fix.scan import cpp, python
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.relevance import relevance
from ransac_fix.scan.scanner import scan_source

SOURCE = """
import math
from math import log as take

class Ransac:
    def __init__(self, points):
        self.ratio = 0.5
        self.colour = "red"

    def draw(self):
        self.colour = self.colour + "ish"

    def update(self, inliers):
        self.ratio = len(inliers) / len(self.points)

    def trials(self, k):
        return self.missed() / take(1 - self.ratio**k)

    def missed(self):
        return self.two() * 0.5

    def two(self):
        return 2

def shown(model):
    return Ransac(model).trials(3)

def unrelated(a, b):
    return a * b + 1
"""


def names(found) -> list[str]:
    return [one.name for one in found]


def test_shows_what_computes_and_what_names_it():
    found = relevance(python.parse(SOURCE).body)
    assert names(found.showing) == ["trials", "shown"]


def test_needs_what_those_call_and_what_sets_their_members():
    found = relevance(python.parse(SOURCE).body)
    assert names(found.needed) == ["__init__", "update", "trials", "missed", "two", "shown"]


@pytest.mark.parametrize(
    "body",
    [
        "    return x ** k",
        "    return np.power(x, k)",
        "    f = math.log\n    return f(x)",
        "    from math import log as f\n    return f(x)",
        "    return alias(x)",
        "    return log_of_x",
        "    for i in y:\n        x *= y",
        "    for i in y:\n        z = x * y\n        x = z",
        "    while y:\n        x = x - x * y",
        "    return list(map(lambda one: math.exp(one), x))",
        "    def inner():\n        return math.log(x)\n    return inner()",
    ],
)
def test_takes_logarithms_powers_and_products_in_any_form(body):
    source = f"from math import log as alias\ndef f(x, y, k):\n{body}\n"
    assert names(relevance(python.parse(source).body).showing)[0] == "f"


@pytest.mark.parametrize(
    "body",
    ["    return x * x", "    for i in y:\n        x += y * i", "    return math.sqrt(x * x)"],
)
def test_leaves_other_arithmetic_alone(body):
    source = f"def f(x, y):\n{body}\n"
    assert relevance(python.parse(source).body).showing == ()


def test_members_of_cpp_reach_the_function_that_names_them():
    source = """struct Ransac {
  double p_; int k_;
  void set(double w) { p_ = pow(w, k_); }
  double trials() { return top_ / bottom(); }
  double bottom() { return log(1 - p_); }
  void draw() { x_ = x_ + 1; }
};"""
    assert names(relevance(cpp.parse(source).body).showing) == ["set", "trials", "bottom"]


@pytest.mark.parametrize("name", ["log", "log10"])
def test_a_logarithm_under_another_name_is_found(name):
    source = f"""
from math import {name} as take

def ransac_trials(n_inliers, n, k, s):
    return take(1 - s) / take(1 - (n_inliers / n)**k)
"""
    findings, _ = scan_source(source, SourceFile("a.py", "python", named=True))
    assert "RFX001" in [one.code for one in findings]
