"""The verdicts on OpenGV's C++ templates, compiled and measured here."""

import math
import os
import sys

import pytest
from optional_libraries import described

from ransac_fix.audit.judge import judge
from ransac_fix.audit.laws import law_probability
from ransac_fix.audit.measure import measure
from ransac_fix.audit.session import Options, audit


@pytest.fixture(scope="module")
def opengv():
    yield from described("opengv", "apt-get install libopengv-dev libeigen3-dev python3-opengv g++")


@pytest.mark.parametrize(
    ("problem", "k"),
    [
        # P3P has four solutions, and one more measurement to choose among them.
        ("Ransac<AbsolutePoseSacProblem>(KNEIP)", 4),
        ("Ransac<AbsolutePoseSacProblem>(GAO)", 4),
        ("Ransac<AbsolutePoseSacProblem>(EPNP)", 6),
        ("Ransac<AbsolutePoseSacProblem>(TWOPT)", 2),
        ("Ransac<CentralRelativePoseSacProblem>(NISTER)", 8),
        ("Ransac<CentralRelativePoseSacProblem>(SEVENPT)", 9),
        ("Ransac<CentralRelativePoseSacProblem>(EIGHTPT)", 9),
        ("Ransac<RotationOnlySacProblem>", 2),
        ("Ransac<TranslationOnlySacProblem>", 2),
        ("Ransac<PointCloudSacProblem>", 3),
    ],
)
def test_it_stops_as_if_samples_with_their_verifying_points_were_drawn_with_replacement(
    opengv, problem, k
):
    host, entry_points, _ = opengv
    verdict, _ = judge(found := measure(host, entry_points[problem]))
    assert verdict == "undersamples"
    law = found.fit.law
    assert (law.assumed, law.sample_size, law.inlier_offset) == ("approximate", k, 0)
    assert (law.multiplier, law.phi) == (1.0, (1.0, 1.0))
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", k)
    # Counted trials are checked by a flip point.
    assert {point.kind for point in found.points} == {"count", "flip"}
    for point in found.points:
        scale = -math.log1p(-law_probability(law, point.n_inliers, point.n))
        assert point.u / scale == pytest.approx(point.trials - 1, abs=0.1)


def test_cameras_of_a_rig_are_drawn_from_alike_by_ransac_and_in_turn_by_multi_ransac(opengv):
    host, entry_points, _ = opengv
    pooled = measure(host, entry_points["Ransac<AbsolutePoseSacProblem>(GP3P)"])
    assert (pooled.sampler.drawn, pooled.sampler.sample_size) == ("distinct", 4)
    multi = measure(host, entry_points["MultiRansac<MultiNoncentralAbsolutePoseSacProblem>"])
    assert (multi.sampler.drawn, multi.sampler.quota) == ("stratified", (2, 2))
    for found in (pooled, multi):
        # Both rules take all cameras together.
        assert (found.fit.law.assumed, found.fit.law.sample_size) == ("approximate", 4)
        assert found.fit.law.phi == (1.0, 1.0)
        assert judge(found)[0] == "undersamples"


def test_least_median_of_squares_has_no_rule(opengv):
    host, entry_points, _ = opengv
    found = measure(host, entry_points["Lmeds<AbsolutePoseSacProblem>(KNEIP)"])
    assert found.defects == ("no rule",)
    assert judge(found)[0] == "other rule"


@pytest.mark.parametrize(
    ("name", "k"),
    [
        ("absolute_pose_ransac(KNEIP)", 4),
        ("absolute_pose_ransac(GAO)", 4),
        ("relative_pose_ransac_rotation_only", 2),
    ],
)
def test_pyopengv_is_measured_though_it_takes_its_seed_from_the_clock(opengv, name, k):
    host, entry_points, _ = opengv
    if f"pyopengv.{name}" not in entry_points:
        missing = "pyopengv is not built for this Python: use Debian's, or its version"
        assert sys.version_info[:2] != (3, 11) or not os.environ.get("CI"), missing
        pytest.skip(missing)
    found = measure(host, entry_points[f"pyopengv.{name}"])
    law = found.fit.law
    assert (law.assumed, law.sample_size, law.phi) == ("approximate", k, (1.0, 1.0))
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", k)
    assert {point.kind for point in found.points} == {"flip"}
    assert judge(found)[0] == "undersamples"


def test_a_default_budget_of_1000_runs_1001_trials(opengv):
    report = audit(Options(("opengv",), sys.executable, quick=True))
    (verdict,) = report.verdicts
    assert verdict.at_defaults.checked is True
    assert verdict.at_defaults.max_trials == 1001
    assert verdict.version == opengv[2]
