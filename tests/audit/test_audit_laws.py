"""Points made from a known rule lead back to the rule, and nothing else does."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix.audit import plan
from ransac_fix.audit.judge import judge
from ransac_fix.audit.laws import Candidate, Fit, fit, formula
from ransac_fix.audit.measure import Measurement
from ransac_fix.audit.model import Point, SamplerLaw, StoppingLaw

# (n, I) of the planted problems.
PROBLEMS = {k: tuple((s.n, s.group_size) for s in plan.settings(k, 80)) for k in (2, 3, 4, 5, 7)}


def points_of(candidate, k, multiplier=1.0, phi=1.0, seed=0, each=3, in_hand=False):
    """Exact flip points of a rule, bracketed as tightly as the measurement does."""
    rng = random.Random(seed)
    points = []
    for n, n_inliers in PROBLEMS[k]:
        scale = -math.log1p(-candidate.probability(n_inliers, n))
        for _ in range(each):
            t = rng.randint(20, 300)
            # Trial t happens once multiplier * u / scale exceeds t - phi.
            u = (t - phi) * scale / multiplier
            width = 0.02 * u / t
            shift = rng.random() * width
            trials, held = (t, rng.randint(1, t - 1)) if not in_hand else (t + 50, t - 1)
            points.append(
                Point(n, n_inliers, k, trials, u + shift, u + shift - width, held, "flip")
            )
    return points


laws = st.builds(
    Candidate,
    assumed=st.sampled_from(["approximate", "distinct", "replacement"]),
    sample_size=st.sampled_from(sorted(PROBLEMS)),
    inlier_offset=st.sampled_from([0, 0, 1, -1]),
)


@settings(max_examples=60, deadline=None)
@given(
    candidate=laws,
    multiplier=st.sampled_from([1.0, 1.5, 2.0, 3.0]),
    phi=st.sampled_from([-1.0, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0]),
    seed=st.integers(0, 10**6),
)
def test_a_rule_is_found_from_its_points(candidate, multiplier, phi, seed):
    k = candidate.sample_size
    found = fit(points_of(candidate, k, multiplier, phi, seed), k)
    law = found.law
    assert law is not None, found
    assert Candidate(law.assumed, law.sample_size, law.inlier_offset) == candidate
    assert law.multiplier == multiplier
    assert law.phi == (phi, phi)
    assert law.tested == "every trial"


@pytest.mark.parametrize("exponent", [2, 4, 5])
def test_an_exponent_that_is_not_the_sample_size_is_found(exponent):
    found = fit(points_of(Candidate("approximate", exponent), 3), 3)
    assert found.law is not None
    assert (found.law.assumed, found.law.sample_size) == ("approximate", exponent)


def test_a_multiplier_off_the_list_is_found_by_the_slope():
    found = fit(points_of(Candidate("distinct", 4), 4, multiplier=2.75), 4)
    assert found.law is not None
    assert found.law.multiplier == 2.75


def test_points_at_the_trial_of_the_smaller_model_mean_a_test_on_improvement():
    found = fit(points_of(Candidate("approximate", 4), 4, in_hand=True), 4)
    assert found.law is not None
    assert found.law.tested == "on improvement"


def test_several_models_from_one_draw_spread_the_shift():
    parts = [
        points_of(Candidate("distinct", 4), 4, phi=phi, seed=seed, each=2)
        for seed, phi in enumerate((1.0, 2.0, 4.0))
    ]
    found = fit([point for part in parts for point in part], 4)
    assert found.law is not None
    assert found.law.assumed == "distinct"
    assert found.law.phi == (1.0, 4.0)


@settings(max_examples=30, deadline=None)
@given(power=st.floats(1.15, 1.85), seed=st.integers(0, 1000))
def test_a_rule_that_nobody_knows_is_not_named_and_its_probability_is_implied(power, seed):
    """N = ln(1-s)/ln(1-p^(4 power)) with an odd power is none of the laws."""

    class Odd(Candidate):
        def probability(self, n_inliers, n):
            return (n_inliers / n) ** (4 * power) * 0.7

    odd = Odd("approximate", 4)
    found = fit(points_of(odd, 4, seed=seed), 4)
    assert found.law is None
    assert not found.rivals
    assert found.implied_probability == pytest.approx(
        odd.probability(PROBLEMS[4][0][1], PROBLEMS[4][0][0]), rel=0.01
    )


def test_too_few_points_name_nothing():
    points = points_of(Candidate("distinct", 4), 4)
    assert fit(points[:3], 4).law is None
    assert fit([point for point in points if point.n == points[0].n], 4).law is None


def test_two_laws_that_assume_one_probability_are_one():
    """With k = 1 the approximate, the exact and the replacement rule are the same rule."""
    problems = [Point(40, 3, 1, 0, 0, 0, 1, "flip"), Point(50, 5, 1, 0, 0, 0, 1, "flip")]
    points = []
    for setting in problems * 3:
        scale = -math.log1p(-setting.n_inliers / setting.n)
        t = 30 + 7 * len(points)
        u = (t - 1) * scale
        points.append(Point(setting.n, setting.n_inliers, 1, t, u, u * 0.9999, 1, "flip"))
    found = fit(points, 1)
    assert found.law is not None
    assert found.law.assumed == "distinct"


@pytest.mark.parametrize(
    ("phi", "text"),
    [
        (0.0, "floor(x)"),
        (0.5, "round(x)"),
        (1.0, "ceil(x)"),
        (1.5, "ceil(x + 0.5)"),
        (2.0, "ceil(x) + 1"),
        (2.5, "ceil(x + 0.5) + 1"),
        (3.0, "ceil(x) + 2"),
        (-1.0, "floor(x) - 1"),
        (-0.5, "round(x) - 1"),
    ],
)
def test_a_formula_of_each_class_lets_through_what_the_class_does(phi, text):
    written = formula(Candidate("approximate", 4), 1, (phi, phi))
    assert written == text.replace("x", "ln(1-s)/ln(1-(I/n)^4)")
    rule = text.replace("floor", "math.floor").replace("ceil", "math.ceil")
    for x in (3.2, 7.9, 12.4, 100.6):
        trials = eval(rule, {"math": math, "x": x, "round": round})
        assert x > trials - phi
        assert x <= trials + 1 - phi


@pytest.mark.parametrize("sample_size", range(1, 21))
def test_what_a_rule_comes_to_is_said_for_samples_of_every_size(sample_size):
    """Its first standard problem holds no more inliers than measurements."""
    sampler = SamplerLaw("distinct", sample_size, 0, 0.0, 0, (1.0, 1.0))
    at_once = Measurement(sampler, (), Fit(None), 0, {}, ("first model",))
    assert "s=0.99 needs" in judge(at_once)[1]
    candidate = Candidate("approximate", sample_size)
    law = StoppingLaw("approximate", sample_size, 0, 1.0, (1.0, 1.0), "every trial", False, "")
    point = Point(60, sample_size + 1, sample_size, 40, 3.0, 2.9, 5, "flip")
    verdict, reason = judge(Measurement(sampler, (point,), Fit(law), 0, {}))
    assert verdict == ("undersamples" if sample_size > 1 else "exact")
    assert candidate.describe() in reason
