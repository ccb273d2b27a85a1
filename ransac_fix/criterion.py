"""The mathematics of the stopping criterion: probabilities, trials, and what they guarantee.

Pure, scalar and standard library only. Throughout, ``n_samples`` (n) measurements hold
``n_inliers`` (I) inliers of one model, a minimal sample holds ``sample_size`` (k)
measurements, and ``confidence`` (s) is the wanted probability of at least one all-inlier
sample.

What the numbers promise: once a model with I inliers is in hand, N trials contain at least
one all-inlier sample of *any other* set of I inliers with probability s. That is a guarantee
about what may still be missed, not the success rate of a whole run.

References
----------
J. Schönberger, V. Larsson, M. Pollefeys, "Fixing the RANSAC Stopping Criterion", ICCV 2025,
section 3.
"""

import decimal
import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from math import ceil, comb, log, log1p
from numbers import Integral, Rational, Real
from typing import Literal, SupportsFloat, SupportsIndex, TypeAlias

__all__ = [
    "Confidence",
    "Count",
    "Sampling",
    "Stratum",
    "all_inlier_probability",
    "approximate_all_inlier_probability",
    "approximate_required_trials",
    "required_trials",
    "success_probability",
    "true_success_probability",
    "undersampling",
]

Count: TypeAlias = SupportsIndex | SupportsFloat
"""An integer, a NumPy integer, or a float that holds a whole number."""

Confidence: TypeAlias = float | Fraction | Decimal | SupportsFloat
"""A probability. A float means its exact binary value; fractions and decimals are exact too."""

# The relative error of log1p(-s) / log1p(-P) as computed below: one and a half units of 2**-53
# in P, amplified by at most 1.45 on its way through the logarithm, four for each logarithm
# (twice what the usual C libraries state) and one for the rest make less than 12 units.
_ABOVE = 1.0 + 2.0**-49
_BELOW = 1.0 - 2.0**-49

# The default, recognised by identity on the fast path.
_DISTINCT: Literal["distinct"] = "distinct"

# Below this a quotient of integers may be subnormal, and no longer has full relative precision, nor
# has its logarithm, which is less than the next, to be had from it; integers of this many bits are
# safely inside the floats.
_SMALLEST = 1e-290
_LEAST_LOG = -660.0
_MOST_BITS = 960
# Below this P is -log(1 - P) to the last place.
_LINEAR = 2.0**-60

# (n, k, s) -> C(n, k), its reciprocal, log(1 - s) and n**k: the half of the work that does not
# change from one call of a RANSAC run to the next.
_Setting: TypeAlias = tuple[int, float, float, int]
_SETTINGS: dict[tuple[object, object, object], _Setting] = {}
_MOST_SETTINGS = 1024


@dataclass(frozen=True, slots=True)
class Stratum:
    """One stratum of a sampler that draws a fixed number of measurements from each.

    Parameters
    ----------
    n_inliers, n_samples : int
        Inliers and measurements in the stratum.
    sample_size : int
        Distinct measurements drawn from the stratum in each trial; 0 is allowed.
    """

    n_inliers: int
    n_samples: int
    sample_size: int


Sampling: TypeAlias = Literal["distinct", "replacement"] | Sequence[Stratum]
"""How a minimal sample is drawn.

``"distinct"``: k distinct measurements, uniformly. ``"replacement"``: k independent draws, where
a repeated measurement makes the sample useless. A sequence of `Stratum`: fixed numbers of
distinct measurements from each stratum.
"""


def required_trials(
    n_inliers: Count,
    n_samples: Count,
    sample_size: Count,
    confidence: Confidence,
    *,
    sampling: Sampling = _DISTINCT,
) -> int | float:
    """Return the smallest number of trials N with ``(1 - P)**N <= 1 - confidence``, exactly.

    P is the true chance that one sample holds inliers only, `all_inlier_probability`.

    Parameters
    ----------
    n_inliers : int
        Inliers of the model in hand, 0 to `n_samples`.
    n_samples : int
        Measurements.
    sample_size : int
        Measurements in one minimal sample, 1 to `n_samples`.
    confidence : float, Fraction or Decimal
        Wanted probability of at least one all-inlier sample, 0 to 1. A float means its binary
        value: 0.9 is slightly more than 9/10.
    sampling : "distinct", "replacement" or sequence of Stratum, default "distinct"
        How a sample is drawn. The strata must add up to the three counts.

    Returns
    -------
    int or math.inf
        In this order: 0 when `confidence` is 0; ``inf`` when P is 0; 1 when P is 1; ``inf``
        when `confidence` is 1.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.

    Notes
    -----
    Equation (2) of the paper with P_e of equation (4). Logarithms in floating point decide
    unless an integer lies within their error bound; then integers and decimal logarithms of
    rising precision do, so the result is never off by one.

    Examples
    --------
    >>> required_trials(6, 20, 2, 0.99)
    56
    >>> approximate_required_trials(6, 20, 2, 0.99)
    49
    """
    # The path of nearly every call, kept well under a microsecond: whatever does not fit here
    # is sorted out, with its error message, in the general path below.
    if sampling is _DISTINCT:
        try:
            key = (n_samples, sample_size, confidence)
            possible, scale, log_allowed, _ = _SETTINGS.get(key) or _setting(*key)
            if sample_size <= n_inliers < n_samples:  # type: ignore[operator]
                good = comb(n_inliers, sample_size)  # type: ignore[arg-type]
                probability = good * scale
                trials = log_allowed / (
                    log1p(-probability) if probability <= 0.5 else log((possible - good) * scale)
                )
                upper = ceil(trials * _ABOVE)
                if trials * _BELOW > upper - 1:
                    return upper
        except (TypeError, ValueError):
            pass
    counts = _counts(n_inliers, n_samples, sample_size)
    return _trials(*_exact_ratio(*counts, sampling), confidence)


def approximate_required_trials(
    n_inliers: Count, n_samples: Count, sample_size: Count, confidence: Confidence
) -> int | float:
    """Return the smallest N with ``(1 - p**k)**N <= 1 - confidence``: the common, wrong rule.

    It differs from `required_trials` in the probability alone: it takes
    `approximate_all_inlier_probability`.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, confidence
        As in `required_trials`.

    Returns
    -------
    int or math.inf
        As in `required_trials`.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.
    """
    # As in `required_trials`, whose error bounds hold: both quotients are correctly rounded.
    try:
        key = (n_samples, sample_size, confidence)
        _, _, log_allowed, possible = _SETTINGS.get(key) or _setting(*key)
        # A NumPy integer equals its key, but its powers wrap around.
        if type(n_inliers) is type(sample_size) is int and 0 < n_inliers < n_samples:  # type: ignore[operator]
            good = n_inliers**sample_size
            probability = good / possible
            if probability > _SMALLEST:
                trials = log_allowed / (
                    log1p(-probability) if probability <= 0.5 else log((possible - good) / possible)
                )
                upper = ceil(trials * _ABOVE)
                if trials * _BELOW > upper - 1:
                    return upper
    except TypeError:
        pass
    return _trials(*_approximate_ratio(*_counts(n_inliers, n_samples, sample_size)), confidence)


def all_inlier_probability(
    n_inliers: Count, n_samples: Count, sample_size: Count, *, sampling: Sampling = _DISTINCT
) -> float:
    """Return the probability that one minimal sample holds inliers only, correctly rounded.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, sampling
        As in `required_trials`.

    Returns
    -------
    float
        ``C(I, k) / C(n, k)`` for distinct draws (P_e, equation (4) of the paper),
        ``I (I-1) ... (I-k+1) / n**k`` for draws with replacement, and the product of the first
        form over the strata.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.
    """
    # The path of nearly every call, as in `required_trials`.
    if (
        sampling is _DISTINCT
        and type(n_inliers) is type(n_samples) is type(sample_size) is int
        and 0 <= n_inliers <= n_samples
        and 1 <= sample_size <= n_samples
    ):
        return comb(n_inliers, sample_size) / comb(n_samples, sample_size)
    numerator, denominator = _exact_ratio(*_counts(n_inliers, n_samples, sample_size), sampling)
    return numerator / denominator


def approximate_all_inlier_probability(
    n_inliers: Count, n_samples: Count, sample_size: Count
) -> float:
    """Return ``(n_inliers / n_samples)**sample_size``, correctly rounded.

    P_a, equation (3) of the paper: what nearly every implementation assumes. It is right for
    ``sample_size == 1`` only, or when all measurements are inliers, or none is.

    Parameters
    ----------
    n_inliers, n_samples, sample_size
        As in `required_trials`.

    Returns
    -------
    float
        The assumed probability.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.
    """
    numerator, denominator = _approximate_ratio(*_counts(n_inliers, n_samples, sample_size))
    return numerator / denominator


def success_probability(
    trials: Count,
    n_inliers: Count,
    n_samples: Count,
    sample_size: Count,
    *,
    sampling: Sampling = _DISTINCT,
) -> float:
    """Return the probability that `trials` samples contain at least one all-inlier sample.

    Parameters
    ----------
    trials : int or math.inf
        Samples drawn, not negative.
    n_inliers, n_samples, sample_size, sampling
        As in `required_trials`.

    Returns
    -------
    float
        ``1 - (1 - P)**trials`` with the true P, equation (1) of the paper.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.
    """
    counts = _counts(n_inliers, n_samples, sample_size)
    numerator, denominator = _exact_ratio(*counts, sampling)
    if isinstance(trials, float) and trials == math.inf:
        return 1.0 if numerator else 0.0
    drawn = _count(trials, "trials")
    if drawn < 0:
        raise ValueError(f"trials must not be negative, not {trials!r}")
    if drawn == 0 or numerator == 0:
        return 0.0
    try:
        if numerator / denominator < _SMALLEST:
            return -math.expm1(-(drawn * numerator / denominator))
        return -math.expm1(drawn * _log_miss(numerator, denominator))
    except OverflowError:  # beyond the floats
        return 1.0


def true_success_probability(
    n_inliers: Count,
    n_samples: Count,
    sample_size: Count,
    confidence: Confidence,
    *,
    sampling: Sampling = _DISTINCT,
) -> float:
    """Return the success probability that the approximate rule really reaches.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, confidence, sampling
        As in `required_trials`.

    Returns
    -------
    float
        s_true of equation (9) of the paper, with its real-valued number of trials:
        ``1 - (1 - P)**(log(1 - s) / log(1 - p**k))``. Equal to `confidence` where both
        probabilities are equal, and 0 where no all-inlier sample exists.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.
    """
    counts = _counts(n_inliers, n_samples, sample_size)
    exact = _exact_ratio(*counts, sampling)
    approximate = _approximate_ratio(*counts)
    miss = 1 - _confidence(confidence)
    if exact[0] == 0:
        return 0.0
    if miss == 1 or Fraction(*exact) == Fraction(*approximate):
        return float(1 - miss)
    if approximate[0] == approximate[1]:  # all inliers: the rule asks for no trial at all
        return 0.0
    if miss == 0 or exact[0] == exact[1]:
        return 1.0
    log_miss = _log_miss(miss.denominator - miss.numerator, miss.denominator)
    excess = _undersampling(exact, approximate)
    # By strata P can be far above its approximation; 1 + excess would cancel.
    ratio = 1.0 + excess if excess > -0.5 else _log_miss(*approximate) / _log_miss(*exact)
    return -math.expm1(log_miss / ratio) if ratio else 1.0


def undersampling(
    n_inliers: Count,
    n_samples: Count,
    sample_size: Count,
    confidence: Confidence,
    *,
    sampling: Sampling = _DISTINCT,
) -> float:
    """Return by what fraction the exact number of trials exceeds the approximate one.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, confidence, sampling
        As in `required_trials`. The result does not depend on `confidence`, which cancels out
        of the real-valued ratio; it is checked all the same.

    Returns
    -------
    float
        ``(N_e - N_a) / N_a``, real-valued, section 4 of the paper. 0 where both probabilities
        are equal; ``inf`` where only the approximate rule ever stops.

    Raises
    ------
    ValueError
        If an argument is not of its kind or out of range; the message names it.
    """
    counts = _counts(n_inliers, n_samples, sample_size)
    exact = _exact_ratio(*counts, sampling)
    _confidence(confidence)
    return _undersampling(exact, _approximate_ratio(*counts))


def _setting(n_samples: object, sample_size: object, confidence: object) -> _Setting:
    """Return, and remember, what all calls of one RANSAC run share.

    Raises
    ------
    TypeError
        For anything but plain integers and a plain float in the range that floats can serve.
    """
    if (
        type(n_samples) is int
        and type(sample_size) is int
        and type(confidence) is float
        and 1 <= sample_size <= n_samples
        and _SMALLEST < confidence < 1.0
    ):
        possible = comb(n_samples, sample_size)
        if possible.bit_length() < _MOST_BITS:
            if len(_SETTINGS) >= _MOST_SETTINGS:
                _SETTINGS.clear()
            setting = possible, 1 / possible, log1p(-confidence), n_samples**sample_size
            _SETTINGS[n_samples, sample_size, confidence] = setting
            return setting
    raise TypeError


def _undersampling(exact: tuple[int, int], approximate: tuple[int, int]) -> float:
    """Return ``log(1 - P_a) / log(1 - P_e) - 1`` without cancellation."""
    exact_ratio, approximate_ratio = Fraction(*exact), Fraction(*approximate)
    if exact_ratio == approximate_ratio:
        return 0.0
    if exact_ratio == 0 or approximate_ratio == 1:
        return math.inf
    if exact_ratio == 1:  # strata can be so lucky
        return -1.0
    if approximate_ratio < _LINEAR:  # the logarithms might underflow
        return _float((approximate_ratio - exact_ratio) / exact_ratio)
    # log(1 - P_a) - log(1 - P_e) = log(1 - (P_a - P_e) / (1 - P_e))
    difference = (approximate_ratio - exact_ratio) / (1 - exact_ratio)
    log_difference = _log_miss(*difference.as_integer_ratio())
    if exact_ratio < _SMALLEST:
        return _float(Fraction(-log_difference) / exact_ratio)
    return log_difference / _log_miss(*exact)


def _float(value: Fraction) -> float:
    """Return the nearest float, infinity for a number beyond them."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _count(value: object, name: str) -> int:
    """Return `value` as an int if it is a whole number of any numeric kind."""
    if type(value) is int:  # of the abstract kinds it takes ten times as long to ask
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Rational):
        if value.denominator == 1:
            return int(value.numerator)
    elif isinstance(value, Real):
        number = float(value)
        if number.is_integer():
            return int(number)
    raise ValueError(f"{name} must be a whole number, not {value!r}")


def _counts(n_inliers: object, n_samples: object, sample_size: object) -> tuple[int, int, int]:
    inliers = _count(n_inliers, "n_inliers")
    samples = _count(n_samples, "n_samples")
    size = _count(sample_size, "sample_size")
    if samples < 1:
        raise ValueError(f"n_samples must be at least 1, not {samples}")
    if not 0 <= inliers <= samples:
        raise ValueError(f"n_inliers must be from 0 to n_samples = {samples}, not {inliers}")
    if not 1 <= size <= samples:
        raise ValueError(f"sample_size must be from 1 to n_samples = {samples}, not {size}")
    return inliers, samples, size


def _confidence(value: object) -> Fraction:
    """Return a probability as the exact fraction it stands for."""
    fraction: Fraction | None = None
    if isinstance(value, Decimal):
        if value.is_finite():
            fraction = Fraction(value)
    elif isinstance(value, Rational):
        fraction = Fraction(int(value.numerator), int(value.denominator))
    elif isinstance(value, Real) and math.isfinite(value):
        fraction = Fraction(*value.as_integer_ratio())  # type: ignore[attr-defined]
    if fraction is None or not 0 <= fraction <= 1:
        raise ValueError(f"confidence must be a probability from 0 to 1, not {value!r}")
    return fraction


def _strata(n_inliers: int, n_samples: int, sample_size: int, sampling: object) -> list[Stratum]:
    """Return the strata, checked to be possible and to add up to the three counts."""
    if isinstance(sampling, str) or not isinstance(sampling, Sequence):
        raise ValueError(
            f"sampling must be 'distinct', 'replacement' or a sequence of Stratum, not {sampling!r}"
        )
    strata = []
    for stratum in sampling:
        if not isinstance(stratum, Stratum):
            raise ValueError(f"sampling must hold Stratum objects, not {stratum!r}")
        checked = Stratum(
            _count(stratum.n_inliers, "sampling: n_inliers"),
            _count(stratum.n_samples, "sampling: n_samples"),
            _count(stratum.sample_size, "sampling: sample_size"),
        )
        if not (
            0 <= checked.n_inliers <= checked.n_samples
            and 0 <= checked.sample_size <= checked.n_samples
        ):
            raise ValueError(f"sampling holds an impossible stratum: {stratum!r}")
        strata.append(checked)
    sums = (
        sum(stratum.n_inliers for stratum in strata),
        sum(stratum.n_samples for stratum in strata),
        sum(stratum.sample_size for stratum in strata),
    )
    if sums != (n_inliers, n_samples, sample_size):
        raise ValueError(
            f"sampling: the strata add up to {sums}, but (n_inliers, n_samples, sample_size)"
            f" is {(n_inliers, n_samples, sample_size)}"
        )
    return strata


def _exact_ratio(
    n_inliers: int, n_samples: int, sample_size: int, sampling: object
) -> tuple[int, int]:
    """Return the all-inlier probability of the sampler as numerator and denominator."""
    if isinstance(sampling, str) and sampling == "distinct":
        return comb(n_inliers, sample_size), comb(n_samples, sample_size)
    if isinstance(sampling, str) and sampling == "replacement":
        return math.perm(n_inliers, sample_size), n_samples**sample_size
    strata = _strata(n_inliers, n_samples, sample_size, sampling)
    return (
        math.prod(comb(stratum.n_inliers, stratum.sample_size) for stratum in strata),
        math.prod(comb(stratum.n_samples, stratum.sample_size) for stratum in strata),
    )


def _approximate_ratio(n_inliers: int, n_samples: int, sample_size: int) -> tuple[int, int]:
    return n_inliers**sample_size, n_samples**sample_size


def _log_miss(numerator: int, denominator: int) -> float:
    """Return ``log(1 - numerator / denominator)``.

    To within two units in the last place, unless it is below `_LEAST_LOG` or the quotient below
    `_SMALLEST`: there only to the precision that its parts leave.
    """
    if numerator == denominator:
        return -math.inf
    if 2 * abs(numerator) <= denominator:
        return log1p(-(numerator / denominator))
    kept = denominator - numerator
    try:
        quotient = kept / denominator
    except OverflowError:
        quotient = math.inf
    return log(quotient) if _SMALLEST < quotient < math.inf else log(kept) - log(denominator)


def _trials(numerator: int, denominator: int, confidence: object) -> int | float:
    """Return the smallest N with ``(1 - numerator / denominator)**N <= 1 - confidence``."""
    wanted = _confidence(confidence)
    if wanted == 0:
        return 0
    if numerator == 0:
        return math.inf
    if numerator == denominator:
        return 1
    if wanted == 1:
        return math.inf
    log_miss = _log_miss(numerator, denominator)
    log_allowed = _log_miss(*wanted.as_integer_ratio())
    if all(_LEAST_LOG < value < -_SMALLEST for value in (log_miss, log_allowed)):
        trials = log_allowed / log_miss
        upper = ceil(trials * _ABOVE)
        if trials * _BELOW > upper - 1:
            return upper
    return _trials_by_decimals(Fraction(numerator, denominator), wanted)


def _trials_by_decimals(probability: Fraction, confidence: Fraction) -> int:
    """Decide what floats cannot: an exact tie by integers, the rest by decimal logarithms."""
    miss = 1 - probability
    allowed = 1 - confidence
    # Enough digits for the integer part of N, as the first try.
    bits = max(0, probability.denominator.bit_length() - probability.numerator.bit_length())
    digits = 25 + bits * 3 // 10
    while True:
        lower, upper = _decimal_bounds(probability, confidence, digits)
        if lower == upper:
            return upper
        # miss**N == allowed in lowest terms means equal numerators and equal denominators,
        # which bounds N by the length of the denominator (1074 bits for a float).
        if (
            lower * (miss.denominator.bit_length() - 1) < allowed.denominator.bit_length()
            and miss.denominator**lower == allowed.denominator
            and miss.numerator**lower == allowed.numerator
        ):
            return lower
        digits *= 2


def _decimal_bounds(probability: Fraction, confidence: Fraction, digits: int) -> tuple[int, int]:
    """Return bounds on the smallest integer not below the quotient of the logarithms."""
    with decimal.localcontext(
        prec=digits, Emin=decimal.MIN_EMIN, Emax=decimal.MAX_EMAX, rounding=decimal.ROUND_HALF_EVEN
    ):
        quotient = _decimal_log_miss(confidence, digits) / _decimal_log_miss(probability, digits)
        # Each logarithm is good to a relative 10**(1 - digits).
        error = quotient * Decimal(10) ** (3 - digits)
        return (
            int((quotient - error).to_integral_value(decimal.ROUND_CEILING)),
            int((quotient + error).to_integral_value(decimal.ROUND_CEILING)),
        )


def _decimal_log_miss(probability: Fraction, digits: int) -> Decimal:
    """Return ``log(1 - probability)`` to a relative ``10**(1 - digits)``."""
    # Near 1 the logarithm loses as many digits as 1 - x has zeros: carry them.
    bits = max(0, probability.denominator.bit_length() - probability.numerator.bit_length())
    with decimal.localcontext(decimal.getcontext(), prec=digits + bits * 3 // 10 + 5):
        miss = 1 - probability
        return (Decimal(miss.numerator) / Decimal(miss.denominator)).ln()
