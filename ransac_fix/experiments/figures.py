"""The curves of the paper's theory figures. Standard library only.

The paper's product for P_e, equation (5), also has a value where p n is not a whole number. The
curves over n follow it, from n = k / p on, and mark the points where p n is whole: problems
that exist, where it is C(I, k) / C(n, k).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

CONFIDENCE = Fraction(99, 100)
"""The paper's confidence in figures "true success rate" and "amount of undersampling"."""

_MOST_MEASUREMENTS = 300
_SAMPLE_SIZES = (2, 3, 4, 5, 7)
_RATIOS = (Fraction(1, 10), Fraction(1, 5), Fraction(3, 10), Fraction(1, 2), Fraction(7, 10))
# What varies with the sample size is shown at this ratio, what varies with the ratio at this size.
_RATIO = Fraction(3, 10)
_SAMPLE_SIZE = 5
# The teaser's essential matrices.
_TEASER_MEASUREMENTS = 50
_TEASER_TRIALS = tuple(round(10 ** (i / 4), 6) for i in range(4, 15))


@dataclass(frozen=True, slots=True)
class Curve:
    """One curve of a figure.

    Parameters
    ----------
    label : str
        What tells it from the others of its panel, in matplotlib's mathematics.
    x, y : tuple of float
        Its points.
    whole : tuple of int
        Which points are problems that exist, with a whole number of inliers.
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    whole: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes.

    Parameters
    ----------
    title : str
        What its curves have in common.
    curves : tuple of Curve
        In the order of the legend.
    """

    title: str
    curves: tuple[Curve, ...]


def error_panels() -> tuple[Panel, ...]:
    """Return the relative error (P_a - P_e) / P_a over k and p at n = 50 and n = 500."""
    panels = []
    for n in (50, 500):
        ratios = [Fraction(inliers, n) for inliers in range(1, n + 1)]
        curves = tuple(
            Curve(
                f"$k={k}$",
                tuple(float(p) for p in ratios),
                tuple(relative_error(p, Fraction(n), k) for p in ratios),
                tuple(range(n)),
            )
            for k in _SAMPLE_SIZES
        )
        panels.append(Panel(f"$n={n}$", curves))
    return tuple(panels)


def success_panels() -> tuple[Panel, ...]:
    """Return the true success of the p**k rule over n: for several k, and for several p."""
    by_size = tuple(_over_n(f"$k={k}$", _RATIO, k, true_success) for k in _SAMPLE_SIZES)
    by_ratio = tuple(
        _over_n(f"$p={float(p):g}$", p, _SAMPLE_SIZE, true_success) for p in reversed(_RATIOS)
    )
    return (
        Panel(f"$p={float(_RATIO):g}$", by_size),
        Panel(f"$k={_SAMPLE_SIZE}$", by_ratio),
    )


def undersampling_panels() -> tuple[Panel, ...]:
    """Return (N_e - N_a) / N_a over n at s = 0.99 and k = 5 for several p."""
    curves = tuple(_over_n(f"$p={float(p):g}$", p, _SAMPLE_SIZE, missing_trials) for p in _RATIOS)
    return (Panel(f"$s={float(CONFIDENCE):g},\\ k={_SAMPLE_SIZE}$", curves),)


def tradeoff_panels() -> tuple[Panel, ...]:
    """Return success over mean trials as s varies, at the teaser's n = 50 and k = 5.

    Instances have numbers of inliers from a range, each equally often. See `tradeoff`.
    """
    panels = []
    for inliers in (range(10, 41), range(20, 41)):
        points = [
            tradeoff(inliers, _TEASER_MEASUREMENTS, _SAMPLE_SIZE, trials)
            for trials in _TEASER_TRIALS
        ]
        marked = tuple(range(len(points)))
        curves = tuple(
            Curve(label, _TEASER_TRIALS, tuple(point[i] for point in points), marked)
            for i, label in ((2, "best possible"), (0, "$p^k$ rule"), (1, "exact rule"))
        )
        title = (
            f"$n={_TEASER_MEASUREMENTS},\\ k={_SAMPLE_SIZE}$, {inliers[0]} to {inliers[-1]} inliers"
        )
        panels.append(Panel(title, curves))
    return tuple(panels)


def tradeoff(
    inliers: Sequence[int], n_samples: int, sample_size: int, mean_trials: float
) -> tuple[float, float, float]:
    """Return how often an all-inlier sample is drawn in the same mean number of trials.

    Parameters
    ----------
    inliers : sequence of int
        Numbers of inliers of instances that are equally frequent, each from k to n - 1 and
        known to the rule from the start.
    n_samples, sample_size : int
        n and k.
    mean_trials : float
        Mean over the instances of their real-valued numbers of trials.

    Returns
    -------
    approximate, exact, best : float
        Share of the instances with an all-inlier sample: of the p**k and the exact rule, each at
        the s at which it runs so many trials, and the largest that any division of the trials
        over the instances reaches.

    Notes
    -----
    With r = -log(1 - P_e), N trials succeed with probability 1 - exp(-r N). One trial more is worth
    r exp(-r N), and in the best division it is worth the same in all instances that get any: where
    samples of inliers are rare the probability to aim at is lower.
    """
    rates, assumed = [], []
    for count in inliers:
        ratio = Fraction(count, n_samples)
        exact = exact_probability(ratio, Fraction(n_samples), sample_size)
        rates.append(-math.log1p(-float(exact)))
        assumed.append(-math.log1p(-float(ratio**sample_size)))

    def success(trials: Sequence[float]) -> float:
        reached = (-math.expm1(-rate * n) for rate, n in zip(rates, trials, strict=True))
        return math.fsum(reached) / len(rates)

    def divided(rule: Sequence[float]) -> list[float]:
        """Give each instance trials in inverse proportion to its rate under the rule."""
        unit = mean_trials * len(rule) / math.fsum(1 / rate for rate in rule)
        return [unit / rate for rate in rule]

    def until(log_worth: float) -> list[float]:
        """Give each instance trials until the next is worth no more than that."""
        return [max(0.0, (math.log(rate) - log_worth) / rate) for rate in rates]

    high = math.log(max(rates))
    low = high - 2 * (1 + mean_trials * len(rates) * max(rates))
    for _ in range(200):
        middle = 0.5 * (low + high)
        enough = math.fsum(until(middle)) > mean_trials * len(rates)
        low, high = (middle, high) if enough else (low, middle)
    return success(divided(assumed)), success(divided(rates)), success(until(high))


def exact_probability(ratio: Fraction, n_samples: Fraction, sample_size: int) -> Fraction:
    """Return P_e by the paper's product, equation (5); 0 where p n is less than k.

    Parameters
    ----------
    ratio, n_samples : Fraction
        p and n, which need not have a whole product.
    sample_size : int
        k, less than or equal to n.
    """
    if ratio * n_samples < sample_size:
        return Fraction(0)
    return math.prod(
        ((ratio * n_samples - i) / (n_samples - i) for i in range(sample_size)), start=Fraction(1)
    )


def relative_error(ratio: Fraction, n_samples: Fraction, sample_size: int) -> float:
    """Return (P_a - P_e) / P_a, 1 where no all-inlier sample exists."""
    approximate = ratio**sample_size
    exact = exact_probability(ratio, n_samples, sample_size)
    return float((approximate - exact) / approximate)


def true_success(ratio: Fraction, n_samples: Fraction, sample_size: int) -> float:
    """Return s_true, equation (9) of the paper, at its confidence."""
    missing = missing_trials(ratio, n_samples, sample_size)
    return -math.expm1(math.log(1 - CONFIDENCE) / (1 + missing))


def missing_trials(ratio: Fraction, n_samples: Fraction, sample_size: int) -> float:
    """Return (N_e - N_a) / N_a; the confidence cancels out."""
    approximate = ratio**sample_size
    exact = exact_probability(ratio, n_samples, sample_size)
    # log(1 - P_a) - log(1 - P_e) in one logarithm, so that nothing cancels.
    difference = (approximate - exact) / (1 - exact)
    return math.log1p(-float(difference)) / math.log1p(-float(exact))


def _over_n(
    label: str,
    ratio: Fraction,
    sample_size: int,
    value: Callable[[Fraction, Fraction, int], float],
) -> Curve:
    first = sample_size / ratio
    ns = [first, *(Fraction(n) for n in range(math.floor(first) + 1, _MOST_MEASUREMENTS + 1))]
    return Curve(
        label,
        tuple(float(n) for n in ns),
        tuple(value(ratio, n, sample_size) for n in ns),
        tuple(i for i, n in enumerate(ns) if n.denominator == (ratio * n).denominator == 1),
    )
