"""The verdicts on the libraries installed here, measured.

What is known of them: `systems.toml`, each library's own source, and earlier measurements.
"""

import math
import sys

import pytest

from ransac_fix.audit.host import WorkerHost
from ransac_fix.audit.judge import judge
from ransac_fix.audit.laws import law_probability
from ransac_fix.audit.measure import measure
from ransac_fix.audit.session import Options, audit, probe_files


@pytest.fixture(scope="module")
def report():
    return audit(Options((), sys.executable, quick=True))


@pytest.fixture(scope="module")
def patched():
    names = ("scikit-image", "scikit-learn")
    return audit(
        Options(
            names,
            sys.executable,
            prepare="ransac_fix.patching.audited:patch_for_audit",
            preparable=frozenset(names),
        )
    )


def test_a_refused_patch_is_reported_beside_the_verdict_on_the_bare_library():
    # With NumPy 2 nothing can be read from the masks of this library.
    report = audit(
        Options(
            ("gc-ransac",),
            sys.executable,
            prepare="ransac_fix.patching.audited:patch_for_audit",
            preparable=frozenset({"gc-ransac"}),
            entry_points=("findRigidTransform*",),
        )
    )
    verdict = verdict_on(report, "gc-ransac")
    assert verdict.verdict == "undersamples"
    assert "its patch was refused, with NumPy 2" in verdict.advice


def test_wrapped_libraries_are_proved_by_their_trials_and_outcomes():
    names = ("poselib", "pydegensac", "kornia-rs", "theia", "opencv", "colmap")
    report = audit(
        Options(
            names,
            sys.executable,
            prepare="ransac_fix.patching.audited:patch_for_audit",
            preparable=frozenset(names),
            quick=True,
        )
    )
    for name in names:
        verdict = verdict_on(report, name)
        assert verdict.verdict == "exact", verdict
        extension = verdict.extension
        if name == "colmap":  # exact by itself: nothing is wrapped
            assert extension is None
            assert verdict.points
            continue
        assert extension.kept == extension.runs > 50
        assert extension.extended > 0
        if name == "theia":  # two rules a trial apart: it counts them itself
            assert extension.counted
            assert extension.outcomes is None
        else:
            assert extension.outcomes.log_ratio > 13
            assert extension.outcomes.log_ratio_alone < -13


def verdict_on(report, system):
    (verdict,) = (v for v in report.verdicts if v.system == system)
    return verdict


def test_the_controls_are_all_recognised(report):
    assert len(report.controls) >= 8
    assert all(control.passed for control in report.controls), report.controls


# system, k, the probability assumed, inlier offset, shift. The shifts are those of the sources:
# cvRound, ceil, and one more where the bound is tested after the trial.
LAWS = [
    ("opencv", 4, "approximate", 0, 0.5, "undersamples"),
    ("scikit-image", 2, "approximate", 0, 1.0, "undersamples"),
    ("scikit-learn", 2, "approximate", 0, 1.0, "undersamples"),
    ("kornia", 4, "distinct", 0, 1.0, "exact"),
    ("colmap", 4, "distinct", 0, 2.0, "exact"),
    ("poselib", 4, "approximate", 0, 2.0, "undersamples"),
    ("pydegensac", 4, "distinct", 1, 1.0, "undersamples"),
    ("kornia-rs", 4, "approximate", 0, 1.0, "undersamples"),
    ("theia", 4, "distinct", 0, 0.0, "oversamples"),
]


@pytest.mark.parametrize(("system", "k", "assumed", "offset", "phi", "judgement"), LAWS)
def test_each_library_obeys_the_law_known_of_it(report, system, k, assumed, offset, phi, judgement):
    verdict = verdict_on(report, system)
    assert verdict.verdict == judgement, verdict
    law = verdict.stopping_law
    assert (law.assumed, law.sample_size, law.inlier_offset) == (assumed, k, offset)
    assert (law.multiplier, law.phi) == (1.0, (phi, phi))
    assert (verdict.sampler_law.drawn, verdict.sampler_law.sample_size) == ("distinct", k)
    # Where draws are watched one exact point a problem does.
    assert len(verdict.points) >= (4 if system == "kornia" else 7)
    for point in verdict.points:
        scale = -math.log1p(-law_probability(law, point.n_inliers, point.n))
        assert point.u / scale == pytest.approx(point.trials - phi, abs=0.1)


def test_theia_truncates_the_number_of_inliers(report):
    assert verdict_on(report, "theia").stopping_law.truncated


@pytest.mark.parametrize(
    ("system", "name"),
    [("scikit-image", "max_trials"), ("scikit-learn", "max_trials"), ("opencv", "maxIters")],
)
def test_the_default_cap_is_checked_and_named_where_it_binds(report, system, name):
    verdict = verdict_on(report, system)
    assert verdict.at_defaults.checked is True
    assert any(row.binds == "maximum" for row in verdict.at_defaults.guarantees)
    assert name in verdict.advice


def test_the_samples_that_opencv_draws_again_are_reported_beside_the_law(report):
    """The classic homography rejects samples whose points change their order; COLMAP does not."""
    classic, colmap = verdict_on(report, "opencv"), verdict_on(report, "colmap")
    assert classic.sampler_law.accepted[1] < 1
    assert "draws again" in classic.reason
    assert colmap.sampler_law.accepted[1] == 1
    assert verdict_on(report, "poselib").at_defaults.checked is True


def test_the_default_minimum_of_pycolmap_is_named(report):
    verdict = verdict_on(report, "colmap")
    assert any(row.binds == "minimum" for row in verdict.at_defaults.guarantees)
    assert "default minimum of 1,000 trials" in verdict.advice


@pytest.mark.parametrize("system", ["scikit-image", "scikit-learn"])
def test_it_is_exact_under_the_patch(patched, system):
    verdict = verdict_on(patched, system)
    assert verdict.verdict == "exact", verdict
    assert verdict.stopping_law.assumed == "distinct"


@pytest.fixture(scope="module")
def opencv():
    """A worker with OpenCV, and its entry points by name."""
    with WorkerHost(probe_files()["opencv"], sys.executable, 120) as host:
        described = host.ask("describe")["entry_points"]
        yield host, {one["name"]: one for one in described}


@pytest.mark.parametrize(("method", "k"), [("P3P", 4), ("EPNP", 5)])
def test_solve_pnp_ransac_draws_four_with_p3p_and_five_with_epnp(opencv, method, k):
    """k is measured: one of P3P's four measurements only chooses among its solutions."""
    host, entry_points = opencv
    verdict, _ = judge(found := measure(host, entry_points[f"solvePnPRansac(SOLVEPNP_{method})"]))
    assert verdict == "undersamples"
    assert (found.fit.law.assumed, found.fit.law.sample_size) == ("approximate", k)
    assert found.fit.law.phi == (0.5, 0.5)
    assert found.sampler.drawn == "distinct"


@pytest.mark.parametrize(
    ("name", "k", "phi"),
    [
        ("findFundamentalMat(USAC_DEFAULT)", 7, 0.0),
        ("findHomography(USAC_MAGSAC)", 4, 0.0),
        ("estimateAffinePartial2D(RANSAC)", 2, 0.5),
    ],
)
def test_other_estimators_of_opencv_follow_the_same_rule(opencv, name, k, phi):
    host, entry_points = opencv
    verdict, _ = judge(found := measure(host, entry_points[name]))
    assert verdict == "undersamples"
    assert (found.fit.law.assumed, found.fit.law.sample_size) == ("approximate", k)
    assert found.fit.law.phi == (phi, phi)
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", k)


def test_with_one_measurement_in_a_sample_all_rules_are_exact(opencv):
    host, entry_points = opencv
    verdict, _ = judge(measure(host, entry_points["estimateTranslation2D(RANSAC)"]))
    assert verdict == "exact"


def test_every_estimator_of_opencv_has_its_entry_point(opencv):
    _, entry_points = opencv
    assert len(entry_points) >= 28
