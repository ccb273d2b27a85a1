# ruff: noqa: E501 -- a line of source under test stays one line
"""What the recogniser makes of each form: approximate, exact, with replacement, or nothing."""

import pytest

from ransac_fix.scan import python
from ransac_fix.scan.facts import may_hold_a_rule
from ransac_fix.scan.reading import Text
from ransac_fix.scan.scanner import read
from ransac_fix.scan.triage import could_hold_a_rule, split


def sites(source: str, path: str = "ransac.py"):
    found = read(python.parse(source), Text(source), path)
    if found:
        # What is recognised anywhere in these tests the gates let through.
        assert could_hold_a_rule(split(source)[0])
        assert may_hold_a_rule(python.tree(source))
    return found


def kinds(source: str) -> list[str]:
    return [found.site.probability.kind for found in sites(source)]


def rule(power: str, *, before: str = "", top: str = "log(1 - s)", log: str = "log") -> str:
    """Write a rule whose bottom is ``log(1 - power)``."""
    return (
        "from math import *\nimport numpy as np\nimport scipy\n"
        f"def ransac_trials(I, n, k, s, w, e):\n{before}"
        f"    return {top} / {log}(1 - {power})\n"
    )


APPROXIMATE = {
    "operator": "w**k",
    "pow": "pow(w, k)",
    "np.power": "np.power(w, k)",
    "float_power": "np.float_power(w, k)",
    "method": "w.pow(k)",
    "literal": "w**4",
    "inline ratio": "(I / n) ** k",
    "powers apart": "I**k / n**k",
    "outliers": "(1 - e) ** k",
    "outlier count": "((n - I) / n) ** k",
    "square": "np.square(w)",
    "cube": "cube(w)",
    "a power function of one's own": "fastpow(w, k)",
    "another": "int_pow(w, k)",
    "numpy under another name": "np.core.power(w, k)",
    "tensor power": "torch.pow(torch.tensor(w), k)",
    "jax": "jnp.power(w, k)",
    "chosen exponent": "w ** (3 if k else 4)",
    "written out": "w * w * w",
    "a number written out": "0.7 * 0.7",
    "written out ratio": "(I / n) * (I / n)",
    "counts written out": "I * I * I / (n * n * n)",
    "exp of log": "exp(k * log(w))",
    "exp of log, other order": "np.exp(np.log(w) * k)",
    "cast": "float(w) ** int(k)",
    "clipped": "min(max(w, 1e-9), 1 - 1e-9) ** k",
    "product of equal factors": "np.prod([w] * 0 + [w, w, w])",
    "product of a repeated list": "np.prod([w] * k)",
    "product in a comprehension": "prod(w for _ in range(k))",
    "prefactor": "(1 / 3) * w**k",
    "reduced over a range": "reduce(lambda p, _: p * w, range(k), 1.0)",
    "reduced by a ufunc": "np.multiply.reduce([w] * k)",
    "product of an array of equal factors": "np.prod(w * np.ones(k))",
    "the inverse to a negative power": "(n / I) ** -k",
    "a power of e": "np.e ** (k * log(w))",
    "a power of two": "2 ** (k * np.log2(w))",
    "entries of a dictionary": "c['w'] * c['w'] * c['w']",
    "a power in a record": "dict(p=w**k)['p']",
}
EXACT = {
    "comb": "comb(I, k) / comb(n, k)",
    "scipy comb": "scipy.special.comb(I, k) / scipy.special.comb(n, k)",
    "pair": "I * (I - 1) / (n * (n - 1))",
    "pair of ratios": "(I / n) * ((I - 1) / (n - 1))",
    "triple": "I*(I-1)*(I-2) / (n*(n-1)*(n-2))",
    "factorials": "factorial(I) * factorial(n - k) / (factorial(I - k) * factorial(n))",
    "gamma": "gamma(I+1) / gamma(I-k+1) / gamma(n+1) * gamma(n-k+1)",
    "lgamma": "exp(lgamma(I+1) - lgamma(I-k+1) - lgamma(n+1) + lgamma(n-k+1))",
    "hypergeom": "scipy.stats.hypergeom.pmf(k, n, I, k)",
    "perm": "perm(I, k) / perm(n, k)",
    "sum of an array": "exp(np.sum(np.log(I - np.arange(k)) - np.log(n - np.arange(k))))",
    "two arrays": "np.prod(np.arange(I - k + 1, I + 1) / np.arange(n - k + 1, n + 1))",
    "comprehension": "prod((I - i) / (n - i) for i in range(k))",
    "two ranges": "prod(a / b for a, b in zip(range(I, I - k, -1), range(n, n - k, -1)))",
    "reduced": "reduce(lambda p, i: p * (I - i) / (n - i), range(k), 1.0)",
    "array": "np.prod((I - np.arange(k)) / (n - np.arange(k)))",
    "array method": "((I - np.arange(k)) / (n - np.arange(k))).prod()",
    "sum of logarithms": "exp(sum(log((I - i) / (n - i)) for i in range(k)))",
}
OTHER = {
    "a plain rate": "w",
    "a root": "w ** (1 / k)",
    "a power of two": "2**k",
    "a large factor": "4 * e**2",
    "a large number written out": "2 * 2 * e",
    "two rates": "0.7 * 0.5",
    "one inlier ratio": "I / n",
}


@pytest.mark.parametrize("power", APPROXIMATE.values(), ids=APPROXIMATE.keys())
def test_reads_as_approximate(power):
    assert kinds(rule(power)) == ["approximate"]


@pytest.mark.parametrize("power", EXACT.values(), ids=EXACT.keys())
def test_reads_as_exact(power):
    assert kinds(rule(power)) == ["exact"]


@pytest.mark.parametrize("power", OTHER.values(), ids=OTHER.keys())
def test_reads_as_something_else(power):
    assert kinds(rule(power)) == []


LOOPS = {
    "for": "    p = 1.0\n    for i in range(k):\n        p *= (I - i) / (n - i)\n",
    "downwards": "    p = 1\n    for i in range(k - 1, -1, -1):\n        p = p * (I - i) / (n - i)\n",
    "other order": "    p = 1.0\n    for i in range(k):\n        p = (I - i) / (n - i) * p\n",
    "while": "    p, i = 1.0, 0\n    while i < k:\n        p *= (I - i) / (n - i)\n        i += 1\n",
    "counts counted down": (
        "    p = 1.0\n    for _ in range(k):\n        p *= I / n\n        I -= 1\n        n -= 1\n"
    ),
    "zip": (
        "    p = 1.0\n    for a, b in zip(range(I, I - k, -1), range(n, n - k, -1)):\n        p *= a / b\n"
    ),
    "two products": (
        "    a = b = 1\n    for i in range(k):\n        a *= I - i\n        b *= n - i\n    p = a / b\n"
    ),
    "sum of logarithms": (
        "    t = 0.0\n    for i in range(k):\n        t += log(I - i) - log(n - i)\n    p = exp(t)\n"
    ),
}


def test_reads_a_product_that_calls_itself_as_exact():
    source = (
        "from math import log\n"
        "def P(I, n, k): return 1 if k == 0 else I / n * P(I - 1, n - 1, k - 1)\n"
        "def f(I, n, k, s): return log(1 - s) / log(1 - P(I, n, k))\n"
    )
    assert kinds(source) == ["exact"]


@pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS.keys())
def test_reads_product_loops_as_exact(loop):
    assert kinds(rule("p", before=loop)) == ["exact"]


def test_reads_a_loop_over_equal_factors_as_approximate():
    loop = "    p = 1.0\n    for _ in range(k):\n        p *= w\n"
    assert kinds(rule("p", before=loop)) == ["approximate"]


def test_reads_a_falling_numerator_over_a_power_as_replacement():
    loop = "    p = 1.0\n    for i in range(k):\n        p *= (I - i) / n\n"
    assert kinds(rule("p", before=loop)) == ["replacement"]


WHOLE = {
    "base named": "def f(w, k, s):\n    base = 1 - w**k\n    return log(1 - s, base)",
    "difference of logarithms": (
        "def f(w, k, s, log_eta, A):\n"
        "    return (log(1 - s) - log_eta) / log(1 - w**k * (1 - 1 / A))"
    ),
    "negated power, then a sum": (
        "def f(e, k, s):\n    minus = -exp(k * log(1.0 - e))\n    d = log(1.0 + minus)\n"
        "    return log(1.0 - s) / d"
    ),
    "multiplied in a loop that counts down": (
        "def f(w, k, s):\n    p = w * w\n    while k > 2:\n        p *= w\n        k -= 1\n"
        "    return log(1 - s) / log(1 - p)"
    ),
    "a name that is a function elsewhere": (
        "def f(w, k, s):\n    log1p = log(1 - s)\n    return int(log1p / log(1 - w**k))"
    ),
    "the confidence shadowed": (
        "def f(w, k):\n    p = 1 - w**k\n    p = max(1e-16, p)\n    return log(1 - p) / log(p)"
    ),
    "a module that nothing here knows": (
        "def f(w, k, s): return ms.ops.log(1 - s) / ms.ops.log(1 - ms.ops.pow(w, k))"
    ),
    "a logarithm of one's own": ("def f(w, k, s): return safe_log(1 - s) / safe_log(1 - w**k)"),
    "reduced": (
        "from functools import reduce\nfrom operator import mul\n"
        "def f(w, k, s): return log(1 - s) / log(1 - reduce(mul, [w] * k))"
    ),
    "reduced by a lambda": (
        "def f(w, k, s): return log(1 - s) / log(1 - reduce(lambda a, b: a * b, [w] * k))"
    ),
    "exp of a difference of logarithms": (
        "def f(I, n, k, s): return log(1 - s) / log(1 - exp(k * (log(I) - log(n))))"
    ),
    "a test by an exponential": (
        "def f(w, k, s, N):\n    if 1 - exp(N * log(1 - w**k)) > s:\n        return True"
    ),
    "a failure probability made smaller": (
        "def f(w, k):\n    failure = 1\n    while True:\n        failure = failure * (1 - w**k)\n"
        "        if failure < 0.01:\n            break"
    ),
    "an assumed ratio written out": (
        "def f(s):\n    v = 0.6\n    u = 1.0 - v\n    return log(1 - s) / log(1 - u * u * u)"
    ),
    "the ratio of a first sample, written out": (
        "def f(points, s):\n    r = 2.0 / len(points)\n    return log(1 - s) / log(1 - r * r)"
    ),
    "log1p": "def f(w, k, s): return log1p(-s) / log1p(-w**k)",
    "log10": "def f(w, k, s): return log10(1 - s) / log10(1 - w**k)",
    "log2": "def f(w, k, s): return np.log2(1 - s) / np.log2(1 - w**k)",
    "two arguments": "def f(w, k, s): return log(1 - s, 1 - w**k)",
    "floor division": "def f(w, k, s): return log(1 - s) // log(1 - w**k)",
    "divide": "def f(w, k, s): return np.divide(np.log(1 - s), np.log(1 - w**k))",
    "inverse factor": "def f(w, k, s): return log(1 - s) * (1 / log(1 - w**k))",
    "reciprocal": "def f(w, k, s): return log(1 - s) * np.reciprocal(log(1 - w**k))",
    "negated": "def f(w, k, s): return -log(1 - s) / -log(1 - w**k)",
    "multiplied": "def f(w, k, s): return 3 * log(1 - s) / log(1 - w**k)",
    "numerator named": "def f(w, k, log_probability): return log_probability / log(1 - w**k)",
    "numerator worked out": "def f(w, k): return -4.6 / log(1 - w**k)",
    "failure probability": "def f(w, k, failure): return log(failure) / log(1 - w**k)",
    "guard inside": "def f(w, k, s): return log(1 - s) / log(1 - w**k + 1e-12)",
    "guard outside": "def f(w, k, s): return log(1 - s) / (log(1 - w**k) + 1e-12)",
    "machine epsilon": (
        "def f(w, k, s):\n    return log(1 - s) / log(max(np.finfo(float).eps, 1 - w**k))"
    ),
    "alias": "ln = log\ndef f(w, k, s): return ln(1 - s) / ln(1 - w**k)",
    "alias import": "from math import log as L\ndef f(w, k, s): return L(1 - s) / L(1 - w**k)",
    "conditional": (
        "def f(w, k, s): return log(1 - s) / log(1 - w**k) if 0 < w < 1 else float('inf')"
    ),
    "conditional inside": (
        "def f(w, k, s):\n    d = 1 - w**k\n    return log(1 - s) / (log(d) if d > 0 else -1e-9)"
    ),
    "rebound": "def f(w, k, s):\n    d = 1 - w**k\n    d = log(d)\n    return log(1 - s) / d",
    "clamps over lines": (
        "def f(w, k, s):\n    d = w**k\n    d = max(1e-9, d)\n    d = min(1 - 1e-9, d)\n"
        "    return log(1 - s) / log(1 - d)"
    ),
    "guard by assignment": (
        "def f(w, k, s):\n    d = 1 - w**k\n    if d < 1e-12:\n        d = 1e-12\n"
        "    return log(1 - s) / log(d)"
    ),
    "tensors of ones": (
        "import torch\ndef f(w, k, s):\n"
        "    return torch.log(1 - s) / torch.log(torch.ones_like(w) - w**k)"
    ),
    "tensor methods": "def f(w, k, s): return (1 - s).log() / (1 - w.pow(k)).log()",
    "where": (
        "def f(w, k, s):\n    d = np.where(w > 0, 1 - w**k, 1.0)\n    return log(1 - s) / log(d)"
    ),
    "helper": "def p(w, k): return w**k\ndef f(a, b, s): return log(1 - s) / log(1 - p(a, b))",
    "helper for the whole denominator": (
        "def q(w, k):\n    d = 1 - w**k\n    return log(d)\ndef f(a, b, s): return log(1 - s) / q(a, b)"
    ),
    "power passed to the helper": (
        "def t(p, s): return log(1 - s) / log(1 - p)\ndef f(w, k): return t(w**k, 0.99)"
    ),
    "lambda": "p = lambda w, k: w**k\ndef f(a, b, s): return log(1 - s) / log(1 - p(a, b))",
    "method": (
        "class A:\n    def p(self, w): return w**self.k\n"
        "    def f(self, w, s): return log(1 - s) / log(1 - self.p(w))"
    ),
    "attributes": (
        "class A:\n    def __init__(self, w, k):\n        self.d = log(1 - w**k)\n"
        "    def f(self, s):\n        self.N = log(1 - s) / self.d\n        return self.N"
    ),
    "tuple": "def f(w, k, s):\n    a, b = log(1 - s), log(1 - w**k)\n    return a / b",
    "walrus": "def f(w, k, s):\n    if (d := 1 - w**k) > 0:\n        return log(1 - s) / log(d)",
    "break test": (
        "def f(w, s):\n    N = 0\n    while True:\n        N += 1\n"
        "        if 1 - (1 - w**3) ** N > s:\n            break"
    ),
    "break test the other way": (
        "def f(w, s):\n    N = 0\n    while True:\n        N += 1\n"
        "        if (1 - w**3) ** N < 1 - s:\n            break"
    ),
    "loop condition": (
        "def f(w, k, s):\n    good, N = 0.0, 0\n    while good < s:\n        N += 1\n"
        "        good = 1 - (1 - w**k) ** N"
    ),
    "test of logarithms": (
        "def f(w, k, s):\n    N = 0\n    while N * log(1 - w**k) > log(1 - s):\n        N += 1"
    ),
    "test of logarithms, by the number of trials": (
        "def f(w, k, s):\n    for N in range(1, 1000):\n"
        "        if log(1 - s) / N > log(1 - w**k):\n            break"
    ),
    "property": (
        "class A:\n    @property\n    def p(self): return self.w**self.k\n"
        "    def f(self, s): return log(1 - s) / log(1 - self.p)"
    ),
    "numpy's logn": "def f(w, k, s): return np.emath.logn(1 - w**k, 1 - s)",
    "failure multiplied in each run": (
        "def f(w, k, s):\n    miss = 1.0\n    while True:\n        miss *= 1 - w**k\n"
        "        if miss < 1 - s:\n            break"
    ),
    "failure multiplied, tested by the loop": (
        "def f(w, k, s):\n    miss = 1.0\n    while miss > 1 - s:\n        miss = miss * (1 - w**k)"
    ),
    "failure multiplied by what the best model so far gives": (
        "def f(data, k, s):\n    miss, best = 1.0, 0\n    while True:\n"
        "        best = max(best, count(data))\n        miss *= 1 - (best / len(data))**k\n"
        "        if miss < 1 - s:\n            break"
    ),
    "tensorflow": (
        "import tensorflow as tf\n"
        "def f(w, k, s): return tf.math.log(1.0 - s) / tf.math.log(1.0 - tf.pow(w, k))"
    ),
    "module level": "w, k, s = 0.5, 4, 0.99\nN = log(1 - s) / log(1 - w**k)",
    "nested function": (
        "def f(w, k):\n    def g(s):\n        return log(1 - s) / log(1 - w**k)\n    return g(0.99)"
    ),
    "a factor worked out before": (
        "def f(w, k, s):\n    factor = 1.0 / log(1 - w**k)\n    return log(1 - s) * factor"
    ),
    "a type of an unknown module": (
        "from decimal import Decimal\n"
        "def f(w, k, s): return (Decimal(1) - s).ln() / (Decimal(1) - Decimal(w) ** k).ln()"
    ),
    "numerator worked out elsewhere": "def f(w, k, top): return top / log(1 - w**k)",
    "logarithms of a list": (
        "def f(w, k, s):\n    a, b = np.log([1 - s, 1 - w**k])\n    return a / b"
    ),
    "logarithms of an array": (
        "def f(w, k, s):\n    logs = np.log(1 - np.array([s, w**k]))\n    return logs[0] / logs[1]"
    ),
    "logarithms mapped": (
        "import math\ndef f(w, k, s):\n    a, b = map(math.log, (1 - s, 1 - w**k))\n    return a / b"
    ),
    "logarithms in a comprehension": (
        "def f(w, k, s):\n    a, b = [log(x) for x in (1 - s, 1 - w**k)]\n    return a / b"
    ),
    "a dictionary written out": (
        "def f(w, k, s):\n    d = {'good': w**k, 'miss': 1 - s}\n    return log(d['miss']) / log(1 - d['good'])"
    ),
    "a dictionary filled": (
        "def f(w, k, s):\n    d = {}\n    d['top'] = log(1 - s)\n    d['bottom'] = log(1 - w**k)\n"
        "    return d['top'] / d['bottom']"
    ),
    "a record": (
        "from types import SimpleNamespace\ndef f(w, k, s):\n"
        "    d = SimpleNamespace(good=w**k)\n    return log(1 - s) / log(1 - d.good)"
    ),
    "a dictionary of an object": (
        "class A:\n    def __init__(self, w, k):\n        self.d = {'good': w**k}\n"
        "    def f(self, s): return log(1 - s) / log(1 - self.d['good'])"
    ),
    "in place": "def f(w, k, s):\n    d = 1 - w.pow_(k)\n    d.log_()\n    return log(1 - s) / d",
    "reversed subtraction": "import torch\ndef f(w, k, s): return log(1 - s) / torch.rsub(w.pow(k), 1).log()",
    "division that allows zero": (
        "import tensorflow as tf\ndef f(w, k, s):\n"
        "    return tf.math.divide_no_nan(tf.math.log(1.0 - s), tf.math.log(1.0 - w**k))"
    ),
    "logarithms of the inverse": "def f(w, k, s): return log(1 / (1 - s)) / log(1 / (1 - w**k))",
    "a logarithm less another": "def f(w, k, s): return -log(1 - s) / (log(1) - log(1 - w**k))",
    "the bad samples over all": (
        "def f(I, n, k, s): return log(1 - s) / log((n**k - I**k) / n**k)"
    ),
    "the bad samples over all, in logarithms": (
        "def f(I, n, k, s): return log(1 - s) / (log(n**k - I**k) - k * log(n))"
    ),
    "a default": "def f(N=log(1 - 0.99) / log(1 - 0.5**4)): return N",
    "a function for complements": (
        "def q(x): return 1 - x\ndef f(w, k, s): return log(q(s)) / log(q(w**k))"
    ),
    "the condition of a generator": (
        "from itertools import count\n"
        "def f(w, k, s): return next(N for N in count(1) if 1 - (1 - w**k) ** N >= s)"
    ),
    "a comparison by a function": "def f(w, k, s, N): return np.less((1 - w**k) ** N, 1 - s)",
    "a comparison by a method": "def f(w, k, s, N): return ((1 - w**k) ** N).lt(1 - s)",
    "a comparison with zero": "def f(w, k, s, N): return (1 - w**k) ** N - (1 - s) <= 0",
    "logarithms added up": (
        "def f(fit, k, s):\n    miss = 0.0\n    while miss > log(1 - s):\n        miss += log(1 - fit() ** k)"
    ),
    "the logarithm for each trial": ("def f(w, k, s, N): return log(1 - s) / N > log(1 - w**k)"),
    "the trials of a geometric distribution": (
        "from scipy.stats import geom\ndef f(w, k, s): return geom.ppf(s, w**k)"
    ),
    "a geometric distribution": (
        "from scipy import stats\ndef f(w, k, s): return stats.geom(w**k).isf(1 - s)"
    ),
    "no success in so many trials": (
        "from scipy.stats import binom\ndef f(w, k, s, N): return binom.pmf(0, N, w**k) < 1 - s"
    ),
    "a function that calls itself": (
        "def p(w, k): return 1 if k == 0 else w * p(w, k - 1)\n"
        "def f(w, k, s): return log(1 - s) / log(1 - p(w, k))"
    ),
    "a product of failures": "def f(w, k, s): return np.prod(1 - w**k) < 1 - s",
    "a product of failures, one for each": (
        "def f(ratios, k, s): return 1 - prod(1 - w**k for w in ratios) > s"
    ),
    "a sum of logarithms": "def f(w, k, s): return np.sum(np.log(1 - w**k)) < log(1 - s)",
    "the failures of a loop that ends itself": (
        "def f(fit, k, s):\n    miss = 1.0\n    for _ in range(1000):\n        miss *= 1 - fit() ** k\n"
        "        if miss < 1 - s:\n            break"
    ),
    "a failure made smaller by a share of it": (
        "def f(fit, k, s):\n    miss = 1.0\n    for _ in range(1000):\n        miss -= miss * fit() ** k\n"
        "        if miss < 1 - s:\n            break"
    ),
    "a logarithm counted down": (
        "def f(fit, k, s):\n    left = log(1 - s)\n    while left < 0:\n        left -= log(1 - fit() ** k)"
    ),
    "percent": (
        "def f(w, k):\n    N = 0\n    while 100 * (1 - (1 - w**k) ** N) < 99:\n        N += 1"
    ),
    "an equation to be solved": (
        "import sympy\ndef f(w, k, s, N): return sympy.solve(sympy.Eq(1 - (1 - w**k) ** N, s), N)"
    ),
    "the place in a table": (
        "def f(w, k, s):\n    return np.searchsorted(1 - (1 - w**k) ** np.arange(1000), s)"
    ),
    "a list that is filled": (
        "def f(w, k, s):\n    logs = []\n    logs.append(log(1 - s))\n    logs.append(log(1 - w**k))\n"
        "    return logs[0] / logs[1]"
    ),
    "an output argument": (
        "def f(w, k, s):\n    p = np.empty(1)\n    np.power(w, k, out=p)\n    return log(1 - s) / log(1 - p)"
    ),
    "a property of another object": (
        "class A:\n    @property\n    def good(self): return self.w**self.k\n"
        "def f(a, s): return log(1 - s) / log(1 - a.good)"
    ),
    "the first of several": (
        "def f(w, k, s):\n    p, *_ = w**k, 1, 2\n    return log(1 - s) / log(1 - p)"
    ),
    "multiplied by itself without a loop": (
        "def f(w, s):\n    p = w\n    p *= w\n    p *= w\n    return log(1 - s) / log(1 - p)"
    ),
    "a power of ten": ("def f(w, k, s, N): return 1 - 10 ** (N * log10(1 - w**k)) > s"),
    "entry of an array": (
        "def f(w, k, s):\n    d = np.zeros(3)\n    d[0] = 1 - w**k\n    return log(1 - s) / log(d[0])"
    ),
}


@pytest.mark.parametrize("source", WHOLE.values(), ids=WHOLE.keys())
def test_follows_definitions(source):
    assert kinds(f"from math import *\nimport numpy as np\n{source}\n") == ["approximate"]


SILENT = {
    "LSH bands": "def f(s, r, b): return 1 - (1 - s**r) ** b",
    "LSH threshold": "def f(s, r, b):\n    if 1 - (1 - s**r) ** b > 0.5:\n        return True",
    "Bloom filter": "def f(n, m, k): return (1 - exp(-k * n / m)) ** k",
    "Bloom size": "def f(n, p): return -n * log(p) / log(2) ** 2",
    "pass at k": "def f(n, c, k): return 1 - comb(n - c, k) / comb(n, k)",
    "geometric skip": "def f(p): return int(log(random.random()) / log(1 - p))",
    "logarithmic series": "def f(p, u, v): return 1 + log(v) / log(1 - (1 - p) ** random.random())",
    "coupon collector": "def f(n): return n * (log(n) + 0.5772)",
    "time to solution": "def f(p, s, t): return t * log(1 - s) / log(1 - p)",
    "family-wise error": "def f(a, m): return 1 - (1 - a) ** (1 / m)",
    "privacy": "def f(eps, k, d): return eps * sqrt(2 * k * log(1 / d))",
    "PROSAC growth": (
        "def f(n, N, m, T):\n    t = T\n    for i in range(m):\n        t *= (n - i) / (N - i)\n    return t"
    ),
    "change of base": "def f(x, b): return log(x**2) / log(b)",
    "biweight": "def f(r, c, t): return np.sum((1 - (r / c) ** 2) ** 2) < t",
    "difference of squares": "def f(a, b, c): return log(c) / log(a**2 - b**2)",
    "power of two": "def f(n, k): return log(n) / log(1 - 2**k)",
    "docstring": 'def f():\n    """N = log(1 - s) / log(1 - w**k)"""',
}


@pytest.mark.parametrize("source", SILENT.values(), ids=SILENT.keys())
def test_look_alikes_are_not_reported(source):
    text = f"from math import *\nimport numpy as np\nimport random\n{source}\n"
    assert [found for found in sites(text, "similarity.py") if found.certainty] == []


def test_names_the_roles():
    source = """
import math

def ransac_update(best_inliers, points, sample_size, confidence):
    w = len(best_inliers) / float(len(points))
    bottom = 1 - w ** sample_size
    return math.log(1 - confidence) / math.log(bottom)
"""
    (found,) = sites(source)
    assert found.roles == {
        "inlier_ratio": "w",
        "n_inliers": "len(best_inliers)",
        "n_samples": "len(points)",
        "sample_size": "sample_size",
        "confidence": "confidence",
    }
    assert found.certainty == "high"
    assert found.adaptive


@pytest.mark.parametrize(
    "power",
    ["w ** (k - 1) * w", "w * pow(w, k - 1)", "(I / n) ** (k - 1) * (I / n)", "w ** (-1 + k) * w"],
)
def test_a_factor_that_completes_a_power_is_part_of_its_size(power):
    (found,) = sites(rule(power))
    assert found.roles["sample_size"] == "k"
    assert found.site.probability.other_factors == 0


def test_a_factor_behind_a_loop_that_stops_one_early_is_part_of_the_size():
    source = """
def ransac(w, sample_size, s):
    N = 0
    while True:
        N += 1
        f = 1
        for _ in range(sample_size - 1):
            f *= w
        f = 1 - f * w
        if f**N < 1 - s:
            return N
"""
    (found,) = sites(source)
    assert found.roles["sample_size"] == "sample_size"


@pytest.mark.parametrize("power", ["w ** (k - 2) * w", "w ** (k - 1) * e", "w ** (k - 1) * w * w"])
def test_any_other_factor_is_not(power):
    (found,) = sites(rule(power))
    assert found.roles["sample_size"] != "k"


def test_names_lie_and_structure_decides():
    source = """
from math import log

def ransac(confidence, min_inliers, k):
    # confidence holds 1 - s here, and min_inliers a ratio
    return log(confidence) / log(1 - min_inliers ** k)
"""
    (found,) = sites(source)
    assert found.site.probability.kind == "approximate"
    assert found.roles["confidence"] == "confidence"
    assert found.roles["inlier_ratio"] == "min_inliers"


@pytest.mark.parametrize(
    ("where", "certainty"),
    [("ransac", "high"), ("module", "medium"), ("weak", "low"), ("nowhere", None)],
)
def test_words_raise_and_lower_the_certainty(where, certainty):
    name = "ransac_trials" if where == "ransac" else "trials"
    comment = {"module": "# count the outliers", "weak": "# find a homography"}.get(where, "")
    source = (
        f"from math import log\n{comment}\n"
        f"def {name}(w, k, s):\n    return log(1 - s) / log(1 - w**k)\n"
    )
    (found,) = sites(source, "a.py")
    assert found.certainty == certainty


@pytest.mark.parametrize(
    ("comment", "certainty"),
    [("LMedS", "medium"), ("MAGSAC", "medium"), ("a vanishing point", "low"), ("lidar", None)],
)
def test_kin_of_ransac_and_problems_it_solves_speak_for_it(comment, certainty):
    source = (
        f"from math import log\n# {comment}\ndef f(w, k, s): return log(1 - s) / log(1 - w**k)\n"
    )
    (found,) = sites(source, "a.py")
    assert found.certainty == certainty


def test_counts_make_no_rule_adaptive_that_only_bounds_a_later_loop():
    source = """
from math import ceil, log

def ransac(y, fit, k, s):
    w = 1 - far_out(y).sum() / len(y)
    trials = ceil(log(1 - s) / log(1 - w**k))
    budget = min(trials, 1000)
    for _ in range(budget):
        fit(y)
"""
    (found,) = sites(source)
    assert found.site.probability.kind == "approximate"
    assert not found.adaptive
    assert sites(source.replace("range(budget)", "range(9)"))[0].adaptive


def test_a_helper_that_is_called_in_a_loop_is_adaptive():
    source = """
from math import log

def trials(w, k, s):
    return log(1 - s) / log(1 - w**k)

def ransac(data, fit):
    N = 100
    while N > 0:
        N = trials(fit(data), 4, 0.99)
"""
    (found,) = sites(source)
    assert found.adaptive
    assert not sites(source.replace("while N > 0:", "if N > 0:"))[0].adaptive
