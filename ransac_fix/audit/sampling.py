"""The law of a sampler, from how often a planted group is hit within a few trials."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ransac_fix.audit.drawing import Drawing, Strata, drawings
from ransac_fix.audit.model import Drawn, SamplerLaw
from ransac_fix.audit.plan import Case

# Chance of naming the wrong one of two laws.
ERROR_RATE = 1e-6
# The same where all runs that tell more are spent: on a fixed generator every n shows one sample.
LAST_ERROR_RATE = 0.01
# Twice the log-likelihood below its maximum: chi-squared with one degree of freedom.
_INTERVAL_99 = 6.635
# Standard deviations that no law may be off in any kind of run: one in 10^6 for a few kinds,
# with room for runs on one fixed generator, which are not quite independent.
_IMPOSSIBLE = 6.0
# Those at which more runs decide whether it is off: one in a thousand where it is not.
_DOUBTFUL = 3.5
# Share of the samples in a group from which it must be found to speak of a law of all of them.
LEAST_FOUND = 0.25
# For this k that is all but the same as draws with replacement: n^3 against (n + 1) n (n - 1).
_ALIKE_BEYOND = 3
# It can pass for a share found below this, too.
_RARER = 0.75
_BEYOND = (
    "groups are hit as seldom as if there were one measurement more, so it draws an index beyond "
    "the data"
)


Chances: TypeAlias = NDArray[np.float64]


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


def decide(
    hits: Sequence[Hit],
    sample_size: int,
    verifying: int = 0,
    n_strata: int = 1,
    *,
    seeded: bool = True,
    size_seen: bool = False,
    last: bool = False,
) -> SamplerLaw:
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
    n_strata : int, optional
        Strata of the measurements; with more than one, laws that depend on them are tried too.
    seeded : bool, optional
        Whether runs are independent. On a fixed generator those of one trial on one n all look
        at the same sample.
    size_seen : bool, optional
        Whether every sample was seen to have `sample_size` measurements, so that no other size is
        tried.
    last : bool, optional
        Whether nothing more can be learnt, so that less evidence must do.

    Returns
    -------
    SamplerLaw
        ``drawn`` is ``"undecided"`` while two laws are too close or the likeliest is in doubt, or
        where the group is found from so few of the samples in it that the law might be an
        accident; ``"not uniform"`` where all of those known are impossible, or an index beyond the
        data is drawn.
    """
    tally = _Tally([hit.case for hit in hits], hits, seeded)
    best, rival = tally.ranked(sample_size, verifying, n_strata, size_seen)
    decided: Drawn = best.drawing.drawn
    error = 0.0 if rival is None else math.exp(rival.likelihood - best.likelihood)
    deviation, strayed = tally.deviation(best, verifying)
    too_close = error > (LAST_ERROR_RATE if last else ERROR_RATE)
    # On a fixed generator more runs would look at the same samples.
    doubtful = deviation > _DOUBTFUL and seeded and not last
    if deviation > _IMPOSSIBLE:
        decided = "not uniform"
    elif too_close or doubtful or best.found < LEAST_FOUND:
        decided = "undecided"
    elif best.beyond:
        decided, strayed = "not uniform", _BEYOND
    drawing = best.drawing
    by_strata = drawing.drawn in ("stratified", "weighted")
    reference = drawing if by_strata else Drawing("distinct", drawing.sample_size)
    low, high = tally.interval(reference)
    return SamplerLaw(
        drawn=decided,
        # The size that fits best says nothing where no law fits.
        sample_size=sample_size if decided == "not uniform" else drawing.sample_size,
        hits=sum(hit.hit for hit in hits),
        expected=round(tally.expected(best), 2),
        runs=len(hits),
        interval=(round(low, 3), round(high, 3)),
        found=best.found,
        quota=drawing.quota,
        error=float(f"{error:.2g}"),
        strayed=strayed if decided == "not uniform" else "",
    )


def most_telling(
    hits: Sequence[Hit],
    pool: Sequence[Case],
    sample_size: int,
    count: int,
    *,
    verifying: int = 0,
    n_strata: int = 1,
    seeded: bool = True,
    size_seen: bool = False,
) -> list[Case]:
    """Return the runs that tell the likeliest law from the next likeliest soonest.

    Parameters
    ----------
    hits : sequence of Hit
        What was seen so far.
    pool : sequence of Case
        The kinds of run to choose from.
    sample_size, verifying, n_strata, seeded, size_seen
        As in `decide`.
    count : int
        How many runs.

    Returns
    -------
    list of Case
        Fewer than `count`, or none, where no more can be learnt.
    """
    so_far = _Tally([hit.case for hit in hits], hits, seeded)
    best, rival = so_far.ranked(sample_size, verifying, n_strata, size_seen)
    assert rival is not None
    if not seeded:
        ways = {best.drawing.drawn, rival.drawing.drawn}
        sizes = {best.drawing.sample_size, rival.drawing.sample_size}
        # Whether the one sample at an n repeats an index shows where nothing else is planted; how
        # large it is, where something is.
        pool = [
            case
            for case in pool
            if (len(ways) > 1 and case.size == case.n)
            or (len(sizes) > 1 and case.trials > 1)
            or (len(ways) == 1 and case.size < case.n)
        ]
    tally = _Tally(pool, (), seeded)
    ours, theirs = (
        tally.probabilities(law.found * law.chances(pool, verifying)) for law in (best, rival)
    )
    # The mean of the two relative entropies: what one run tells, whichever law is true.
    told = (ours - theirs) * (np.log(ours / theirs) - np.log((1 - ours) / (1 - theirs))) / 2
    told /= _OVERHEAD + tally.trials
    seen = Counter(hit.case for hit in hits)
    found = {hit.case for hit in hits if hit.hit}
    chosen: list[Case] = []
    for index in np.argsort(-told):
        case = pool[index]
        turns = 1 + count // _KINDS
        if not seeded and case.size == case.n:
            # Seen not to repeat an index, or missed so often that it does.
            turns = int(case not in found and seen[case] < _TURNS)
        elif not seeded and case.trials > 1:
            turns = _TURNS - seen[case]
        chosen += [case] * turns
        if len(chosen) >= count:
            break
    return chosen[:count]


def accepted(hits: Sequence[Hit], law: SamplerLaw) -> tuple[float, float]:
    """Return the share of samples that a filter accepts, as a 99 % interval.

    Samples drawn again without counting a trial make the others more frequent by its inverse.

    Parameters
    ----------
    hits : sequence of Hit
        Runs on measurements that a filter may reject.
    law : SamplerLaw
        The law of the draws, from measurements that it passes.
    """
    tally = _Tally([hit.case for hit in hits], hits, seeded=True)
    low, high = tally.interval(drawing_of(law))
    return round(min(1.0, law.found / high), 3), round(min(1.0, law.found / low), 3)


def drawing_of(law: SamplerLaw) -> Drawing:
    """Return the law of a sampler that was measured; distinct draws where none was decided."""
    if law.drawn == "not uniform" or law.drawn == "undecided":
        return Drawing("distinct", law.sample_size)
    return Drawing(law.drawn, law.sample_size, law.quota)


# A group may be missed for other reasons than the draw, so nothing is quite impossible.
_SURPRISE = 1e-4
# The share of samples in the group from which it may be found.
_FOUND = np.array([1.0, 0.97, 0.94, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.03, 0.01])
# A library that finds it from all of them is e^3 times as likely beforehand.
_RARELY = 3.0
_FACTORS = np.exp(np.arange(-250, 151) / 50)
# How many of the samples that hold the group but for its verifying part find it.
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
# A run costs as much as so many trials, besides its own.
_OVERHEAD = 5
# Kinds of run chosen at a time, and how often one is repeated on a fixed generator.
_KINDS = 5
_TURNS = 6


@dataclass(frozen=True, slots=True)
class _Law:
    """A law with the shares that fit best, and its log-likelihood.

    `beyond` is how many indices there are beyond the data.
    """

    likelihood: float
    drawing: Drawing
    verified: float
    found: float
    beyond: int = 0

    def chances(self, cases: Sequence[Case], verifying: int) -> Chances:
        """Return the chance that one trial solves for the group, case by case."""
        all_in = _chances(self.drawing, cases, self.beyond)
        if not verifying:
            return all_in
        solved = _chances(_without(self.drawing, verifying), cases)
        return (1 - self.verified) * all_in + self.verified * solved


def _chances(drawing: Drawing, cases: Sequence[Case], beyond: int = 0) -> Chances:
    return np.array(
        [drawing.probability(case.strata or ((case.size, case.n + beyond),)) for case in cases]
    )


def _without(drawing: Drawing, verifying: int) -> Drawing:
    """Return the law of a sample without its last measurements, which only verify."""
    kept = drawing.sample_size - verifying
    quota: list[int] = []
    for size in drawing.quota:
        quota.append(min(size, kept - sum(quota)))
    if drawing.drawn == "weighted":
        quota = [size for size in quota if size]
    return Drawing(drawing.drawn, kept, tuple(quota))


class _Tally:
    """Runs grouped by their case, so that a law is evaluated once a case."""

    def __init__(self, cases: Sequence[Case], hits: Sequence[Hit], seeded: bool) -> None:
        self.cases = list(dict.fromkeys(cases)) if hits else list(cases)
        self._seeded = seeded
        found = Counter(hit.case for hit in hits if hit.hit)
        runs = Counter(hit.case for hit in hits)
        self.trials = np.array([case.trials for case in self.cases])
        self._hits = np.array([found[case] for case in self.cases], dtype=float)
        self._misses = np.array([runs[case] - found[case] for case in self.cases], dtype=float)
        # On a fixed generator: the runs of one trial, by their n.
        self._one_sample: dict[int, list[int]] = {}
        if not seeded:
            for index, case in enumerate(self.cases):
                if case.trials == 1:
                    self._one_sample.setdefault(case.n, []).append(index)

    def probabilities(self, chances: Chances) -> Chances:
        """Return the chances of a hit in a run, from those in a trial; none is 0 or 1."""
        within = -np.expm1(self.trials * np.log1p(-np.minimum(chances, 1 - 1e-12)))
        return np.asarray(np.clip(within, _SURPRISE, 1 - _SURPRISE))

    def ranked(
        self, sample_size: int, verifying: int, n_strata: int, size_seen: bool
    ) -> tuple[_Law, _Law | None]:
        """Return the likeliest law, and the likeliest that is another."""
        reach = 0 if verifying or size_seen else 3 if n_strata == 1 else 1
        laws = []
        for size in range(max(1, sample_size - reach), sample_size + reach + 1):
            for drawing in drawings(size, n_strata):
                all_in = _chances(drawing, self.cases)
                if not verifying:
                    laws.append(self._likeliest(drawing, 0.0, all_in))
                    continue
                solved = _chances(_without(drawing, verifying), self.cases)
                laws += [
                    self._likeliest(drawing, share, (1 - share) * all_in + share * solved)
                    for share in _SHARES
                ]
        laws.sort(key=lambda law: -law.likelihood)
        best = laws[0]
        rarer = best.drawing.drawn == "replacement" or best.found < _RARER
        if rarer and self._seeded and n_strata == 1 and not verifying:
            # An index beyond the data makes a sample as useless as one that comes twice.
            for size in {sample_size, best.drawing.sample_size} - {_ALIKE_BEYOND}:
                drawing = Drawing("distinct", size)
                chances = _chances(drawing, self.cases, 1)
                laws.append(self._likeliest(drawing, 0.0, chances, 1))
            laws.sort(key=lambda law: -law.likelihood)
            best = laws[0]
        known = best.drawing, best.beyond
        return best, next((law for law in laws if (law.drawing, law.beyond) != known), None)

    def _likeliest(
        self, drawing: Drawing, verified: float, chances: Chances, beyond: int = 0
    ) -> _Law:
        values = self._log_likelihoods(drawing, chances, _FOUND) - _RARELY * (_FOUND < 1)
        most = int(np.argmax(values))
        return _Law(float(values[most]), drawing, verified, float(_FOUND[most]), beyond)

    def _log_likelihoods(self, drawing: Drawing, chances: Chances, factors: Chances) -> Chances:
        """Return the log-likelihood of what was seen, every chance times each factor."""
        p = self.probabilities(factors[:, None] * chances)
        seen = np.log(p) * self._hits + np.log1p(-p) * self._misses
        if drawing.drawn != "replacement" or not self._one_sample:
            return np.asarray(seen.sum(axis=1))
        shared = [index for indices in self._one_sample.values() for index in indices]
        total = seen.sum(axis=1) - seen[:, shared].sum(axis=1)
        for n, indices in self._one_sample.items():
            # Either the one sample repeats an index, and no run hits, or it does not, and each
            # run hits as often as with distinct indices.
            proper = drawing.probability(((n, n),))
            proper = min(max(proper, _SURPRISE), 1 - _SURPRISE)
            p = factors[:, None] * chances[indices] / proper
            p = np.clip(p, _SURPRISE, 1 - _SURPRISE)
            hits, misses = self._hits[indices], self._misses[indices]
            kept = np.log(p) @ hits + np.log1p(-p) @ misses
            useless = math.log(_SURPRISE) * hits.sum() + math.log1p(-_SURPRISE) * misses.sum()
            total += np.logaddexp(math.log(proper) + kept, math.log1p(-proper) + useless)
        return np.asarray(total)

    def expected(self, law: _Law) -> float:
        """Return how many runs should hit if every sample in the group found it."""
        chances = _chances(law.drawing, self.cases, law.beyond)
        runs = self._hits + self._misses
        return float(runs @ -np.expm1(self.trials * np.log1p(-np.minimum(chances, 1 - 1e-12))))

    def deviation(self, law: _Law, verifying: int) -> tuple[float, str]:
        """Return how many standard deviations the hits are off in the kind of run most so.

        And what was seen there, in words.

        The kinds are: everything in the group, the group first, the clutter first, any order; and
        each split over strata.
        """
        p = self.probabilities(law.found * law.chances(self.cases, verifying))
        kinds: dict[tuple[bool, str, Strata], list[float]] = {}
        for case, hits, misses, chance in zip(self.cases, self._hits, self._misses, p, strict=True):
            if case.n in self._one_sample and case.trials == 1 and case.size < case.n:
                # These runs look at one sample, so they stray together.
                continue
            kind = kinds.setdefault((case.n == case.size, case.first, case.strata), [0.0] * 4)
            runs = hits + misses
            seen = hits, runs, runs * chance, runs * chance * (1 - chance)
            kind[:] = (a + b for a, b in zip(kind, seen, strict=True))
        # At least one run's worth of doubt: a single surprise among certainties proves nothing.
        off = {
            kind: abs(hits - expected) / math.sqrt(max(1.0, variance))
            for kind, (hits, _, expected, variance) in kinds.items()
        }
        most = max(off, key=lambda kind: off[kind])
        hits, runs, expected, _ = kinds[most]
        where = {"groups": " that came first", "clutter": " that came last"}.get(most[1], "")
        return off[most], (
            f"a group{where} was hit in {hits:.0f} of {runs:.0f} runs where {expected:.1f} "
            "are expected"
        )

    def interval(self, drawing: Drawing) -> tuple[float, float]:
        """Return the 99 % interval of the one factor on all chances of a law."""
        values = self._log_likelihoods(drawing, _chances(drawing, self.cases), _FACTORS)
        inside = _FACTORS[2 * (values.max() - values) <= _INTERVAL_99]
        return float(inside[0]), float(inside[-1])
