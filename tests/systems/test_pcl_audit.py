"""The verdicts on PCL's C++ templates, compiled and measured here."""

import math
import sys

import pytest
from optional_libraries import described

from ransac_fix.audit.judge import judge
from ransac_fix.audit.laws import law_probability
from ransac_fix.audit.measure import measure
from ransac_fix.audit.session import Options, audit


@pytest.fixture(scope="module")
def pcl():
    yield from described("pcl", "apt-get install libpcl-dev g++")


@pytest.mark.parametrize(
    ("method", "model", "k"),
    [
        ("RandomSampleConsensus", "SampleConsensusModelPlane", 3),
        ("RandomSampleConsensus", "SampleConsensusModelLine", 2),
        ("RandomSampleConsensus", "SampleConsensusModelCircle2D", 3),
        ("RandomSampleConsensus", "SampleConsensusModelSphere", 4),
        ("RandomSampleConsensus", "SampleConsensusModelRegistration", 3),
        ("MEstimatorSampleConsensus", "SampleConsensusModelPlane", 3),
        ("MaximumLikelihoodSampleConsensus", "SampleConsensusModelPlane", 3),
        ("RandomizedRandomSampleConsensus", "SampleConsensusModelPlane", 3),
        ("RandomizedMEstimatorSampleConsensus", "SampleConsensusModelPlane", 3),
    ],
)
def test_every_method_with_a_rule_stops_too_early(pcl, method, model, k):
    host, entry_points, _ = pcl
    verdict, _ = judge(found := measure(host, entry_points[f"{method}({model})"]))
    assert verdict == "undersamples"
    law = found.fit.law
    assert (law.assumed, law.sample_size, law.inlier_offset) == ("approximate", k, 0)
    # Rounded down and tested after the trial, or rounded up and tested before: one class.
    assert (law.multiplier, law.phi) == (1.0, (1.0, 1.0))
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", k)
    assert {point.kind for point in found.points} == {"count", "flip"}
    for point in found.points:
        scale = -math.log1p(-law_probability(law, point.n_inliers, point.n))
        assert point.u / scale == pytest.approx(point.trials - 1, abs=0.1)


def test_the_default_cap_of_a_segmentation_matters_more_than_its_rule(pcl):
    options = Options(("pcl",), sys.executable, entry_points=("SACSegmentation*",))
    (verdict,) = audit(options).verdicts
    assert verdict.version == pcl[2]
    assert verdict.verdict == "undersamples"
    # 50 in PCL's words, which runs one more.
    assert verdict.at_defaults.max_trials == 51
    assert verdict.at_defaults.checked is True
    assert sum(row.binds == "maximum" for row in verdict.at_defaults.guarantees) >= 3
    assert "setMaxIterations" in verdict.advice


def test_default_caps_are_read_from_each_method(pcl):
    _, entry_points, _ = pcl
    caps = {name: one["defaults"]["max_trials"] for name, one in entry_points.items()}
    assert caps["RandomSampleConsensus(SampleConsensusModelPlane)"] == 10_001
    assert caps["SACSegmentation(SACMODEL_PLANE, SAC_RANSAC)"] == 51


@pytest.mark.parametrize(
    ("method", "defect"),
    [("ProgressiveSampleConsensus", "confidence ignored"), ("LeastMedianSquares", "no rule")],
)
def test_methods_that_do_not_heed_the_confidence_are_recognised(pcl, method, defect):
    host, entry_points, _ = pcl
    one = entry_points[f"{method}(SampleConsensusModelPlane)"]
    verdict, _ = judge(found := measure(host, one))
    assert verdict == "other rule"
    assert found.defects == (defect,)
    # Measurements in no order of quality: PROSAC here draws like the others.
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", 3)
