"""Which planted problems to ask for: small, fast, and telling the laws apart."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal


@dataclass(frozen=True, slots=True)
class Setting:
    """One size of planted problem.

    Parameters
    ----------
    n : int
        Measurements.
    group_size : int
        Size of an A group; B has one more.
    n_groups : int
        A groups.
    trials : int
        How many trials a run is expected to take.
    points : int
        How many points are wanted.
    """

    n: int
    group_size: int
    n_groups: int
    trials: int
    points: int = 3


# The inlier ratio must differ between the problems, or a factor passes for an exponent.
_LENGTHS = (2.0, 1.0, 0.5)
# Trials of a run that looks at the sampler.
_LONGEST_LOOK = 200


def settings(
    sample_size: int, typical_trials: float, *, spare: int = 1, fewest: int = 0
) -> tuple[Setting, ...]:
    """Return problems on which B comes after about `typical_trials` trials.

    Three sizes and ratios, so that no factor and shift can make one law look like another.

    Parameters
    ----------
    sample_size : int
        k.
    typical_trials : float
        How long a run may be.
    spare : int
        By how much the smallest group exceeds a sample.
    fewest : int
        Fewest measurements.
    """
    chosen = []
    for size, length in enumerate(_LENGTHS, sample_size + spare):
        larger = size + 1
        trials = length * typical_trials
        n = _rare_enough(larger, sample_size, trials, max(fewest, larger + size))
        chosen.append(Setting(n, size, max(1, min(3, (n - larger) // size)), round(trials)))
    chosen.append(_truncating(sample_size, typical_trials, larger=1, fewest=fewest))
    return tuple(chosen)


def counted_settings(
    sample_size: int, typical_trials: float, *, spare: int = 1, fewest: int = 0
) -> tuple[Setting, ...]:
    """Return problems for counted trials: one A, found after a third of `typical_trials`.

    The rule then asks for about `typical_trials` with u around 3.

    Parameters
    ----------
    sample_size : int
        k.
    typical_trials : float
        How long a run may be.
    spare, fewest : int
        As in `settings`.
    """
    chosen = []
    for size, length in enumerate(_LENGTHS, sample_size + spare):
        n = _rare_enough(size, sample_size, length * typical_trials / 3, max(fewest, size + 2))
        chosen.append(Setting(n, size, 1, round(length * typical_trials)))
    chosen.append(_truncating(sample_size, typical_trials / 3, larger=None, fewest=fewest))
    return tuple(chosen)


@lru_cache
def _truncating(sample_size: int, trials: float, *, larger: int | None, fewest: int) -> Setting:
    """Return a problem on which I / n * n, truncated, is I - 1: some programs compute I so."""
    best: tuple[float, Setting] | None = None
    for n in range(max(fewest, sample_size + 3), 130):
        for size in range(sample_size + 2, n):
            # A group of one more must fit beside, where one is planted.
            if int(size / n * n) == size or (larger is not None and 2 * size + larger > n):
                continue
            sought = size + (larger or 0)
            distance = abs(math.log(trials * _chance(sought, n, sample_size)))
            if best is None or distance < best[0]:
                length = max(1, round(1 / _chance(sought, n, sample_size)))
                expected = length if larger is not None else 3 * length
                best = distance, Setting(n, size, 1, expected, points=1)
    assert best is not None
    return best[1]


def _rare_enough(size: int, sample_size: int, trials: float, fewest: int) -> int:
    """Return the n at which a group of this size is hit once in so many trials."""
    return min(
        range(fewest, 500),
        key=lambda n: abs(math.log(trials * _chance(size, n, sample_size))),
    )


@dataclass(frozen=True, slots=True)
class Case:
    """One run that looks at the sampler.

    Parameters
    ----------
    n, size : int
        Measurements, and how many of them the planted group holds.
    trials : int
        Trials the run has.
    first : str
        Whether the group or the clutter comes first in the order of the measurements.
    """

    n: int
    size: int
    trials: int
    first: Literal["anything", "groups", "clutter"] = "anything"


def hit_cases(
    sample_size: int, seeded: bool, runs: int, *, spare: int = 1, fewest: int = 0
) -> list[Case]:
    """Return the runs that look at the sampler.

    Drawing k of k + 1 with replacement often repeats an index, which tells the two ways of
    drawing apart at once; a small group among more clutter tells k, and the order of the two
    whether all measurements are drawn alike. Where the generator is fixed, every n shows only a
    few samples, the same in every run, so many n are used, and only their order is random.

    Parameters
    ----------
    sample_size : int
        k.
    seeded : bool
        Whether the seed changes the samples.
    runs : int
        How many.
    spare, fewest : int
        As in `settings`.
    """
    k, size = sample_size, sample_size + spare
    least = max(fewest, size)
    if seeded:
        n = max(fewest, size + 3)
        trials = _even_trials(size, n, k)
        cycle = [
            Case(n, size, trials, "groups"),
            Case(least, least, 1),
            Case(n, size, trials, "clutter"),
            # Here few samples repeat an index: were as many missed, a check would be the reason.
            Case(8 * size, 8 * size, 1),
        ]
        return [cycle[index % len(cycle)] for index in range(runs)]
    # With all measurements in the group only a repeated index misses it. One sample an n.
    once = [Case(n, n, 1) for n in range(least, least + 40)]
    cycle = [
        Case(n, size, _even_trials(size, n, k))
        for n in range(least + 1, least + 10)
        for size in range(k + spare, n)
        if _even_trials(size, n, k) <= _LONGEST_LOOK
    ]
    return (once + [cycle[index % len(cycle)] for index in range(runs)])[:runs]


def _even_trials(n_inliers: int, n: int, sample_size: int) -> int:
    """Return the number of trials after which a group has been hit about every second time."""
    return max(1, round(0.7 / _chance(n_inliers, n, sample_size)))


def _chance(n_inliers: int, n: int, sample_size: int) -> float:
    return math.comb(n_inliers, sample_size) / math.comb(n, sample_size)
