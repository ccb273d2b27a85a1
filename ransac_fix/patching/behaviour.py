"""Find out which rule a compiled library obeys by running it, before it is wrapped.

A small form of the audit's flip points. Of a planted problem with two groups of k + 1 and k + 2
measurements that agree, the trial in which a sample of the larger one is first drawn is found by
bisection. A confidence at which the approximate rule stops before that trial with the smaller
group in hand, and the exact rule after it, tells the two apart in one run.
"""

from collections.abc import Callable
from math import expm1, log1p
from typing import Any, Literal

__all__ = ["Count", "assumed_probability"]

Count = Callable[[Any, Any, int, float], int]
"""``count(x, y, trials, confidence)``: inliers of the map found between points x and y."""

_N_SAMPLES = 12
_BUDGET = 128
_SURE = 1.0 - 2.0**-44
# Local optimisation and early rejection of models disturb a stream now and then.
_STREAMS, _WANTED, _DISTURBED = 60, 7, 2


def assumed_probability(count: Count, sample_size: int) -> Literal["approximate", "exact"] | None:
    """Return the probability that the stopping rule of a plane-to-plane estimator assumes.

    Parameters
    ----------
    count : callable
        See `Count`. Runs with the same arguments give the same result.
    sample_size : int
        3 for affine maps, 4 for homographies. The exact rule asks for 2.0 and 3.0 times the
        trials of the approximate one here.

    Returns
    -------
    "approximate", "exact" or None
        None where the planted problems do not agree on one of the two.
    """
    found = []
    for seed in range(_STREAMS):
        answer = _stops_early(count, sample_size, seed)
        if answer is not None:
            found.append(answer)
        if len(found) == _WANTED:
            break
    if len(found) < _WANTED:
        return None
    early = sum(found)
    if early >= _WANTED - _DISTURBED:
        return "approximate"
    return "exact" if early == 0 else None


def _stops_early(count: Count, sample_size: int, seed: int) -> bool | None:
    """Return whether the rule stops where the approximate one would, None if it does not say."""
    smaller, larger = sample_size + 1, sample_size + 2
    x, y = _planted(smaller, larger, seed)
    if count(x, y, _BUDGET, _SURE) != larger:
        return None
    low, high = 0, _BUDGET
    while high - low > 1:
        middle = (low + high) // 2
        if count(x, y, middle, _SURE) == larger:
            high = middle
        else:
            low = middle
    if high < 16 or count(x, y, high - 1, _SURE) != smaller:
        return None
    if count(x, y, _BUDGET, _confidence(1.5 * high, sample_size)) != larger:
        return None
    return count(x, y, _BUDGET, _confidence(0.7 * high, sample_size)) == smaller


def _confidence(trials: float, sample_size: int) -> float:
    """Return the confidence at which the approximate rule asks for so many trials."""
    return -expm1(trials * log1p(-(((sample_size + 1) / _N_SAMPLES) ** sample_size)))


def _planted(smaller: int, larger: int, seed: int) -> tuple[Any, Any]:
    """Return points near a ring, moved a little; two groups of them by one affine map each."""
    import numpy as np

    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(_N_SAMPLES) + 0.4 * rng.random(_N_SAMPLES)) / _N_SAMPLES
    x = np.round(512 + 400 * np.column_stack([np.cos(angle), np.sin(angle)]))
    y = x + np.round(rng.uniform(-4, 4, x.shape) * 1024) / 1024
    order = rng.permutation(_N_SAMPLES)
    for group in (order[:smaller], order[smaller : smaller + larger]):
        linear = np.eye(2) + np.round(rng.uniform(-4, 4, (2, 2)) * 2) / 2048
        y[group] = x[group] @ linear.T + np.round(rng.uniform(-4, 4, 2) * 1024) / 1024
    return x.astype(np.float32), y.astype(np.float32)
