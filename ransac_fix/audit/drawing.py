"""How minimal samples are drawn, and how likely such a sample holds inliers only.

Measurements may fall into strata (the cameras of a rig, pairs of images), and a sampler may care:
it may take fixed numbers from each, or choose a stratum before it chooses a measurement.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from typing import Literal, TypeAlias

from ransac_fix.criterion import (
    Confidence,
    Stratum,
    all_inlier_probability,
    approximate_all_inlier_probability,
    required_trials,
    success_probability,
)

Way: TypeAlias = Literal["distinct", "replacement", "stratified", "weighted"]

Strata: TypeAlias = tuple[tuple[int, int], ...]
"""(inliers, measurements) of each stratum; a single pair where there are none."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """One law of a sampler.

    Parameters
    ----------
    drawn : str
        ``"distinct"`` and ``"replacement"`` draw from all measurements alike. ``"stratified"``
        draws fixed numbers of distinct measurements from each stratum. ``"weighted"`` draws
        without repetition by weights: the stratum first, each as likely as any other.
    sample_size : int
        k.
    quota : tuple of int, default ()
        ``"stratified"``: how many come from each stratum, in their order. ``"weighted"``: how
        many come from the first, the second, ... of different strata drawn at random; empty
        where every measurement has its stratum drawn anew, and both again on a repeat.
    """

    drawn: Way
    sample_size: int
    quota: tuple[int, ...] = ()

    def probability(self, strata: Strata) -> float:
        """Return the chance that one sample holds inliers only.

        Parameters
        ----------
        strata : tuple of (inliers, measurements)
            The problem.
        """
        n_inliers, n = totals(strata)
        if self.sample_size > n:
            return 0.0
        if self.drawn in ("distinct", "replacement"):
            return all_inlier_probability(n_inliers, n, self.sample_size, sampling=self.drawn)
        if self.quota:
            return self._mean_over_strata(strata, exact=True)
        return _one_by_one(self.sample_size, strata)

    def independent(self, strata: Strata) -> float:
        """Return what `probability` would be if no draw changed the next: the approximation.

        Parameters
        ----------
        strata : tuple of (inliers, measurements)
            The problem.
        """
        if self.quota:
            return self._mean_over_strata(strata, exact=False)
        if self.drawn == "weighted":
            filled = [inliers / n for inliers, n in strata if n]
            mean: float = math.fsum(filled) / len(filled)
            return float(mean**self.sample_size)
        n_inliers, n = totals(strata)
        return approximate_all_inlier_probability(n_inliers, n, self.sample_size)

    def required_trials(self, strata: Strata, confidence: Confidence) -> int | float:
        """Return the trials that the exact rule asks for; see `criterion.required_trials`."""
        n_inliers, n = totals(strata)
        if self.drawn == "weighted":
            return _trials(self.probability(strata), float(confidence))
        return required_trials(
            n_inliers,
            n,
            self.sample_size,
            confidence,
            sampling=self._sampling(strata),  # type: ignore[arg-type]
        )

    def success_probability(self, trials: int, strata: Strata) -> float:
        """Return the chance of at least one all-inlier sample in some trials."""
        n_inliers, n = totals(strata)
        if self.drawn == "weighted":
            probability = self.probability(strata)
            return 1.0 if probability >= 1 else -math.expm1(trials * math.log1p(-probability))
        return success_probability(
            trials,
            n_inliers,
            n,
            self.sample_size,
            sampling=self._sampling(strata),  # type: ignore[arg-type]
        )

    def describe(self) -> str:
        """Say how a sample is drawn, in a few words."""
        k = self.sample_size
        match self.drawn, self.quota:
            case "distinct", _:
                return f"{k} distinct indices"
            case "replacement", _:
                return f"{k} indices with replacement"
            case "stratified", quota:
                return " and ".join(
                    f"{size} of stratum {number}" for number, size in enumerate(quota, 1) if size
                )
            case _, (only,):
                return f"{only} of one stratum drawn at random"
            case _, (one, *others):
                more = "".join(f" and {size} of another" for size in others)
                return f"{one} of one stratum drawn at random{more}"
        return f"{k} times a stratum at random and then one of its measurements, without repeats"

    def formula(self, *, exact: bool) -> str:
        """Write P of `probability`, or of `independent`, in I, n and k of the strata."""
        k = self.sample_size
        match self.drawn, self.quota:
            case "distinct", _:
                return f"C(I,{k})/C(n,{k})" if exact else f"(I/n)^{k}"
            case "replacement", _:
                return f"falling(I,{k})/n^{k}" if exact else f"(I/n)^{k}"
            case "stratified", quota:
                named = [(str(number), size) for number, size in enumerate(quota, 1) if size]
                return _product(named, exact=exact)
            case _, ():
                return f"P({k} by strata)" if exact else f"mean_j(Ij/nj)^{k}"
        return f"mean({_product(list(zip('abcdefgh', self.quota, strict=False)), exact=exact)})"

    def _sampling(self, strata: Strata) -> object:
        if self.drawn != "stratified":
            return self.drawn
        return [Stratum(i, n, size) for (i, n), size in zip(strata, self.quota, strict=True)]

    def _mean_over_strata(self, strata: Strata, *, exact: bool) -> float:
        """Average the product over the strata that the quota may fall on."""
        if self.drawn == "stratified":
            if len(strata) != len(self.quota):
                return 0.0
            chosen = (
                [strata]
                if all(n >= k for (_, n), k in zip(strata, self.quota, strict=True))
                else []
            )
        else:
            chosen = [
                some
                for some in permutations(strata, len(self.quota))
                if all(n >= k for (_, n), k in zip(some, self.quota, strict=True))
            ]
        if not chosen:
            return 0.0
        return math.fsum(
            math.prod(
                math.comb(i, k) / math.comb(n, k) if exact else (i / n) ** k
                for (i, n), k in zip(some, self.quota, strict=True)
                if k
            )
            for some in chosen
        ) / len(chosen)


def drawings(sample_size: int, n_strata: int = 1) -> Iterator[Drawing]:
    """Yield the laws that are tried, the likelier first.

    Parameters
    ----------
    sample_size : int
        k.
    n_strata : int, default 1
        Strata of the measurements.
    """
    yield Drawing("distinct", sample_size)
    if sample_size > 1:
        yield Drawing("replacement", sample_size)
    if n_strata > 1:
        yield Drawing("weighted", sample_size)
        for quota in _compositions(sample_size, n_strata):
            yield Drawing("stratified", sample_size, quota)
        if sample_size > 1:
            for quota in _partitions(sample_size, n_strata):
                # The same from each of them is stratified.
                if len(quota) < n_strata or len(set(quota)) > 1:
                    yield Drawing("weighted", sample_size, quota)


def spread(n_inliers: int, n: int, n_strata: int) -> Strata:
    """Return strata that share inliers and measurements as evenly as can be."""
    return tuple(
        (
            (n_inliers + n_strata - 1 - number) // n_strata,
            (n + n_strata - 1 - number) // n_strata,
        )
        for number in range(n_strata)
    )


def totals(strata: Strata) -> tuple[int, int]:
    """Return the inliers and the measurements of all strata together."""
    return sum(inliers for inliers, _ in strata), sum(n for _, n in strata)


def _product(quota: list[tuple[str, int]], *, exact: bool) -> str:
    return " ".join(
        (f"C(I{name},{k})/C(n{name},{k})" if k > 1 else f"I{name}/n{name}")
        if exact
        else f"(I{name}/n{name})^{k}"
        for name, k in quota
    )


@lru_cache(maxsize=4096)
def _one_by_one(sample_size: int, strata: Strata) -> float:
    """Return P where each draw picks a stratum and then a measurement, again on a repeat.

    So the next draw picks a measurement not drawn yet with chances in proportion to its weight,
    1 / (number of strata x measurements of its stratum).
    """
    filled = [(i, n, 1 / n) for i, n in strata if n]
    # How many were drawn from each stratum, all of them inliers -> chance.
    states: dict[tuple[int, ...], float] = {(0,) * len(filled): 1.0}
    for _ in range(sample_size):
        following: dict[tuple[int, ...], float] = {}
        for drawn, chance in states.items():
            left = math.fsum((n - c) * w for (_, n, w), c in zip(filled, drawn, strict=True))
            for number, ((inliers, _, weight), count) in enumerate(zip(filled, drawn, strict=True)):
                if count < inliers:
                    after = (*drawn[:number], count + 1, *drawn[number + 1 :])
                    step = chance * (inliers - count) * weight / left
                    following[after] = following.get(after, 0.0) + step
        states = following
    return min(1.0, math.fsum(states.values()))


def _trials(probability: float, confidence: float) -> int | float:
    if confidence == 0:
        return 0
    if probability <= 0:
        return math.inf
    if probability >= 1:
        return 1
    if confidence >= 1:
        return math.inf
    return math.ceil(math.log1p(-confidence) / math.log1p(-probability))


def _compositions(total: int, parts: int) -> Iterator[tuple[int, ...]]:
    if parts == 1:
        yield (total,)
        return
    for first in range(total, -1, -1):
        for rest in _compositions(total - first, parts - 1):
            yield first, *rest


def _partitions(total: int, parts: int, largest: int | None = None) -> Iterator[tuple[int, ...]]:
    """Yield the ways to write a number as a sum of at most so many, in falling order."""
    if total == 0:
        yield ()
        return
    if parts == 0:
        return
    for first in range(min(total, largest or total), 0, -1):
        for rest in _partitions(total - first, parts - 1, first):
            yield first, *rest
