# ruff: noqa: E501 -- a line of source under test stays one line
"""Rules that go wrong at an end: what is found, and what counts as a guard."""

import pytest

from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.rules import find_rule
from ransac_fix.scan.scanner import scan_source

RULE = find_rule("RFX005")
HEAD = "import math\nimport numpy as np\n\ndef ransac_trials(n_inliers, n_samples, k, s, most):\n"
RATIO = "    w = n_inliers / n_samples\n"


def messages(source: str, path: str = "ransac.py", language: str = "python") -> list[str]:
    findings, errors = scan_source(source, SourceFile(path, language, named=True), [RULE])
    assert not errors
    return [finding.message for finding in findings]


UNGUARDED = {
    "eight points": "    return np.log(1 - s) / np.log(1 - w**8)\n",
    "no inliers apart": (
        "    if n_inliers == 0:\n        return most\n    return np.log(1 - s) / np.log(1 - w**k)\n"
    ),
    "all inliers apart": (
        "    if n_inliers == n_samples:\n        return 1\n"
        "    return np.log(1 - s) / np.log(1 - w**7)\n"
    ),
    "too few data apart": (
        "    if n_samples <= k:\n        return 1\n    return np.log(1 - s) / np.log(1 - w**7)\n"
    ),
    "clamped from below": "    return np.log(1 - s) / np.log(max(1e-9, 1 - w**k))\n",
    "a limit after the quotient": "    return min(most, np.log(1 - s) / np.log(1 - w**5))\n",
    "an exact product": (
        "    if n_inliers == 0:\n        return most\n"
        "    p = 1.0\n    for i in range(k):\n        p *= (n_inliers - i) / (n_samples - i)\n"
        "    return np.log(1 - s) / np.log(1 - p)\n"
    ),
}


@pytest.mark.parametrize("body", UNGUARDED.values(), ids=UNGUARDED.keys())
def test_small_powers_that_nothing_keeps_away(body):
    (message,) = messages(HEAD + RATIO + body)
    assert "rounds to one" in message


GUARDED = {
    "clip": "    return np.log(1 - s) / np.log(np.clip(1 - w**k, 1e-9, 1 - 1e-9))\n",
    "min of the logarithm": "    return np.log(1 - s) / min(-1e-9, np.log(1 - w**k))\n",
    "a test of the power": (
        "    p = w**k\n    if p < 1e-12:\n        return most\n"
        "    return np.log(1 - s) / np.log(1 - p)\n"
    ),
    "a test of the complement": (
        "    d = 1 - w**k\n    if d == 1:\n        return most\n    return np.log(1 - s) / np.log(d)\n"
    ),
    "a test of the logarithm": (
        "    d = np.log(1 - w**k)\n    if d >= 0:\n        return most\n    return np.log(1 - s) / d\n"
    ),
    "a test of its truth": (
        "    d = np.log(1 - w**k)\n    if not d:\n        return most\n    return np.log(1 - s) / d\n"
    ),
    "a test of the result": (
        "    N = np.log(1 - s) / np.log(1 - w**k)\n    if N < 0:\n        N = most\n    return N\n"
    ),
    "a ratio kept away from zero": (
        "    if w < 0.01:\n        return most\n    return np.log(1 - s) / np.log(1 - w**k)\n"
    ),
    "more inliers than a sample": (
        "    if n_inliers < k:\n        return most\n    return np.log(1 - s) / np.log(1 - w**k)\n"
    ),
    "absolute": "    return abs(np.log(1 - s) / np.log(1 - w**k))\n",
    "isinf": ("    N = np.log(1 - s) / np.log(1 - w**k)\n    return most if np.isinf(N) else N\n"),
    "isfinite": (
        "    N = np.log(1 - s) / np.log(1 - w**k)\n    return N if np.isfinite(N) else most\n"
    ),
    "subtracted": "    return np.log(1 - s) / (np.log(1 - w**k) - 1e-9)\n",
    "conditional": (
        "    d = 1 - w**k\n    return np.log(1 - s) / np.log(d) if 0 < d < 1 else most\n"
    ),
    "four points": "    return np.log(1 - s) / np.log(1 - w**4)\n",
}


@pytest.mark.parametrize("body", GUARDED.values(), ids=GUARDED.keys())
def test_guarded_rules_are_silent(body):
    assert messages(HEAD + RATIO + body) == []


def test_a_test_of_the_ratio_guards_what_a_fix_makes_of_its_counts():
    source = (
        "import math\n"
        "def _all_inlier_probability(I, n, k):\n    p = 1.0\n"
        "    for i in range(k):\n        p *= max(I - i, 1) / max(n - i, 1)\n    return max(p, 2.0**-53) if I > 0 else p\n"
        "def ransac(points, k, s):\n    trials, t = 100, 0\n    while t < trials:\n"
        "        inliers = fit(points)\n        w = len(inliers) / len(points)\n"
        "        if w == 1:\n            break\n"
        "        p = _all_inlier_probability(len(inliers), len(points), k)\n"
        "        trials = math.log(1 - s) / math.log(1 - p)\n        t += 1\n"
    )
    inline = source.replace("        p = _all", "        q = _all").replace(
        "(1 - p)", "(1 - _all_inlier_probability(len(inliers), len(points), k))"
    )
    assert messages(inline) == []
    unguarded = inline.replace("w == 1", "t == 1")
    assert "ValueError" in messages(unguarded)[0]
    assert (
        messages(unguarded.replace("(1 - _all", "(max(1e-9, 1 - _all").replace("k))", "k)))")) == []
    )


def test_a_helper_that_is_called_with_small_samples_is_silent():
    source = (
        "import numpy as np\n"
        "def trials(w, k, s):\n    return np.log(1 - s) / np.log(1 - w**k)\n"
        "def ransac(points, fit):\n    N = 100\n    while N > 0:\n"
        "        w = len(fit(points)) / len(points)\n        N = min(N, trials(w, 3, 0.99))\n"
    )
    assert messages(source) == []
    assert len(messages(source.replace(", 3,", ", 8,"))) == 1


def test_what_nobody_guards_and_nobody_knows_is_silent():
    assert messages(HEAD + RATIO + "    return np.log(1 - s) / np.log(1 - w**k)\n") == []


def test_the_addition_inside_and_the_sign_of_a_guard():
    assert (
        "added"
        in messages(HEAD + RATIO + "    return np.log(1 - s) / np.log(1 - w**4 + 1e-8)\n")[0]
    )
    assert (
        "always wins"
        in messages(
            HEAD + RATIO + "    return np.log(1 - s) / np.maximum(1e-8, np.log(1 - w**4))\n"
        )[0]
    )


def test_all_inliers_and_the_logarithm_of_zero():
    source = (
        "import math\nimport numpy as np\n\ndef ransac(points, fit, s):\n"
        "    best, t, N = 0, 0, 1000\n    while t < N:\n        t += 1\n"
        "        best = max(best, len(fit(points)))\n"
        "        TEST\n"
        "        N = math.log(1 - s) / math.log(1 - (best / len(points)) ** 4)\n"
    )
    assert "raises ValueError" in messages(source.replace("TEST", ""))[0]
    assert messages(source.replace("TEST", "if best == len(points): break")) == []
    assert messages(source.replace("math.log", "np.log").replace("TEST", "")) == []


CPP = """
#include <cmath>
int Trials(int n_inliers, int n, int k, double s) {
  // ransac
  const double w = n_inliers / double(n);
  const double q = 1.0 - std::pow(w, k);
  GUARD
  return static_cast<int>(std::log(1.0 - s) / std::log(q));
}
"""


@pytest.mark.parametrize(
    ("guard", "found"),
    [
        ("", 1),
        ("if (n_inliers == 0) return 1;", 1),
        ("if (q >= 1.0 - 1e-12) return n;", 0),
        ("if (q < 1e-12 || q > 1.0 - std::numeric_limits<double>::epsilon()) return n;", 0),
    ],
)
def test_the_same_in_cpp(guard, found):
    assert len(messages(CPP.replace("GUARD", guard), "ransac.cpp", "c++")) == found
