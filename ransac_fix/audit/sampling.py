"""The law of a sampler, from how often a planted group is hit within a few trials."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ransac_fix.audit.model import Drawn, SamplerLaw
from ransac_fix.audit.plan import Case
from ransac_fix.criterion import all_inlier_probability

# Chance of naming the wrong one of two laws.
ERROR_RATE = 1e-6
_DECIDED = -math.log(ERROR_RATE)
# Twice the log-likelihood below its maximum: chi-squared with one degree of freedom.
_INTERVAL_99 = 6.635
# Standard deviations that no law may be off in any kind of run: one in 10^6 for a few kinds,
# with room for runs on one fixed generator, which are not quite independent.
_IMPOSSIBLE = 6.0


@dataclass(frozen=True, slots=True)
class Hit:
    """One run of a few trials on a planted group.

    Parameters
    ----------
    case : Case
        The run.
    hit : bool
        Whether it found the group.
    """

    case: Case
    hit: bool


def decide(hits: Sequence[Hit], sample_size: int, verifying: int = 0) -> SamplerLaw:
    """Decide how samples are drawn, if the runs suffice.

    A library may fail to find the group from a sample that lies in it (a check that counts as a
    trial, a solver that loses its way), so every law has a factor on its chances that is fitted.

    Parameters
    ----------
    hits : sequence of Hit
        Runs on independent streams.
    sample_size : int
        k as documented; others are tried too.
    verifying : int, optional
        How many of a sample only choose among the models that the others give: a group can be
        found from a sample that holds it but for these. k is then taken as documented.

    Returns
    -------
    SamplerLaw
        ``drawn`` is ``"undecided"`` while two laws are too close, and ``"not uniform"`` where
        all of those known are impossible.
    """
    tally = _Tally(hits)
    sizes = [sample_size]
    if not verifying:
        sizes = list(range(max(1, sample_size - 3), sample_size + 4))
    laws = [
        (*tally.likeliest(chances), drawn, size, chances)
        for size in sizes
        for drawn in (_LAWS if size > 1 else _LAWS[:1])
        for chances in tally.possible(drawn, size, verifying)
    ]
    laws.sort(key=lambda law: -law[0])
    best, factor, drawn, size, chances = laws[0]
    rival = next((law for law in laws if law[2:4] != (drawn, size)), None)
    decided: Drawn = drawn
    if tally.deviation(chances, factor) > _IMPOSSIBLE:
        decided = "not uniform"
    elif rival is not None and best - rival[0] < _DECIDED:
        decided = "undecided"
    low, high = tally.interval(tally.chances("distinct", size))
    return SamplerLaw(
        drawn=decided,
        sample_size=size,
        hits=sum(hit.hit for hit in hits),
        expected=round(tally.expected(chances), 2),
        runs=len(hits),
        interval=(round(low, 3), round(high, 3)),
        found=factor,
    )


_LAWS: tuple[Literal["distinct", "replacement"], ...] = ("distinct", "replacement")
# A group may be missed for other reasons than the draw, so nothing is quite impossible.
_SURPRISE = 1e-4
# The share of samples in the group from which it may be found.
_FOUND = (1.0, 0.97, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3)
# A library that finds it from all of them is e^3 times as likely beforehand.
_RARELY = 3.0
_FACTORS = tuple(math.exp(step / 50) for step in range(-250, 151))


class _Tally:
    """Runs grouped by their case, so that a law is evaluated once a case."""

    def __init__(self, hits: Sequence[Hit]) -> None:
        cases = Counter(hit.case for hit in hits)
        found = Counter(hit.case for hit in hits if hit.hit)
        self._cases = [(case, found[case], total - found[case]) for case, total in cases.items()]

    def chances(self, drawn: Literal["distinct", "replacement"], sample_size: int) -> list[float]:
        """Return the chance that one trial hits, case by case."""
        return [
            all_inlier_probability(case.size, case.n, sample_size, sampling=drawn)
            if sample_size <= case.n
            else 0.0
            for case, _, _ in self._cases
        ]

    def possible(
        self, drawn: Literal["distinct", "replacement"], sample_size: int, verifying: int
    ) -> list[list[float]]:
        """Return the chances of a law; several where some of a sample only verify."""
        all_in = self.chances(drawn, sample_size)
        if not verifying:
            return [all_in]
        solved = self.chances(drawn, sample_size - verifying)
        return [
            [(1 - share) * a + share * b for a, b in zip(all_in, solved, strict=True)]
            for share in (0.0, 0.25, 0.5, 0.75, 1.0)
        ]

    def likeliest(self, chances: Sequence[float]) -> tuple[float, float]:
        """Return the log-likelihood with the best share of samples found, and that share."""
        return max(
            (self.log_likelihood(chances, share) - _RARELY * (share < 1), share) for share in _FOUND
        )

    def expected(self, chances: Sequence[float]) -> float:
        """Return how many runs should hit."""
        return sum(
            (found + missed) * _within(chance, case.trials)
            for (case, found, missed), chance in zip(self._cases, chances, strict=True)
        )

    def log_likelihood(self, chances: Sequence[float], factor: float = 1.0) -> float:
        """Return the log-likelihood of what was seen, every chance times a factor."""
        total = 0.0
        for (case, found, missed), chance in zip(self._cases, chances, strict=True):
            probability = _within(min(1.0, factor * chance), case.trials)
            probability = min(max(probability, _SURPRISE), 1 - _SURPRISE)
            total += found * math.log(probability) + missed * math.log1p(-probability)
        return total

    def deviation(self, chances: Sequence[float], factor: float) -> float:
        """Return how many standard deviations the hits are off, in the kind of run most so.

        The kinds are: everything in the group, the group first, the clutter first, any order.
        """
        kinds: dict[tuple[bool, str], list[float]] = {}
        for (case, found, missed), chance in zip(self._cases, chances, strict=True):
            probability = _within(min(1.0, factor * chance), case.trials)
            probability = min(max(probability, _SURPRISE), 1 - _SURPRISE)
            runs = found + missed
            kind = kinds.setdefault((case.n == case.size, case.first), [0.0, 0.0])
            kind[0] += found - runs * probability
            kind[1] += runs * probability * (1 - probability)
        # At least one run's worth of doubt: a single surprise among certainties proves nothing.
        return max(abs(off) / math.sqrt(max(1.0, variance)) for off, variance in kinds.values())

    def interval(self, chances: Sequence[float]) -> tuple[float, float]:
        """Return the 99 % interval of the one factor on all chances."""
        values = [self.log_likelihood(chances, factor) for factor in _FACTORS]
        best = max(values)
        inside = [
            f for f, v in zip(_FACTORS, values, strict=True) if 2 * (best - v) <= _INTERVAL_99
        ]
        return inside[0], inside[-1]


def _within(probability: float, trials: int) -> float:
    """Return the chance of at least one hit in some trials."""
    return 1.0 if probability >= 1 else -math.expm1(trials * math.log1p(-probability))
