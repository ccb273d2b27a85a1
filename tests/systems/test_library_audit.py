"""The verdicts on the libraries installed here, measured.

What is known of them: SYSTEMS in the repository's `systems.toml`, and each library's own source.
"""

import math
import sys

import pytest

from ransac_fix.audit.session import Options, audit
from ransac_fix.criterion import all_inlier_probability, approximate_all_inlier_probability


@pytest.fixture(scope="module")
def report():
    return audit(Options((), sys.executable))


@pytest.fixture(scope="module")
def patched():
    options = Options(
        ("scikit-image", "scikit-learn"),
        sys.executable,
        prepare="ransac_fix.patching:patch",
        preparable=frozenset({"scikit-image", "scikit-learn"}),
    )
    return audit(options)


def verdict_on(report, system, entry_point):
    (verdict,) = (v for v in report.verdicts if (v.system, v.entry_point) == (system, entry_point))
    return verdict


def test_the_controls_are_all_recognised(report):
    assert len(report.controls) >= 8
    assert all(control.passed for control in report.controls), report.controls


@pytest.mark.parametrize(
    ("system", "entry_point", "k", "phi"),
    [
        # cvRound, floor, ceil: the roundings of the sources.
        ("opencv", "findHomography(RANSAC)", 4, 0.5),
        ("opencv", "estimateAffine2D(RANSAC)", 3, 0.5),
        ("opencv", "findHomography(USAC_DEFAULT)", 4, 0.0),
        ("opencv", "estimateAffine2D(USAC_DEFAULT)", 3, 0.0),
        ("scikit-image", "measure.ransac", 2, 1.0),
        ("scikit-learn", "RANSACRegressor", 2, 1.0),
    ],
)
def test_it_undersamples_by_the_approximate_rule(report, system, entry_point, k, phi):
    verdict = verdict_on(report, system, entry_point)
    assert verdict.verdict == "undersamples", verdict
    law = verdict.stopping_law
    assert (law.assumed, law.sample_size, law.inlier_offset) == ("approximate", k, 0)
    assert (law.multiplier, law.phi) == (1.0, (phi, phi))
    assert (verdict.sampler_law.drawn, verdict.sampler_law.sample_size) == ("distinct", k)
    for point in verdict.points:
        assumed = approximate_all_inlier_probability(point.n_inliers, point.n, k)
        assert point.u / -math.log1p(-assumed) == pytest.approx(point.trials - phi, abs=0.1)


@pytest.mark.parametrize(
    ("system", "entry_point", "phi"),
    [
        # pycolmap tests the bound after the trial.
        ("colmap", "estimate_homography_matrix", 2.0),
        ("kornia", "RANSAC(homography)", 1.0),
    ],
)
def test_it_is_exact(report, system, entry_point, phi):
    verdict = verdict_on(report, system, entry_point)
    assert verdict.verdict == "exact", verdict
    assert verdict.stopping_law.assumed == "distinct"
    assert verdict.stopping_law.phi == (phi, phi)
    for point in verdict.points:
        true = all_inlier_probability(point.n_inliers, point.n, 4)
        assert point.u / -math.log1p(-true) == pytest.approx(point.trials - phi, abs=0.1)


@pytest.mark.parametrize(
    ("system", "entry_point", "name"),
    [
        ("scikit-image", "measure.ransac", "max_trials"),
        ("scikit-learn", "RANSACRegressor", "max_trials"),
        ("opencv", "findHomography(RANSAC)", "maxIters"),
    ],
)
def test_the_default_cap_is_checked_and_named_where_it_binds(report, system, entry_point, name):
    verdict = verdict_on(report, system, entry_point)
    assert verdict.at_defaults.checked is True
    assert any(row.binds == "maximum" for row in verdict.at_defaults.guarantees)
    assert name in verdict.advice


def test_the_default_minimum_of_pycolmap_is_named(report):
    verdict = verdict_on(report, "colmap", "estimate_homography_matrix")
    assert any(row.binds == "minimum" for row in verdict.at_defaults.guarantees)
    assert "default minimum of 1,000 trials" in verdict.advice


@pytest.mark.parametrize("system", ["scikit-image", "scikit-learn"])
def test_it_is_exact_under_the_patch(patched, system):
    (verdict,) = (v for v in patched.verdicts if v.system == system)
    assert verdict.verdict == "exact", verdict
    assert verdict.stopping_law.assumed == "distinct"
