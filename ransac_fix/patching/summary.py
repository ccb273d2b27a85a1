"""What `ransac_fix.trace` reports: the sums of the recorded calls, in words where words help."""

import math
import statistics
from dataclasses import dataclass

from ransac_fix.patching.calls import Bound, Key, Spread, Tally
from ransac_fix.patching.recorder import Recorder
from ransac_fix.patching.verification import Verified, interval

__all__ = [
    "NOT_VISIBLE",
    "Bounds",
    "CallSite",
    "Range",
    "TraceReport",
    "Verification",
    "WorstCall",
    "summarise",
]

NOT_VISIBLE = (
    "RANSAC inside a compiled pipeline (a mapper, a matcher, a two-view function that calls"
    " several estimators) and in libraries without a patch is not visible from Python."
)


@dataclass(frozen=True, slots=True)
class Range:
    """The smallest, the middle and the largest value; None stands for infinity."""

    low: float | None
    median: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class Bounds:
    """What ended runs.

    Attributes
    ----------
    rule : int
        The stopping rule.
    cap : int
        The limit on trials.
    floor : int
        More trials than a stopping rule asks for, exact or approximate: a minimum, a multiplier,
        or a best model that came late.
    """

    rule: int
    cap: int
    floor: int


@dataclass(frozen=True, slots=True)
class WorstCall:
    """The call that stopped furthest short of its guarantee.

    Attributes
    ----------
    n_inliers, n_samples, sample_size : int
        I, n and k. Fewer inliers than a sample holds count as so many.
    confidence : float
        s, as the call asked for it.
    trials, max_trials, needed : float or None
        Trials run, allowed, and needed by the exact rule; None stands for infinity.
    success : float
        The probability that `trials` samples contain one of inliers only.
    bound : "rule", "cap" or "floor"
        What ended the run, see `Bounds`.
    """

    n_inliers: int
    n_samples: int
    sample_size: int
    confidence: float
    trials: float | None
    max_trials: float | None
    needed: float | None
    success: float
    bound: Bound


@dataclass(frozen=True, slots=True)
class CallSite:
    """The calls of one function from one line.

    Attributes
    ----------
    system, function : str
        What was called.
    file, line, caller
        Where from: the nearest line of the program's own code, and the name of its function.
    calls, unread, failed, patched : int
        All calls; those whose numbers could not be read (another method than RANSAC, no model,
        or RANSAC inside); those that raised; those made exact by a patch.
    trials_are : "counted" or "at least"
        Whether the library says how many trials it ran. Where it does not, they are what its
        rule asks for with its final model, and probabilities are lower bounds.
    bounds : Bounds
        What ended the runs that could be read.
    n_samples, n_inliers, sample_size, confidence, trials, max_trials, needed, success : Range
        Over the calls that could be read; None where there are none.
    seconds : Range
        Time of a call.
    total_seconds : float
        Time of all of them.
    short, short_by_cap : int
        Calls that stopped before their guarantee held; those stopped by the limit on trials.
    shortfall : Range or None
        Confidence minus success, of calls that stopped short.
    extra_trials, extra_seconds : float
        What exactness would have cost within the limits on trials, at the speed of these calls.
    worst : WorstCall or None
        The call with the largest shortfall.
    replayed, missed : int
        Calls made again with the exact rule, and those that then found a model with more inliers.
    remedy : str
        What to do; empty where there is nothing to do.
    """

    system: str
    function: str
    file: str
    line: int
    caller: str
    calls: int
    unread: int
    failed: int
    patched: int
    trials_are: str
    bounds: Bounds
    n_samples: Range | None
    n_inliers: Range | None
    sample_size: Range | None
    confidence: Range | None
    trials: Range | None
    max_trials: Range | None
    needed: Range | None
    success: Range | None
    seconds: Range | None
    total_seconds: float
    short: int
    short_by_cap: int
    shortfall: Range | None
    extra_trials: float
    extra_seconds: float
    worst: WorstCall | None
    replayed: int
    missed: int
    remedy: str


@dataclass(frozen=True, slots=True)
class Verification:
    """Calls made again with the exact rule: how many models were really missed.

    Attributes
    ----------
    asked : int
        How many were to be made again.
    telling : int
        Calls of the program in which a model can have been missed: they stopped short while their
        limits allowed more trials. The sample is drawn from these.
    replayed : int
        Calls made again.
    missed : int
        Those that found a model with more inliers than with the library's own rule.
    rate : float or None
        ``missed / replayed``; None where none was made again.
    low, high : float or None
        Its 95 % interval, by Clopper and Pearson.
    gained : Range or None
        How many inliers more, in calls that missed a model.
    not_replayed : dict
        Why calls of the sample could not be made again, and how many.
    """

    asked: int
    telling: int
    replayed: int
    missed: int
    rate: float | None
    low: float | None
    high: float | None
    gained: Range | None
    not_replayed: dict[str, int]


@dataclass(frozen=True, slots=True)
class TraceReport:
    """The RANSAC calls of a program.

    Attributes
    ----------
    schema_version : int
        Of the JSON form.
    seconds : float
        Time from start to end.
    processes : int
        Processes that recorded calls, or could have.
    calls, unread, failed : int
        As in `CallSite`, of all sites.
    short, short_by_cap : int
        As in `CallSite`, of all sites.
    bounds : Bounds
        Of all sites.
    extra_trials, extra_seconds : float
        As in `CallSite`, of all sites.
    sites : tuple of CallSite
        Those furthest short of their guarantee first.
    verification : Verification or None
        What calls made again found; None where that was not asked for.
    left_out : dict
        Libraries whose calls were not seen, and why.
    not_visible : str
        What no trace can see.
    """

    schema_version: int
    seconds: float
    processes: int
    calls: int
    unread: int
    failed: int
    short: int
    short_by_cap: int
    bounds: Bounds
    extra_trials: float
    extra_seconds: float
    sites: tuple[CallSite, ...]
    verification: Verification | None
    left_out: dict[str, str]
    not_visible: str

    def __str__(self) -> str:
        calls = f"{self.calls} RANSAC call{'' if self.calls == 1 else 's'}"
        sites = f"{len(self.sites)} call site{'' if len(self.sites) == 1 else 's'}"
        return (
            f"{calls} at {sites}: {self.short} stopped short of the guarantee,"
            f" {self.short_by_cap} of them at a limit on trials;"
            f" {self.unread} could not be read"
        )


def summarise(
    recorder: Recorder,
    seconds: float,
    processes: int,
    asked: int = 0,
    verified: Verified | None = None,
) -> TraceReport:
    """Return the report of what was recorded.

    Parameters
    ----------
    recorder : Recorder
        All calls.
    seconds : float
        Time from start to end.
    processes : int
        How many processes recorded.
    asked : int, default 0
        How many calls were to be made again.
    verified : Verified, optional
        What these found.
    """
    sites = [_site(key, tally, recorder, verified) for key, tally in recorder.tallies.items()]
    sites.sort(key=_order)
    return TraceReport(
        schema_version=1,
        seconds=seconds,
        processes=processes,
        calls=sum(site.calls for site in sites),
        unread=sum(site.unread for site in sites),
        failed=sum(site.failed for site in sites),
        short=sum(site.short for site in sites),
        short_by_cap=sum(site.short_by_cap for site in sites),
        bounds=Bounds(
            sum(site.bounds.rule for site in sites),
            sum(site.bounds.cap for site in sites),
            sum(site.bounds.floor for site in sites),
        ),
        extra_trials=math.fsum(site.extra_trials for site in sites),
        extra_seconds=math.fsum(site.extra_seconds for site in sites),
        sites=tuple(sites),
        verification=None if verified is None else _verification(asked, verified),
        left_out=dict(sorted(recorder.left_out.items())),
        not_visible=NOT_VISIBLE,
    )


def _verification(asked: int, verified: Verified) -> Verification:
    replayed, missed = sum(verified.replayed.values()), sum(verified.missed.values())
    low, high = interval(missed, replayed) if replayed else (None, None)
    gains = sorted(verified.gains)
    return Verification(
        asked=asked,
        telling=verified.telling,
        replayed=replayed,
        missed=missed,
        rate=missed / replayed if replayed else None,
        low=low,
        high=high,
        gained=Range(gains[0], statistics.median(gains), gains[-1]) if gains else None,
        not_replayed=dict(sorted(verified.not_replayed.items())),
    )


def _order(site: CallSite) -> tuple[float, int, str, int, str]:
    worst = site.worst.confidence - site.worst.success if site.worst else -1.0
    return -worst, -site.calls, site.file, site.line, site.function


def _site(key: Key, tally: Tally, recorder: Recorder, verified: Verified | None) -> CallSite:
    system, function, file, line, caller = key
    ranges = {name: _range(spread) for name, spread in tally.spreads.items()}
    worst = tally.worst
    return CallSite(
        system=system,
        function=function,
        file=file,
        line=line,
        caller=caller,
        calls=tally.calls,
        unread=tally.unread,
        failed=tally.failed,
        patched=tally.patched,
        trials_are="counted" if system in recorder.counted else "at least",
        bounds=Bounds(tally.rule, tally.cap, tally.floor),
        seconds=_range(tally.seconds),
        total_seconds=tally.seconds.total,
        short=tally.short,
        short_by_cap=tally.short_by_cap,
        shortfall=_range(tally.shortfall),
        extra_trials=tally.extra_trials,
        extra_seconds=tally.extra_seconds,
        worst=None
        if worst is None
        else WorstCall(
            worst.n_inliers,
            worst.n_samples,
            worst.sample_size,
            worst.confidence,
            _finite(worst.trials),
            _finite(worst.max_trials),
            _finite(worst.needed),
            worst.success,
            worst.bound,
        ),
        replayed=verified.replayed.get(key, 0) if verified else 0,
        missed=verified.missed.get(key, 0) if verified else 0,
        remedy=_remedy(system, tally, system in recorder.exact),
        **ranges,
    )


def _remedy(system: str, tally: Tally, exact: bool) -> str:
    """Return what to do about calls that stopped short."""
    parts = []
    if tally.short > tally.short_by_cap and not exact and tally.patched < tally.calls:
        parts.append(f"make {system} exact: `ransac-fix run`, or ransac_fix.patch({system!r})")
    elif tally.short > tally.short_by_cap:
        parts.append(f"report this to ransac-fix: {system} counts as exact and stopped short")
    if tally.short_of_limit:
        most = tally.spreads["needed"].high
        text = (
            f"raise the limit on trials to {most:.0f}"
            if most < math.inf
            else "no number of trials gives a confidence of 1: ask for less"
        )
        parts.append(text)
    return "; ".join(parts)


def _range(spread: Spread) -> Range | None:
    if not spread.count:
        return None
    return Range(_finite(spread.low), _finite(spread.median), _finite(spread.high))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
