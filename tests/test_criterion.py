"""The criterion against literal fractions, an 80-digit oracle and scipy's hypergeometric law."""

import math
from decimal import Decimal
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.stats import hypergeom

from ransac_fix import criterion
from ransac_fix.criterion import (
    Stratum,
    all_inlier_probability,
    approximate_all_inlier_probability,
    approximate_required_trials,
    required_trials,
    success_probability,
    true_success_probability,
    undersampling,
)

ALMOST_ONE = 1.0 - 2.0**-53


@st.composite
def counts(draw: st.DrawFn, largest: int = 10**9, largest_k: int = 20) -> tuple[int, int, int]:
    """(n_inliers, n_samples, sample_size), small problems and edges included."""
    n_samples = draw(st.one_of(st.integers(1, 60), st.integers(1, largest)))
    sample_size = draw(st.integers(1, min(n_samples, largest_k)))
    near = st.integers(0, 40).map(lambda d: max(0, n_samples - d))
    few = st.integers(0, 40).map(lambda d: min(n_samples, sample_size + d))
    n_inliers = draw(st.one_of(st.integers(0, n_samples), near, few))
    return n_inliers, n_samples, sample_size


confidences = st.one_of(
    st.floats(0, 1),
    st.integers(1, 53).map(lambda bits: 1.0 - 2.0**-bits),
    st.integers(1, 1074).map(lambda bits: 2.0**-bits),
    st.sampled_from([0.5, 0.9, 0.95, 0.99, 0.999, 0.9999, ALMOST_ONE]),
)


def smallest_trials(probability: Fraction, confidence: Fraction) -> int | float:
    """The definition, in 80 digits plus those of the answer's integer part.

    The quotient of the logarithms is rounded up, and an integer quotient is recognised by
    exact arithmetic, independently of how the criterion does it.
    """
    if confidence == 0:
        return 0
    if probability == 0:
        return math.inf
    if probability == 1:
        return 1
    if confidence == 1:
        return math.inf
    with mpmath.workdps(420):
        quotient = mpmath.log(
            mpmath.mpf((1 - confidence).numerator) / (1 - confidence).denominator
        ) / mpmath.log(mpmath.mpf((1 - probability).numerator) / (1 - probability).denominator)
        nearest = int(mpmath.nint(quotient))
        # 420 digits less the 162 lost in 1 - P and the 163 of the integer part leave over 80.
        if abs(quotient - nearest) < mpmath.mpf(10) ** -80:
            assert nearest <= 1100
            return nearest + ((1 - probability) ** nearest > 1 - confidence)
        return int(mpmath.ceil(quotient))


def hypergeometric(n_inliers: int, n_samples: int, sample_size: int) -> Fraction:
    probability = Fraction(1)
    for i in range(sample_size):
        probability *= Fraction(max(n_inliers - i, 0), n_samples - i)
    return probability


class TestRequiredTrials:
    @given(counts(), confidences)
    @example((1, 2, 1), 0.5)
    @example((1, 2, 1), 1.0 - 2.0**-53)
    @example((3, 4, 1), 1.0 - 2.0**-40)
    @example((9, 10, 1), 0.9)
    @example((20, 10**9, 20), ALMOST_ONE)
    @example((10**9 - 1, 10**9, 20), ALMOST_ONE)
    @example((10**9 - 1, 10**9, 1), 2.0**-1074)
    def test_agrees_with_the_oracle(self, problem: tuple[int, int, int], s: float) -> None:
        expected = smallest_trials(hypergeometric(*problem), Fraction(s))
        assert required_trials(*problem, s) == expected

    @given(counts(largest=400, largest_k=8), confidences)
    def test_is_the_smallest_by_definition(self, problem: tuple[int, int, int], s: float) -> None:
        trials = required_trials(*problem, s)
        assume(trials <= 3000)
        miss = 1 - hypergeometric(*problem)
        assert miss**trials <= 1 - Fraction(s)
        assert trials == 0 or miss ** (trials - 1) > 1 - Fraction(s)

    @given(counts(), confidences)
    def test_approximate_agrees_with_the_oracle(
        self, problem: tuple[int, int, int], s: float
    ) -> None:
        n_inliers, n_samples, sample_size = problem
        ratio = Fraction(n_inliers, n_samples) ** sample_size
        assert approximate_required_trials(*problem, s) == smallest_trials(ratio, Fraction(s))

    @given(counts(), confidences)
    def test_exact_never_asks_for_less(self, problem: tuple[int, int, int], s: float) -> None:
        assert required_trials(*problem, s) >= approximate_required_trials(*problem, s)

    @given(counts(), st.tuples(confidences, confidences))
    def test_monotone(self, problem: tuple[int, int, int], s: tuple[float, float]) -> None:
        n_inliers, n_samples, sample_size = problem
        low, high = sorted(s)
        assert required_trials(*problem, low) <= required_trials(*problem, high)
        if n_inliers < n_samples:
            more = required_trials(n_inliers + 1, n_samples, sample_size, high)
            assert more <= required_trials(*problem, high)

    @given(counts(largest=10**6), st.fractions(0, 1, max_denominator=10**9))
    def test_fractions_and_decimals_are_exact(
        self, problem: tuple[int, int, int], s: Fraction
    ) -> None:
        assert required_trials(*problem, s) == smallest_trials(hypergeometric(*problem), s)
        decimal = Decimal(s.numerator % 10**6).scaleb(-6)
        expected = smallest_trials(hypergeometric(*problem), Fraction(decimal))
        assert required_trials(*problem, decimal) == expected

    @given(counts(largest=300), confidences)
    def test_with_replacement(self, problem: tuple[int, int, int], s: float) -> None:
        n_inliers, n_samples, sample_size = problem
        probability = Fraction(math.perm(n_inliers, sample_size), n_samples**sample_size)
        result = required_trials(*problem, s, sampling="replacement")
        assert result == smallest_trials(probability, Fraction(s))

    @given(st.lists(counts(largest=200, largest_k=4), min_size=1, max_size=4), confidences)
    def test_strata(self, parts: list[tuple[int, int, int]], s: float) -> None:
        probability = math.prod((hypergeometric(*part) for part in parts), start=Fraction(1))
        total = tuple(map(sum, zip(*parts, strict=True)))
        strata = [Stratum(*part) for part in parts]
        result = required_trials(*total, s, sampling=strata)
        assert result == smallest_trials(probability, Fraction(s))

    @given(counts(), confidences)
    def test_one_stratum_is_distinct(self, problem: tuple[int, int, int], s: float) -> None:
        one = [Stratum(*problem)]
        assert required_trials(*problem, s, sampling=one) == required_trials(*problem, s)

    @pytest.mark.parametrize(
        ("arguments", "expected"),
        [
            ((6, 20, 2, 0.99), 56),
            ((5, 20, 4, 0.5), 672),
            ((12, 60, 4, 0.99), 4535),
            ((15, 22, 7, 0.99), 120),
            ((14, 30, 7, 0.99), 2730),
            ((10, 30, 4, 0.99), 599),
            ((8, 20, 3, 0.99), 92),
            ((2, 4, 2, 0.99), 26),
            ((9, 10, 1, 0.9), 2),
            ((9, 10, 1, Fraction(9, 10)), 1),
            ((9, 10, 1, Decimal("0.9")), 1),
        ],
    )
    def test_known_values(self, arguments: tuple[int, int, int, float], expected: int) -> None:
        probability = hypergeometric(*arguments[:3])
        assert smallest_trials(probability, Fraction(arguments[3])) == expected
        assert required_trials(*arguments) == expected

    @pytest.mark.parametrize(
        ("arguments", "expected"),
        [
            ((0, 10, 3, 0), 0),
            ((10, 10, 3, 0.0), 0),
            ((2, 10, 3, 0.99), math.inf),
            ((0, 10, 3, 1), math.inf),
            ((10, 10, 3, 1.0), 1),
            ((9, 10, 3, 1.0), math.inf),
        ],
        ids=["s=0 before P=0", "s=0 before P=1", "P=0", "P=0 before s=1", "P=1 before s=1", "s=1"],
    )
    def test_order_of_the_limits(
        self, arguments: tuple[int, int, int, float], expected: float
    ) -> None:
        assert required_trials(*arguments) == expected

    def test_ties_of_every_length(self) -> None:
        # (1 - 1/2)**N == 2**-N, and one step of s to either side.
        for bits in (1, 2, 10, 52, 53):
            s = 1.0 - 2.0**-bits
            assert required_trials(1, 2, 1, s) == bits
            above = math.nextafter(s, 1)
            assert required_trials(1, 2, 1, above) == (math.inf if above == 1 else bits + 1)
            below = math.nextafter(s, 0)
            assert required_trials(1, 2, 1, below) == (52 if bits == 53 else bits)
        deep = 1 - Fraction(1, 2**1074)
        assert required_trials(1, 2, 1, deep) == 1074
        assert required_trials(1, 4, 1, 1 - Fraction(3, 4) ** 700) == 700

    def test_settings_are_bounded(self) -> None:
        for n_samples in range(10, 10 + 2 * criterion._MOST_SETTINGS):
            required_trials(5, n_samples, 3, 0.99)
        assert len(criterion._SETTINGS) <= criterion._MOST_SETTINGS

    def test_huge_samples_leave_the_floats(self) -> None:
        probability = Fraction(math.comb(600, 500), math.comb(10_000, 500))
        assert required_trials(600, 10_000, 500, 0.99) == smallest_trials_by_bisection(
            probability, Fraction(0.99)
        )


def smallest_trials_by_bisection(probability: Fraction, confidence: Fraction) -> int:
    """For probabilities so small that the oracle's 420 digits do not reach."""
    with mpmath.workdps(3000):
        quotient = mpmath.log(
            mpmath.mpf(1) - mpmath.mpf(confidence.numerator) / confidence.denominator
        )
        quotient /= mpmath.log1p(-mpmath.mpf(probability.numerator) / probability.denominator)
        return int(mpmath.ceil(quotient))


class TestProbability:
    @given(counts(largest=2000, largest_k=8))
    def test_agrees_with_scipy(self, problem: tuple[int, int, int]) -> None:
        n_inliers, n_samples, sample_size = problem
        expected = hypergeom.pmf(sample_size, n_samples, n_inliers, sample_size)
        assert all_inlier_probability(*problem) == pytest.approx(expected, rel=1e-9, abs=1e-300)

    @given(counts())
    def test_is_correctly_rounded(self, problem: tuple[int, int, int]) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = hypergeometric(*problem)
        assert all_inlier_probability(*problem) == exact.numerator / exact.denominator
        ratio = Fraction(n_inliers, n_samples) ** sample_size
        assert approximate_all_inlier_probability(*problem) == ratio.numerator / ratio.denominator

    @given(counts(largest=10**6))
    def test_never_above_the_approximation(self, problem: tuple[int, int, int]) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = hypergeometric(*problem)
        approximate = Fraction(n_inliers, n_samples) ** sample_size
        assert all_inlier_probability(*problem) <= approximate_all_inlier_probability(*problem)
        equal = sample_size == 1 or n_inliers in (0, n_samples)
        assert (exact == approximate) == equal

    def test_literal_fractions(self) -> None:
        assert all_inlier_probability(10, 100, 1) == 10 / 100
        assert all_inlier_probability(10, 100, 2) == (10 * 9) / (100 * 99)
        assert all_inlier_probability(10, 100, 3) == (10 * 9 * 8) / (100 * 99 * 98)
        assert all_inlier_probability(2, 100, 3) == 0.0
        assert all_inlier_probability(100, 100, 3) == 1.0
        assert all_inlier_probability(4, 10, 3, sampling="replacement") == 24 / 1000
        strata = [Stratum(4, 10, 2), Stratum(3, 5, 1)]
        assert all_inlier_probability(7, 15, 3, sampling=strata) == (6 * 3) / (45 * 5)
        assert approximate_all_inlier_probability(10, 100, 3) == 1e-3


class TestGuarantee:
    @given(counts(largest=10**6, largest_k=7), confidences)
    def test_exact_rule_keeps_its_word(self, problem: tuple[int, int, int], s: float) -> None:
        trials = required_trials(*problem, s)
        assume(0 < trials < 10**9)
        assert success_probability(trials, *problem) >= s * (1 - 1e-9)

    @given(counts(largest=10**6, largest_k=7), st.integers(0, 10**6))
    def test_success_probability(self, problem: tuple[int, int, int], trials: int) -> None:
        exact = hypergeometric(*problem)
        with mpmath.workdps(60):
            miss = 1 - mpmath.mpf(exact.numerator) / exact.denominator
            expected = float(1 - miss**trials)
        result = success_probability(trials, *problem)
        assert result == pytest.approx(expected, rel=1e-12, abs=1e-300)

    def test_success_probability_limits(self) -> None:
        assert success_probability(0, 5, 5, 2) == 0.0
        assert success_probability(math.inf, 1, 5, 2) == 0.0
        assert success_probability(math.inf, 2, 5, 2) == 1.0
        assert success_probability(10**400, 2, 5, 2) == 1.0
        assert success_probability(1, 5, 5, 2) == 1.0

    @given(counts(largest=10**6, largest_k=7), confidences)
    def test_true_success_probability(self, problem: tuple[int, int, int], s: float) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = hypergeometric(*problem)
        approximate = Fraction(n_inliers, n_samples) ** sample_size
        result = true_success_probability(*problem, s)
        assert 0.0 <= result <= s
        assume(0 < exact < 1 and 0 < s < 1)
        with mpmath.workdps(400):
            rate = mpmath.log(1 - mpmath.mpf(s)) / mpmath.log(
                mpmath.mpf((1 - approximate).numerator) / (1 - approximate).denominator
            )
            miss = mpmath.mpf((1 - exact).numerator) / (1 - exact).denominator
            expected = float(1 - miss**rate)
        assert result == pytest.approx(expected, rel=1e-11, abs=1e-300)

    @given(counts(largest=10**9, largest_k=7), st.sampled_from([0.5, 0.99]))
    def test_undersampling(self, problem: tuple[int, int, int], s: float) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = hypergeometric(*problem)
        approximate = Fraction(n_inliers, n_samples) ** sample_size
        result = undersampling(*problem, s)
        assert result >= 0
        assert (result == 0) == (exact == approximate)
        assume(0 < exact < approximate)
        with mpmath.workdps(400):
            log_exact, log_approximate = (
                mpmath.log(mpmath.mpf((1 - p).numerator) / (1 - p).denominator)
                for p in (exact, approximate)
            )
            expected = float(log_approximate / log_exact - 1)
        assert result == pytest.approx(expected, rel=1e-13)

    def test_limits(self) -> None:
        assert true_success_probability(2, 10, 3, 0.99) == 0.0
        assert true_success_probability(10, 10, 3, 0.99) == 0.99
        assert true_success_probability(9, 10, 3, 1) == 1.0
        assert true_success_probability(9, 10, 3, 0) == 0.0
        assert true_success_probability(10, 10, 3, 0.99, sampling="replacement") == 0.0
        assert undersampling(2, 10, 3, 0.99) == math.inf
        assert undersampling(0, 10, 3, 0.99) == 0.0
        assert undersampling(10, 10, 3, 0.99, sampling="replacement") == math.inf
        # A sampler that draws only from an all-inlier stratum oversamples under the old rule.
        lucky = [Stratum(3, 3, 2), Stratum(0, 7, 0)]
        assert undersampling(3, 10, 2, 0.99, sampling=lucky) == -1.0
        assert true_success_probability(3, 10, 2, 0.99, sampling=lucky) == 1.0

    def test_limit_of_the_correction(self) -> None:
        # For I = k and n -> infinity the correction tends to k**k / k!.
        for k in range(2, 9):
            expected = k**k / math.factorial(k) - 1
            assert undersampling(k, 10**9, k, 0.99) == pytest.approx(expected, rel=1e-6)


def log_miss(probability: Fraction) -> mpmath.mpf:
    """log(1 - P), whatever its size."""
    if probability < Fraction(1, 2):
        return mpmath.log1p(-mpmath.mpf(probability.numerator) / probability.denominator)
    miss = 1 - probability
    return mpmath.log(mpmath.mpf(miss.numerator) / miss.denominator)


@st.composite
def extremes(draw: st.DrawFn) -> tuple[int, int, int]:
    """Samples so large that P leaves the floats, and more measurements than these can count."""
    if draw(st.booleans()):
        n_samples = 10 ** draw(st.integers(20, 420))
        few = draw(st.integers(2, 30))
        n_inliers = draw(st.sampled_from([few, n_samples // few, n_samples - few]))
        return n_inliers, n_samples, draw(st.integers(1, min(n_inliers, 6)))
    n_samples = draw(st.integers(1000, 3300))
    sample_size = draw(st.integers(150, 400))
    return draw(st.integers(sample_size, n_samples - 1)), n_samples, sample_size


near_the_limits = st.integers(280, 700).flatmap(
    lambda digits: st.sampled_from([Fraction(1, 10**digits), 1 - Fraction(1, 10**digits)])
)


class TestBeyondTheFloats:
    """Quotients below the smallest float, and above the largest."""

    @given(extremes(), st.one_of(confidences.map(Fraction), near_the_limits))
    @settings(max_examples=60)
    @example((220, 3300, 220), Fraction(99, 100))
    @example((2000, 10_000, 2000), Fraction(99, 100))
    def test_guarantees(self, problem: tuple[int, int, int], s: Fraction) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = Fraction(math.comb(n_inliers, sample_size), math.comb(n_samples, sample_size))
        approximate = Fraction(n_inliers, n_samples) ** sample_size
        with mpmath.workdps(900):
            ratio = log_miss(approximate) / log_miss(exact)
            excess = float(ratio - 1)
            reached = float(-mpmath.expm1(log_miss(s) / ratio)) if 0 < s < 1 else float(s)
        assert undersampling(*problem, s) == pytest.approx(excess, rel=1e-12, abs=1e-300)
        result = true_success_probability(*problem, s)
        assert result == pytest.approx(reached, rel=1e-11, abs=1e-300)

    @given(extremes(), st.integers(0, 900).map(lambda digits: 10**digits))
    @settings(max_examples=60)
    @example((100, 10**6, 100), 10**500)
    @example((100, 10**5, 100), 10**300)
    def test_success_probability(self, problem: tuple[int, int, int], trials: int) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = Fraction(math.comb(n_inliers, sample_size), math.comb(n_samples, sample_size))
        with mpmath.workdps(60):
            expected = float(-mpmath.expm1(trials * log_miss(exact)))
        result = success_probability(trials, *problem)
        assert result == pytest.approx(expected, rel=1e-11, abs=1e-300)
        assert success_probability(math.inf, *problem) == 1.0

    @given(counts(largest=10**6, largest_k=7), near_the_limits)
    @settings(max_examples=60)
    @example((6, 20, 2), 1 - Fraction(1, 10**400))
    def test_required_trials(self, problem: tuple[int, int, int], s: Fraction) -> None:
        n_inliers, n_samples, sample_size = problem
        exact = hypergeometric(*problem)
        approximate = Fraction(n_inliers, n_samples) ** sample_size
        for rule, probability in (
            (required_trials, exact),
            (approximate_required_trials, approximate),
        ):
            found = rule(*problem, s)
            if not 0 < probability < 1:
                assert found == (math.inf if probability == 0 else 1)
                continue
            with mpmath.workdps(900):
                quotient = log_miss(s) / log_miss(probability)
                if abs(quotient - mpmath.nint(quotient)) > mpmath.mpf(10) ** -100:
                    assert found == int(mpmath.ceil(quotient))
                else:
                    miss, nearest = 1 - probability, int(mpmath.nint(quotient))
                    assert found == nearest + (miss**nearest > 1 - s)

    def test_a_sampler_by_strata_that_is_far_luckier_than_its_approximation(self) -> None:
        lucky = [Stratum(9, 10, 5), Stratum(0, 10**6, 0)]
        problem = (9, 10**6 + 10, 5)
        assert undersampling(*problem, 0.99, sampling=lucky) == -1.0
        assert true_success_probability(*problem, 0.99, sampling=lucky) == 1.0
        almost_sure = [Stratum(10**400 - 1, 10**400, 1), Stratum(0, 10**400, 0)]
        problem = (10**400 - 1, 2 * 10**400, 1)
        result = undersampling(*problem, 0.99, sampling=almost_sure)
        assert result == pytest.approx(math.log(0.5) / (-400 * math.log(10)) - 1, rel=1e-12)


class TestArguments:
    @pytest.mark.parametrize("kind", [np.int64, np.int32, np.uint8, np.float64, np.float32, float])
    def test_whole_numbers_of_any_kind(self, kind: type) -> None:
        assert required_trials(kind(6), kind(20), kind(2), 0.99) == 56
        assert approximate_required_trials(kind(6), kind(20), kind(2), 0.99) == 49
        assert type(required_trials(kind(6), kind(20), kind(2), 0.99)) is int
        assert success_probability(kind(56), kind(6), kind(20), kind(2)) > 0.99

    @pytest.mark.parametrize("kind", [np.int64, np.int32, np.float64])
    def test_numpy_counts_do_not_wrap_around(self, kind: type) -> None:
        for rule in (required_trials, approximate_required_trials):
            # The setting is known by then, under keys that the others equal.
            known = rule(300_000, 10**6, 7, 0.99)
            assert rule(300_000, kind(10**6), kind(7), 0.99) == known
            assert rule(kind(300_000), kind(10**6), kind(7), 0.99) == known
            assert rule(300_000, kind(10**6), 7, 0.99) == known
            assert rule(300_000, 10**6, kind(7), 0.99) == known

    def test_rejects_arrays_and_fractions_beyond_the_floats_by_name(self) -> None:
        for rule in (required_trials, approximate_required_trials):
            for value in (np.array([6, 7]), Fraction(10**400), Fraction(13, 2)):
                with pytest.raises(ValueError, match=r"^n_inliers must be"):
                    rule(value, 20, 2, 0.99)  # type: ignore[arg-type]
            assert rule(Fraction(6), 20, 2, 0.99) == rule(6, 20, 2, 0.99)

    @pytest.mark.parametrize("kind", [np.float64, np.float32, np.longdouble])
    def test_numpy_confidence(self, kind: type) -> None:
        s = kind(0.75)
        assert required_trials(6, 20, 2, s) == required_trials(6, 20, 2, 0.75)

    @pytest.mark.parametrize("value", [2.5, math.nan, math.inf, "3", None, [3], 3 + 0j])
    @pytest.mark.parametrize("name", ["n_inliers", "n_samples", "sample_size"])
    def test_rejects_other_counts(self, name: str, value: object) -> None:
        arguments = {"n_inliers": 6, "n_samples": 20, "sample_size": 2, name: value}
        for function in (required_trials, approximate_required_trials):
            with pytest.raises(ValueError, match=name):
                function(**arguments, confidence=0.99)
        with pytest.raises(ValueError, match=name):
            all_inlier_probability(**arguments)

    @pytest.mark.parametrize(
        ("arguments", "name"),
        [
            ((-1, 20, 2), "n_inliers"),
            ((21, 20, 2), "n_inliers"),
            ((0, 0, 1), "n_samples"),
            ((0, -3, 1), "n_samples"),
            ((6, 20, 0), "sample_size"),
            ((6, 20, 21), "sample_size"),
        ],
    )
    def test_rejects_counts_out_of_range(self, arguments: tuple[int, int, int], name: str) -> None:
        with pytest.raises(ValueError, match=f"^{name} "):
            required_trials(*arguments, 0.99)
        with pytest.raises(ValueError, match=f"^{name} "):
            undersampling(*arguments, 0.99)

    @pytest.mark.parametrize(
        "value",
        [-0.1, 1.5, math.nan, math.inf, "0.99", None, [0.9], Decimal("NaN"), Fraction(3, 2)],
    )
    def test_rejects_other_confidences(self, value: object) -> None:
        for function in (
            required_trials,
            approximate_required_trials,
            true_success_probability,
            undersampling,
        ):
            with pytest.raises(ValueError, match="confidence"):
                function(6, 20, 2, value)  # type: ignore[operator]

    @pytest.mark.parametrize("value", [-1, 2.5, "3", None, math.nan])
    def test_rejects_other_trials(self, value: object) -> None:
        with pytest.raises(ValueError, match="trials"):
            success_probability(value, 6, 20, 2)  # type: ignore[arg-type]

    @pytest.mark.parametrize(
        "sampling",
        [
            "uniform",
            None,
            3,
            [(6, 20, 2)],
            [Stratum(6, 20, 1)],
            [Stratum(6, 5, 1), Stratum(0, 15, 1)],
            [Stratum(6, 19, 0), Stratum(0, 1, 2)],
            [Stratum(2.5, 20, 2)],  # type: ignore[arg-type]
            [],
        ],
    )
    def test_rejects_other_sampling(self, sampling: object) -> None:
        with pytest.raises(ValueError, match="sampling"):
            required_trials(6, 20, 2, 0.99, sampling=sampling)  # type: ignore[arg-type]
