"""Which planted problems to ask for: small, fast, and telling the laws apart."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from ransac_fix.audit.drawing import Drawing, Strata


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
    strata : tuple of (n, A, B)
        How many of all measurements, of each A and of B each stratum holds; empty for one.
    """

    n: int
    group_size: int
    n_groups: int
    trials: int
    points: int = 2
    strata: tuple[tuple[int, int, int], ...] = ()


# The inlier ratio must differ between the problems, or a factor passes for an exponent.
_LENGTHS = (2.0, 1.0, 0.5)
# Trials of a run that looks at the sampler, such runs of each order of the measurements, values of
# n to draw one sample each from for k up to 2 and above, values of n else, and samples that are
# many.
_LONGEST_LOOK = 200
_EACH_ORDER = 16
_MOST_WHOLE = (400, 90)
_SIZES = 10
_MANY_SAMPLES = 20


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


# Measurements of the strata, one to the other, from problem to problem: laws that pool the strata
# and laws that do not then differ by another factor on each.
_SKEWS = ((1, 2, 1), (2, 1, 2), (1, 1, 1))
_MOST_OF_A_STRATUM = 40
_APART = 1.5


def strata_settings(
    drawing: Drawing, n_strata: int, typical_trials: float, *, spare: int, counted: bool
) -> tuple[Setting, ...]:
    """Return problems whose groups are split over strata in several ways.

    Parameters
    ----------
    drawing : Drawing
        How samples are drawn, measured before: a group must hold such samples.
    n_strata : int
        Strata.
    typical_trials : float
        How long a run may be.
    spare : int
        By how much the smallest group exceeds a sample.
    counted : bool
        Whether trials are counted: then there is one A and no B, see `counted_settings`.
    """
    chosen: list[Setting] = []
    used: set[tuple[int, ...]] = set()
    first = drawing.sample_size + spare
    for index, (size, length) in enumerate(
        zip((first, first + 1, first + 2, first), (*_LENGTHS, 1.0), strict=True)
    ):
        trials = typical_trials * length / (3 if counted else 1)
        skew = [_SKEWS[index % len(_SKEWS)][number % 3] for number in range(n_strata)]
        best: tuple[float, tuple[tuple[int, int, int], ...]] | None = None
        for split in _splits(size, n_strata):
            # The one more of B goes where A has the most.
            most = split.index(max(split))
            larger = [part + (number == most) for number, part in enumerate(split)]
            for scale in range(1, _MOST_OF_A_STRATUM):
                parts = tuple(
                    (max(drawing.sample_size, a if counted else a + b, scale * weight), a, b)
                    for a, b, weight in zip(split, larger, skew, strict=True)
                )
                probability = drawing.probability(
                    tuple((a if counted else b, n) for n, a, b in parts)
                )
                if not 0 < probability < 1:
                    continue
                shares = [a / n for n, a, _ in parts]
                # Laws that pool the strata are others only where the shares of inliers differ.
                alike = max(shares) < _APART * min(shares)
                off = abs(math.log(trials * probability)) + (split in used) + alike
                if best is None or off < best[0]:
                    best = off, parts
        if best is None:
            continue
        used.add(tuple(a for _, a, _ in best[1]))
        n = sum(part[0] for part in best[1])
        chosen.append(Setting(n, size, 1, round(length * typical_trials), 2, best[1]))
    return tuple(chosen)


def _splits(total: int, parts: int) -> list[tuple[int, ...]]:
    """Return the ways to split a number into so many parts of at least 1."""
    if parts == 1:
        return [(total,)] if total else []
    return [
        (first, *rest) for first in range(1, total) for rest in _splits(total - first, parts - 1)
    ]


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
    strata : tuple of (size, n)
        How much of the group and of all measurements each stratum holds; empty for one.
    """

    n: int
    size: int
    trials: int
    first: Literal["anything", "groups", "clutter"] = "anything"
    strata: Strata = ()


def first_cases(
    sample_size: int, seeded: bool, *, spare: int = 1, fewest: int = 0, n_strata: int = 1
) -> list[Case]:
    """Return the runs that look at the sampler first, of each kind some.

    A group that comes first is given so few trials that uniform draws seldom find it, one that
    comes last so many that they mostly do: a sampler that prefers the first measurements shows
    at once. Where nothing but the group is there, only a repeated index misses it. With strata
    the group is split over them in every way.

    Parameters
    ----------
    sample_size : int
        k.
    seeded : bool
        Whether the seed changes the samples. Otherwise the generator is fixed: every n shows
        only a few samples, the same in every run, so many n are used.
    spare, fewest : int
        As in `settings`.
    n_strata : int
        Strata.
    """
    if n_strata > 1:
        return _strata_cases(sample_size, n_strata, spare, (1.0,))
    size = sample_size + spare
    least = max(fewest, size)
    cases = []
    for step in range(_EACH_ORDER):
        n = max(fewest, size + 3)
        if not seeded:
            n, size = n + step, sample_size + spare + step % 4
        even = _even_trials(size, n, sample_size)
        seldom, mostly = (min(_LONGEST_LOOK, max(1, round(x * even))) for x in (0.3, 2.3))
        cases += [Case(n, size, seldom, "groups"), Case(n, size, mostly, "clutter")]
        if step % 2:
            whole = least if seeded else least + step // 2
            cases.append(Case(whole, whole, 1))
    return cases


def case_pool(
    sample_size: int, seeded: bool, *, spare: int = 1, fewest: int = 0, n_strata: int = 1
) -> list[Case]:
    """Return the kinds of run from which those are chosen that tell two laws apart soonest.

    On a fixed generator the samples at one n are the same in all runs. Runs of one trial all look
    at one sample, which can be reckoned with, and those of many trials at so many that it does
    not matter; runs of a few are not used there.

    Parameters
    ----------
    sample_size, seeded, spare, fewest, n_strata
        As in `first_cases`.
    """
    lengths = (0.3, 1.0, 2.0)
    if n_strata > 1:
        return _strata_cases(sample_size, n_strata, spare, lengths)
    k = sample_size
    least = max(fewest, k + spare)
    if not seeded:
        # Small samples rarely repeat an index.
        most = _MOST_WHOLE[k > 2]
        cases = [Case(n, n, 1) for n in range(least, least + most)]
        for n in range(least + 1, least + _SIZES):
            for size in range(k + spare, n):
                even = _even_trials(size, n, k)
                several = [1, *(t for t in (even, 2 * even) if _MANY_SAMPLES <= t <= _LONGEST_LOOK)]
                cases += [Case(n, size, trials) for trials in several]
        return cases
    # Among many measurements few samples repeat an index: were as many missed, a check would be
    # the reason.
    cases = [Case(n, n, 1) for n in (least, 2 * least, 8 * least)]
    for n in range(least + 1, least + _SIZES):
        for size in range(k + spare, n):
            even = _even_trials(size, n, k)
            several = sorted({max(1, round(length * even)) for length in lengths})
            cases += [Case(n, size, trials) for trials in several if trials <= _LONGEST_LOOK]
    return cases


def filter_cases(sample_size: int, runs: int, *, spare: int = 1, fewest: int = 0) -> list[Case]:
    """Return runs that show by how much a filter makes hits more frequent.

    Parameters
    ----------
    sample_size, spare, fewest
        As in `first_cases`.
    runs : int
        How many.
    """
    size = sample_size + spare
    least = max(fewest, 2 * size)
    cases = []
    for step in range(runs):
        n = least + step % _SIZES
        even = _even_trials(size, n, sample_size)
        # A filter may make them hit several times as often.
        cases.append(Case(n, size, min(_LONGEST_LOOK, max(1, even // 2))))
    return cases


def _strata_cases(
    sample_size: int, n_strata: int, spare: int, lengths: tuple[float, ...]
) -> list[Case]:
    """Return runs on a group split over strata, with more clutter in one stratum than another.

    Every stratum could provide a whole sample, so that each way of drawing has what it needs.
    """
    k = sample_size
    # Nothing but the group: a sample that misses it repeats an index.
    cases = [Case(k * n_strata, k * n_strata, 1, strata=((k, k),) * n_strata)]
    for extra in (spare, spare + 1):
        for split in _splits(k + extra, n_strata):
            for turn in range(n_strata):
                strata = tuple(
                    (part, max(k, part + 1) + 3 * ((number + turn) % n_strata))
                    for number, part in enumerate(split)
                )
                n = sum(total for _, total in strata)
                even = _even_trials(k + extra, n, k)
                several = sorted({min(_LONGEST_LOOK, max(1, round(x * even))) for x in lengths})
                cases += [Case(n, k + extra, trials, strata=strata) for trials in several]
    return cases


def _even_trials(n_inliers: int, n: int, sample_size: int) -> int:
    """Return the number of trials after which a group has been hit about every second time."""
    return max(1, round(0.7 / _chance(n_inliers, n, sample_size)))


def _chance(n_inliers: int, n: int, sample_size: int) -> float:
    return math.comb(n_inliers, sample_size) / math.comb(n, sample_size)
