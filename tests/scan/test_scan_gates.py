"""The gates: what they set aside could not have been found, and what they keep is read alike."""

import pytest

from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.findings import Finding
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
