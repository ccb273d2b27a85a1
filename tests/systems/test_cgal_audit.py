"""The verdict on CGAL's Efficient_RANSAC, compiled and measured here."""

import sys

import pytest
from optional_libraries import described

from ransac_fix.audit.judge import judge
from ransac_fix.audit.measure import measure
from ransac_fix.audit.session import Options, audit


@pytest.fixture(scope="module")
def cgal():
    yield from described("cgal", "apt-get install libcgal-dev g++")


def test_neither_its_samples_nor_its_rule_are_those_of_uniform_sampling(cgal):
    host, entry_points, _ = cgal
    verdict, reason = judge(found := measure(host, entry_points["Efficient_RANSAC::detect"]))
    assert verdict == "other rule"
    assert found.fit.law is None
    assert found.sampler.drawn == "not uniform"
    # It draws from cells, so points that lie together are drawn together.
    assert found.sampler.hits > 2 * found.sampler.expected
    assert "no known law passes through the points" in reason
    assert "not drawn uniformly" in reason
    # Schnabel's bound: I/n for the first point, 1/2 for each other, one of two octree levels. It
    # is looked at after every ten samples.
    for point in found.points:
        bound = point.u / (point.n_inliers / point.n / (2 * 2**2))
        assert 0 < point.trials - bound < 10


def test_nobody_is_told_to_use_a_rule_for_uniform_samples_there(cgal):
    (verdict,) = audit(Options(("cgal",), sys.executable)).verdicts
    assert verdict.version == cgal[2]
    assert verdict.verdict == "other rule"
    assert verdict.advice == ""
    assert verdict.at_defaults is None
