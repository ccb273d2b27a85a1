"""The curves of the paper's theory figures. Standard library only.

The paper's product for P_e, equation (5), also has a value where p n is not a whole number. The
curves over n follow it, from n = k / p on, and mark the points where p n is whole: problems
that exist, where it is C(I, k) / C(n, k).
"""

import math
from collections.abc import Callable
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
