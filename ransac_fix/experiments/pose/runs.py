"""Both rules, or the bare and the patched library, on one subsample of a problem."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial

import cv2

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.experiments.pose.libraries import LIBRARIES
from ransac_fix.experiments.pose.problems import Estimate, Kind, Problem
from ransac_fix.experiments.pose.stopping import Stop, first_stop

# Short calls are timed a few times: what else the machine does only ever makes one longer. So does
# it the wall-clock time, by any amount, which is why processor time is taken; the calls run in one
# thread, so on an idle machine the two are the same.
_TIMINGS = 3
_LONG_ENOUGH = 0.01


@dataclass(frozen=True, slots=True)
class Patch:
    """How the library is made exact at run time.

    Parameters
    ----------
    active : callable
        Returns a context manager in whose block the library is patched.
    version : str
        Tells results of one patch from those of another, or of the same after a change.
    """

    active: Callable[[], AbstractContextManager[object]]
    version: str


@dataclass(frozen=True, slots=True)
class Settings:
    """What is run on each problem.

    Parameters
    ----------
    library : str
        A key of `LIBRARIES`.
    ns : tuple of int
        Numbers of correspondences; problems with fewer are left out.
    confidences : tuple of float
        Values of s.
    repeats : int
        Subsamples of each problem.
    cap : int
        Trials after which a run ends in any case.
    seed : int
        Of the subsamples and of the libraries' random streams.
    patch : Patch, optional
        If given, the library under its own rule is compared with the same call while it is
        patched, in place of the two rules found from outside.
    """

    library: str
    ns: tuple[int, ...]
    confidences: tuple[float, ...]
    repeats: int
    cap: int
    seed: int
    patch: Patch | None = None


@dataclass(frozen=True, slots=True)
class RuleRun:
    """One run under one rule.

    Parameters
    ----------
    error : float
        Distance from the truth, infinite where nothing was estimated.
    trials : int or None
        Trials run; None where the library does not say.
    seconds : float
        Processor time of the call, the shortest of a few.
    capped : bool
        Whether the rule was not met within the cap, or the library cannot run that long.
    """

    error: float
    trials: int | None
    seconds: float
    capped: bool


@dataclass(frozen=True, slots=True)
class Case:
    """Both rules on one subsample, on one random stream.

    Parameters
    ----------
    kind, dataset, name, unit : str
        The problem and the unit of its errors.
    n_samples, repeat : int
        The subsample.
    confidence : float
        s.
    approximate, exact : RuleRun
        The two rules.
    """

    kind: Kind
    dataset: str
    name: str
    unit: str
    n_samples: int
    repeat: int
    confidence: float
    approximate: RuleRun
    exact: RuleRun


def run_case(problem: Problem, n: int, repeat: int, settings: Settings) -> list[Case]:
    """Run both rules at every confidence on one subsample of a problem.

    Parameters
    ----------
    problem : Problem
        Where the subsample is taken from.
    n, repeat : int
        Its size and its number.
    settings : Settings
        What is run; `ns` and `repeats` play no part.

    Returns
    -------
    list of Case
        One a confidence, in their order.
    """
    cv2.setNumThreads(1)
    if settings.patch is not None:
        return _run_patched(problem, n, repeat, settings, settings.patch)
    library = LIBRARIES[settings.library]
    k = library.sample_size[problem.kind]
    subsample = problem.subsample(n, settings.seed, repeat)
    known: dict[int, _Timed] = {}

    def after(trials: int) -> Estimate:
        if trials not in known:
            known[trials] = _Timed(lambda: library.run(subsample, trials, settings.seed))
        return known[trials].estimate

    def inliers_after(trials: int) -> int:
        return int(after(trials).inliers.sum())

    def runs(*stops: Stop) -> list[RuleRun]:
        found = []
        seconds = _shortest([known[stop.trials] for stop in stops])
        for stop, shortest in zip(stops, seconds, strict=True):
            estimate = after(stop.trials)
            error = problem.truth.error(subsample, estimate)
            reached = library.reaches(stop.trials, int(estimate.inliers.sum()), n, k)
            found.append(RuleRun(error, stop.trials, shortest, stop.capped or not reached))
        return found

    cases = []
    for confidence in settings.confidences:
        asked = partial(_asked, n=n, k=k, confidence=confidence)
        approximate = first_stop(
            inliers_after, partial(asked, approximate_required_trials), settings.cap
        )
        exact = first_stop(
            inliers_after, partial(asked, required_trials), settings.cap, start=approximate.trials
        )
        stops = [approximate] if exact == approximate else [approximate, exact]
        found = runs(*stops)
        first, second = found[0], found[-1]
        cases.append(_case(problem, n, repeat, confidence, first, second))
    return cases


def _run_patched(
    problem: Problem, n: int, repeat: int, settings: Settings, patch: Patch
) -> list[Case]:
    """Run the bare library under its own rule, and the same calls with the library patched."""
    library = LIBRARIES[settings.library]
    subsample = problem.subsample(n, settings.seed, repeat)
    cases = []
    for confidence in settings.confidences:

        def call(s: float = confidence) -> Estimate:
            return library.bare(subsample, s, settings.seed, settings.cap)

        timed = [_Timed(call), _Timed(call, patch.active)]
        first, second = (
            RuleRun(problem.truth.error(subsample, run.estimate), None, seconds, capped=False)
            for run, seconds in zip(timed, _shortest(timed), strict=True)
        )
        cases.append(_case(problem, n, repeat, confidence, first, second))
    return cases


class _Timed:
    """A call within a context, its first result and its processor times."""

    def __init__(
        self,
        call: Callable[[], Estimate],
        context: Callable[[], AbstractContextManager[object]] = nullcontext,
    ) -> None:
        self.call, self.context = call, context
        self.seconds: list[float] = []
        self.estimate = self.again()

    def again(self) -> Estimate:
        with self.context():
            start = time.process_time()
            estimate = self.call()
            self.seconds.append(time.process_time() - start)
        return estimate


def _shortest(timed: Sequence[_Timed]) -> list[float]:
    """Return the shortest time of each call, after repeating the short ones in turn."""
    for _ in range(_TIMINGS - 1):
        for run in timed:
            if min(run.seconds) < _LONG_ENOUGH:
                run.again()
    return [min(run.seconds) for run in timed]


def _case(
    problem: Problem, n: int, repeat: int, confidence: float, first: RuleRun, second: RuleRun
) -> Case:
    return Case(
        problem.kind,
        problem.dataset,
        problem.name,
        problem.truth.unit,
        n,
        repeat,
        confidence,
        first,
        second,
    )


def _asked(
    rule: Callable[[int, int, int, float], float],
    n_inliers: int,
    *,
    n: int,
    k: int,
    confidence: float,
) -> float:
    # No model yet: any rule goes on.
    return rule(n_inliers, n, k, confidence) if n_inliers >= k else float("inf")
