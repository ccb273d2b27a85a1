"""Means, differences and ratios of paired measurements, with confidence intervals."""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LEVEL = 0.95
_Z = NormalDist().inv_cdf(0.5 + LEVEL / 2)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its 95 % interval.

    Parameters
    ----------
    value, low, high : float
    """

    value: float
    low: float
    high: float

    def times(self, factor: float) -> "Estimate":
        """Return the estimate in another unit."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)


def mean(values: FloatArray) -> Estimate:
    """Return the mean of independent measurements, shape (n,), by the central limit theorem.

    The interval is infinite for a single measurement.
    """
    return _around(float(values.mean()), values)


def relative_change(before: FloatArray, after: FloatArray) -> Estimate:
    """Return ``mean(after) / mean(before) - 1`` for pairs of measurements.

    Parameters
    ----------
    before, after : ndarray of shape (n,)
        The same instances in the same order: what they have in common cancels, which is what
        makes the interval narrow (delta method).

    Raises
    ------
    ValueError
        When the mean of `before` is 0.
    """
    base = float(before.mean())
    if base == 0.0:
        raise ValueError("a change relative to 0")
    ratio = float(after.mean()) / base
    return _around(ratio - 1.0, (after - ratio * before) / base)


def _around(value: float, deviations: FloatArray) -> Estimate:
    n = len(deviations)
    half = math.inf if n < 2 else _Z * float(deviations.std(ddof=1)) / math.sqrt(n)
    return Estimate(value, value - half, value + half)
