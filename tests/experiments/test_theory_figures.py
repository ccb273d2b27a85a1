from fractions import Fraction
from math import comb

import mpmath
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix.cli.reproduce import command
from ransac_fix.criterion import true_success_probability, undersampling
from ransac_fix.experiments.figures import (
    CONFIDENCE,
    error_panels,
    exact_probability,
    success_panels,
    tradeoff,
    tradeoff_panels,
    undersampling_panels,
)
from ransac_fix.report.drawing import LINE_STYLES
from ransac_fix.report.figures import THEORY_FIGURES


def curves(panels):
    return [(panel, curve) for panel in panels for curve in panel.curves]


def number(label: str) -> Fraction:
    return Fraction(label.strip("$").split("=")[1])


def falling_ratio(p: Fraction, n: Fraction, k: int) -> Fraction:
    """P_e by repeated draws: the chance of an inlier changes with each one taken."""
    probability, inliers, left = Fraction(1), p * n, n
    for _ in range(k):
        probability *= inliers / left
        inliers, left = inliers - 1, left - 1
    return probability


def in_high_precision(p: Fraction, n: Fraction, k: int) -> tuple[float, float]:
    """True success and undersampling with 60 digits."""
    with mpmath.workdps(60):
        exact, approximate = (
            mpmath.log(1 - mpmath.mpf(q.numerator) / q.denominator)
            for q in (falling_ratio(p, n, k), p**k)
        )
        allowed = mpmath.log(mpmath.mpf(1) / 100)
        trials = allowed / approximate
        return float(1 - mpmath.exp(exact * trials)), float(allowed / exact / trials - 1)


@pytest.mark.parametrize(("panel", "curve"), curves(error_panels()))
def test_error_curves_equal_rational_arithmetic(panel, curve):
    n, k = int(number(panel.title)), int(number(curve.label))
    assert len(curve.x) == n
    for inliers, x, y in zip(range(1, n + 1), curve.x, curve.y, strict=True):
        p = Fraction(inliers, n)
        expected = (p**k - Fraction(comb(inliers, k), comb(n, k))) / p**k
        assert (x, y) == (float(p), float(expected))


@pytest.mark.parametrize(
    ("panel", "curve", "which"),
    [(*pc, 0) for pc in curves(success_panels())]
    + [(*pc, 1) for pc in curves(undersampling_panels())],
)
def test_curves_over_n_equal_rational_arithmetic(panel, curve, which):
    by_size = curve.label.startswith("$k")
    p = number(panel.title) if by_size else number(curve.label)
    k = int(number(curve.label)) if by_size else 5
    assert Fraction(curve.x[0]).limit_denominator(100) == k / p  # cut where no sample exists
    for x, y in zip(curve.x, curve.y, strict=True):
        n = Fraction(x).limit_denominator(100)
        assert y == pytest.approx(in_high_precision(p, n, k)[which], rel=1e-12)


@pytest.mark.parametrize(
    ("panels", "value"),
    [(success_panels(), true_success_probability), (undersampling_panels(), undersampling)],
    ids=["success", "undersampling"],
)
def test_marked_points_are_what_the_criterion_says(panels, value):
    for panel, curve in curves(panels):
        by_size = curve.label.startswith("$k")
        p = number(panel.title) if by_size else number(curve.label)
        k = int(number(curve.label)) if by_size else 5
        assert len(curve.whole) > 20
        for i in curve.whole:
            n = int(curve.x[i])
            expected = value(int(p * n), n, k, CONFIDENCE)
            assert curve.y[i] == pytest.approx(expected, rel=1e-12)


@given(st.integers(1, 60), st.data())
@settings(derandomize=True)
def test_the_product_is_the_ratio_of_subsets_where_inliers_are_whole(n, data):
    inliers, k = data.draw(st.integers(0, n)), data.draw(st.integers(1, n))
    assert exact_probability(Fraction(inliers, n), Fraction(n), k) == Fraction(
        comb(inliers, k), comb(n, k)
    )


@given(
    st.lists(st.integers(5, 49), min_size=1, max_size=8),
    st.floats(0, 5),
    st.lists(st.floats(0, 1), min_size=8, max_size=8),
)
@settings(derandomize=True)
def test_no_division_of_the_trials_beats_the_best(inliers, magnitude, shares):
    mean_trials = 10.0**magnitude
    approximate, exact, best = tradeoff(inliers, 50, 5, mean_trials)
    assert max(approximate, exact) <= best * (1 + 1e-6)
    shares = np.array(shares[: len(inliers)]) + 1e-9
    trials = mean_trials * len(inliers) * shares / shares.sum()
    exact_p = np.array([comb(i, 5) / comb(50, 5) for i in inliers])
    reached = np.mean(1 - np.exp(np.log1p(-exact_p) * trials))
    assert reached <= best * (1 + 1e-6)


def test_the_exact_rules_success_is_its_confidence():
    """At the mean of its trials for s, whatever the numbers of inliers."""
    inliers = [10, 17, 25, 40]
    s = 0.9
    trials = [np.log(1 - s) / np.log1p(-comb(i, 5) / comb(50, 5)) for i in inliers]
    assert tradeoff(inliers, 50, 5, float(np.mean(trials)))[1] == pytest.approx(s)


def test_the_common_rule_reaches_more_instances_in_the_same_mean_trials():
    """Up to the confidences in use: the exact rule gives more trials to the hardest instances."""
    for panel in tradeoff_panels():
        best, approximate, exact = panel.curves
        for a, e, most in zip(approximate.y, exact.y, best.y, strict=True):
            if e < 0.99:
                assert e < a < most


def test_lines_differ_in_grey_without_their_colour():
    for key in ("linestyle", "marker"):
        values = [str(style[key]) for style in LINE_STYLES]
        assert len(set(values)) == len(values)


@pytest.mark.parametrize("name", list(THEORY_FIGURES))
@pytest.mark.parametrize("suffix", ["svg", "pdf", "png"])
def test_each_figure_comes_out_of_one_command(tmp_path, name, suffix):
    path = tmp_path / f"figure.{suffix}"
    result = CliRunner().invoke(command, [name, "--output", str(path)], catch_exceptions=False)
    assert result.exit_code == 0
    starts = {"svg": b"<?xml", "pdf": b"%PDF", "png": b"\x89PNG"}
    data = path.read_bytes()
    assert data.startswith(starts[suffix])
    assert len(data) > 9000
    assert "k = 5" in result.stdout
