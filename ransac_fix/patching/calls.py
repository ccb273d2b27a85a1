"""Recorded RANSAC calls: what each amounts to, and their sums for each call site.

What is kept does not grow with the number of calls: counts, ranges, and a histogram on a
logarithmic scale from which medians are read with an error of one percent.
"""

import math
import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from ransac_fix.criterion import (
    all_inlier_probability,
    approximate_required_trials,
    required_trials,
)

if TYPE_CHECKING:
    from ransac_fix.patching.watching import Facts, Sampling

__all__ = [
    "Bound",
    "Judged",
    "Key",
    "Raw",
    "Record",
    "Spread",
    "Tally",
    "Worst",
    "described",
    "is_telling",
    "judge",
    "packed",
    "unpacked",
]

Bound: TypeAlias = Literal["rule", "cap", "floor"]
Key: TypeAlias = tuple[str, str, str, int, str]
"""System, function, and the call site: file, line, and the name of the calling function."""
Raw: TypeAlias = tuple["Facts | None", float, bool, bool, float]
"""What is kept of a call when it has been made: the arguments of `watching.note`, seconds, whether
it was patched, whether it raised, and the slack."""

# Rules round, and test before or after a trial.
_OFFSET = 2
_BASE = math.log(1.02)
_INFINITE = 1 << 20


class Judged(NamedTuple):  # quicker to make than a frozen dataclass
    """What a run amounts to.

    Attributes
    ----------
    n_inliers, trials
        As they count: a model has at least `sample_size` inliers, and an exact library has run
        what the exact rule asks for.
    needed : float
        `ransac_fix.required_trials`.
    success : float
        The probability that `trials` samples contain one of inliers only.
    bound : "rule", "cap" or "floor"
        What ended the run. cap: the limit on trials. floor: more trials than the exact and the
        approximate rule ask for, by a minimum, a multiplier, or a best model that came late.
    """

    n_inliers: int
    trials: float
    needed: float
    success: float
    bound: Bound


@lru_cache(maxsize=8192)
def judge(
    n_inliers: int,
    n_samples: int,
    sample_size: int,
    confidence: float,
    trials: float | None,
    max_trials: float,
    sampling: "Sampling",
    chance: float | None,
    exact: bool,
) -> Judged:
    """Return what a run amounts to.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, confidence, trials, max_trials, sampling, chance
        As in `ransac_fix.patching.missing.missing_trials`.
        Without `trials`, what the library's rule asks for up to its limit.
    exact : bool
        The library's rule is exact.
    """
    n_inliers = min(max(n_inliers, sample_size), n_samples)
    counts = n_inliers, n_samples, sample_size
    approximate = approximate_required_trials(*counts, confidence)
    if chance is None:
        needed = required_trials(*counts, confidence, sampling=sampling)
    elif 0 < chance < 1 and confidence < 1:
        needed = math.ceil(math.log1p(-confidence) / math.log1p(-chance))
    else:
        needed = 1 if chance > 0 else math.inf
    if trials is None:
        trials = max(min(needed if exact else approximate, max_trials), 1)
    elif exact:
        trials = min(max(trials, needed), max_trials)
    if chance is None:
        chance = all_inlier_probability(*counts, sampling=sampling)
    success = -math.expm1(trials * math.log1p(-chance)) if chance < 1 else float(trials > 0)
    bound: Bound = "rule"
    if trials >= max_trials and max_trials < needed:
        bound = "cap"
    elif trials > max(needed, approximate) + _OFFSET:
        bound = "floor"
    elif trials >= max_trials and max_trials < approximate:
        bound = "cap"
    return Judged(n_inliers, trials, needed, success, bound)


class Record(NamedTuple):
    """One call, or so many of its numbers as could be read.

    Attributes
    ----------
    outcome : "read", "unread" or "failed"
        unread: the run's numbers could not be read. failed: it raised.
    seconds : float
        Time that it took.
    patched : bool
        The library was patched when it was called.
    short : bool
        It ran fewer trials than the guarantee needs.
    n_inliers, n_samples, sample_size, confidence, trials, max_trials, needed, success, bound
        As in `judge` and `Judged`.
    """

    outcome: Literal["read", "unread", "failed"]
    seconds: float
    patched: bool = False
    short: bool = False
    n_inliers: int = 0
    n_samples: int = 0
    sample_size: int = 0
    confidence: float = 0.0
    trials: float = 0.0
    max_trials: float = 0.0
    needed: float = 0.0
    success: float = 0.0
    bound: Bound = "rule"

    @property
    def extra(self) -> float:
        """Trials that are missing, up to the limit; 0 where the guarantee holds."""
        return min(self.needed, self.max_trials) - self.trials if self.short else 0.0


# The site and four flags, then all numbers as floats: counts below 2**53 are exact.
_CALL = struct.Struct("=IB9d")
_READ, _PATCHED, _FAILED, _REPLACED = 1, 2, 4, 8
_NOTHING: "Facts" = (0, 0, 0, 0.0, 0.0, 0.0, "distinct", None)
PACKED_SIZE = _CALL.size


def packed(site: int, raw: Raw) -> bytes:
    """Return what was kept of a call, and the number of its call site, in `PACKED_SIZE` bytes."""
    facts, seconds, patched, failed, allowed = raw
    flags = patched * _PATCHED + failed * _FAILED
    if facts is None:
        facts = _NOTHING
    else:
        flags += _READ
    n_inliers, n_samples, sample_size, confidence, trials, max_trials, sampling, chance = facts
    if sampling == "replacement":
        flags += _REPLACED
    return _CALL.pack(
        site,
        flags,
        n_inliers,
        n_samples,
        sample_size,
        confidence,
        math.nan if trials is None else trials,
        max_trials,
        math.nan if chance is None else chance,
        seconds,
        allowed,
    )


def unpacked(data: bytes, offset: int) -> tuple[int, Raw]:
    """Return what `packed` was given."""
    site, flags, n_inliers, n_samples, sample_size, *numbers, seconds, allowed = _CALL.unpack_from(
        data, offset
    )
    confidence, trials, max_trials, chance = numbers
    facts: Facts | None = None
    if flags & _READ:
        facts = (
            int(n_inliers),
            int(n_samples),
            int(sample_size),
            confidence,
            None if math.isnan(trials) else trials,
            max_trials,
            "replacement" if flags & _REPLACED else "distinct",
            None if math.isnan(chance) else chance,
        )
    return site, (facts, seconds, bool(flags & _PATCHED), bool(flags & _FAILED), allowed)


def described(raw: Raw, exact: bool) -> Record:
    """Return the record of a call from what was kept of it.

    Parameters
    ----------
    raw : tuple
        See `Raw`.
    exact : bool
        The library's rule is exact.
    """
    facts, seconds, patched, failed, allowed = raw
    if failed or facts is None:
        return Record("failed" if failed else "unread", seconds, patched)
    # NumPy's numbers may be among them.
    n_inliers, n_samples, sample_size = int(facts[0]), int(facts[1]), int(facts[2])
    confidence, max_trials = float(facts[3]), float(facts[5])
    trials = None if facts[4] is None else float(facts[4])
    judged = judge(
        n_inliers,
        n_samples,
        sample_size,
        confidence,
        trials,
        max_trials,
        facts[6],
        None if facts[7] is None else float(facts[7]),
        # What a patch has counted is what was run.
        exact or (patched and trials is None),
    )
    short = judged.trials < judged.needed and (
        1.0 - judged.success > (1.0 - confidence) * (1.0 + allowed)
    )
    return Record(
        "read",
        seconds,
        patched,
        short,
        judged.n_inliers,
        n_samples,
        sample_size,
        confidence,
        judged.trials,
        max_trials,
        judged.needed,
        judged.success,
        judged.bound,
    )


def is_telling(record: Record) -> bool:
    """Return whether the exact rule would have gone on: only then can a model be missed."""
    return record.outcome == "read" and not record.patched and record.extra > 0


def _bucket(value: float) -> int:
    if value == math.inf:
        return _INFINITE
    return round(math.log(value) / _BASE) if value > 0 else -_INFINITE


@dataclass(slots=True)
class Spread:
    """The range and the median of a number that is not negative."""

    count: int = 0
    total: float = 0.0
    low: float = math.inf
    high: float = -math.inf
    buckets: dict[int, int] = field(default_factory=dict)

    def add(self, values: Sequence[float]) -> None:
        """Count values; infinity is counted and left out of the sum."""
        if not values:
            return
        # Most numbers recur.
        counts = Counter(values)
        self.count += len(values)
        self.low = min(self.low, min(counts))
        self.high = max(self.high, max(counts))
        buckets = self.buckets
        for value, count in counts.items():
            if value < math.inf:
                self.total += value * count
            bucket = _bucket(value)
            buckets[bucket] = buckets.get(bucket, 0) + count

    def merge(self, other: "Spread") -> None:
        """Count what another has counted."""
        self.count += other.count
        self.total += other.total
        self.low = min(self.low, other.low)
        self.high = max(self.high, other.high)
        for bucket, count in other.buckets.items():
            self.buckets[bucket] = self.buckets.get(bucket, 0) + count

    @property
    def median(self) -> float:
        """The median, within one percent; 0 where nothing was counted."""
        left = (self.count + 1) // 2
        for bucket in sorted(self.buckets):
            left -= self.buckets[bucket]
            if left <= 0:
                if abs(bucket) == _INFINITE:
                    return self.high if bucket > 0 else self.low
                value = math.exp(bucket * _BASE)
                return min(max(value, self.low), self.high)
        return 0.0


@dataclass(frozen=True, slots=True)
class Worst:
    """The call that stopped furthest short of its guarantee."""

    n_inliers: int
    n_samples: int
    sample_size: int
    confidence: float
    trials: float
    max_trials: float
    needed: float
    success: float
    bound: Bound


_SPREADS = (
    "n_samples",
    "n_inliers",
    "sample_size",
    "confidence",
    "trials",
    "max_trials",
    "needed",
    "success",
)
_spread_values = attrgetter(*_SPREADS)


@dataclass(slots=True)
class Tally:
    """The calls of one call site.

    Attributes
    ----------
    calls, unread, failed, patched : int
        All calls; those of no known numbers; those that raised; those made exact.
    rule, cap, floor : int
        What bound the calls that could be read.
    short, short_by_cap, short_of_limit : int
        Calls that stopped before the guarantee; those stopped by the limit on trials; those for
        which the limit is lower than what the guarantee needs.
    telling : int
        Calls in which a model can have been missed, see `is_telling`.
    seconds, spreads, shortfall
        Distributions over the calls; `shortfall` is confidence minus success, of short calls.
    extra_trials, extra_seconds : float
        What exactness would have cost within the limits on trials.
    worst : Worst or None
        The call with the largest shortfall.
    """

    calls: int = 0
    unread: int = 0
    failed: int = 0
    patched: int = 0
    rule: int = 0
    cap: int = 0
    floor: int = 0
    short: int = 0
    short_by_cap: int = 0
    short_of_limit: int = 0
    telling: int = 0
    seconds: Spread = field(default_factory=Spread)
    shortfall: Spread = field(default_factory=Spread)
    spreads: dict[str, Spread] = field(default_factory=lambda: {n: Spread() for n in _SPREADS})
    extra_trials: float = 0.0
    extra_seconds: float = 0.0
    worst: Worst | None = None

    def add(self, records: Sequence[Record]) -> None:
        """Count calls. Many at once take a fraction of the time."""
        self.calls += len(records)
        self.seconds.add([record.seconds for record in records])
        self.patched += sum(record.patched for record in records)
        read = [record for record in records if record.outcome == "read"]
        if len(read) < len(records):
            failed = sum(record.outcome == "failed" for record in records)
            self.failed += failed
            self.unread += len(records) - len(read) - failed
        for bound, count in Counter([record.bound for record in read]).items():
            setattr(self, bound, getattr(self, bound) + count)
        columns = zip(*map(_spread_values, read), strict=True)
        for spread, values in zip(self.spreads.values(), columns, strict=bool(read)):
            spread.add(values)
        short = [record for record in read if record.short]
        self.shortfall.add([max(record.confidence - record.success, 0.0) for record in short])
        for record in short:
            self._add_short(record)

    def _add_short(self, record: Record) -> None:
        self.short += 1
        self.short_by_cap += record.bound == "cap"
        self.short_of_limit += record.needed > record.max_trials
        extra = record.extra
        self.telling += extra > 0 and not record.patched
        if math.isfinite(extra):
            self.extra_trials += extra
            self.extra_seconds += extra * record.seconds / max(record.trials, 1)
        worst = self.worst
        if worst is None or record.confidence - record.success > worst.confidence - worst.success:
            self.worst = Worst(**{name: getattr(record, name) for name in Worst.__slots__})

    def merge(self, other: "Tally") -> None:
        """Count what another has counted."""
        for name in _SUMS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.seconds.merge(other.seconds)
        self.shortfall.merge(other.shortfall)
        for name, spread in self.spreads.items():
            spread.merge(other.spreads[name])
        mine, theirs = self.worst, other.worst
        if theirs is not None and (
            mine is None or theirs.confidence - theirs.success > mine.confidence - mine.success
        ):
            self.worst = theirs

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data, for a file."""
        return asdict(self)

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> "Tally":
        """Return what `to_data` has made plain."""
        values = dict(data)
        for name in ("seconds", "shortfall"):
            values[name] = _spread(values[name])
        values["spreads"] = {name: _spread(spread) for name, spread in values["spreads"].items()}
        if values["worst"] is not None:
            values["worst"] = Worst(**values["worst"])
        return cls(**values)


_SUMS = (
    "calls",
    "unread",
    "failed",
    "patched",
    "rule",
    "cap",
    "floor",
    "short",
    "short_by_cap",
    "short_of_limit",
    "telling",
    "extra_trials",
    "extra_seconds",
)


def _spread(data: dict[str, Any]) -> Spread:
    # JSON has text for keys only.
    buckets = {int(bucket): count for bucket, count in data["buckets"].items()}
    return Spread(**{**data, "buckets": buckets})
