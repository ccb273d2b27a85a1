"""The pose tables: problems to runs under both rules to numbers with intervals."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial

import cv2
import joblib
import numpy as np

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.experiments.intervals import Estimate as Interval
from ransac_fix.experiments.intervals import mean, relative_change
from ransac_fix.experiments.pose.libraries import LIBRARIES
from ransac_fix.experiments.pose.problems import Estimate, Kind, Problem
from ransac_fix.experiments.pose.stopping import Stop, first_stop

THRESHOLDS = (5.0, 10.0, 20.0)

# Short calls are timed a few times: what else the machine does only ever makes one longer.
_TIMINGS = 3
_LONG_ENOUGH = 0.01


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
    patched : callable, optional
        Returns a context manager in whose block the library is patched at run time. If given,
        the library under its own rule is compared with the same call in that block, in place of
        the two rules found from outside.
    """

    library: str
    ns: tuple[int, ...]
    confidences: tuple[float, ...]
    repeats: int
    cap: int
    seed: int
    patched: Callable[[], AbstractContextManager[object]] | None = None


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
        Wall-clock time of the call, the shortest of a few.
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


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a pose table; AUC and changes in percent.

    Parameters
    ----------
    kind, dataset, unit : str
        What was run; the data set is "all" for the row over all of them.
    n_samples : int
        Correspondences.
    confidence : float
        s.
    n_problems, n_cases : int
        Pairs of images, and subsamples of them.
    approximate, exact : tuple of float
        AUC at 5, 10, 20.
    change : tuple of Interval or None
        Exact relative to approximate, paired by subsample, the subsamples of a pair taken
        together; None where the approximate AUC is 0 or there is one pair with one subsample.
    seconds, trials : tuple of float
        Means of the approximate and the exact rule; of trials None where they are not known.
    capped, differing : float or None
        Shares of the subsamples in percent: where a rule was not met within the cap, and where
        the rules stopped at different trials. None where the trials are not known.
    """

    kind: Kind
    dataset: str
    unit: str
    n_samples: int
    confidence: float
    n_problems: int
    n_cases: int
    approximate: tuple[float, ...]
    exact: tuple[float, ...]
    change: tuple[Interval | None, ...]
    seconds: tuple[float, float]
    trials: tuple[float, float] | None
    capped: float | None
    differing: float | None


PAPER: dict[Kind, dict[tuple[int, float], tuple[tuple[float, ...], tuple[float, ...]]]] = {
    "homography": {
        (20, 0.95): ((2.99, 5.87, 9.94), (3.31, 6.48, 10.91)),
        (20, 0.99): ((3.25, 6.23, 10.53), (3.51, 6.74, 11.27)),
        (100, 0.95): ((10.03, 17.32, 25.19), (10.03, 17.33, 25.20)),
        (100, 0.99): ((10.10, 17.51, 25.39), (10.13, 17.53, 25.39)),
        (200, 0.95): ((11.69, 19.79, 28.18), (11.70, 19.80, 28.18)),
        (200, 0.99): ((11.72, 19.82, 28.14), (11.72, 19.82, 28.14)),
        (1000, 0.95): ((58.49, 76.44, 88.21), (58.49, 76.44, 88.21)),
        (1000, 0.99): ((58.78, 76.55, 88.27), (58.78, 76.55, 88.27)),
    },
    "essential": {
        (20, 0.95): ((25.27, 38.63, 52.15), (25.87, 39.42, 53.02)),
        (20, 0.99): ((26.08, 39.66, 53.26), (26.63, 40.36, 54.01)),
        (100, 0.95): ((45.78, 60.81, 73.11), (45.93, 61.00, 73.29)),
        (100, 0.99): ((46.77, 61.86, 74.07), (46.89, 62.01, 74.21)),
        (200, 0.95): ((49.89, 64.39, 76.00), (49.95, 64.47, 76.06)),
        (200, 0.99): ((50.73, 65.38, 76.91), (50.76, 65.41, 76.94)),
        (1000, 0.95): ((37.88, 51.83, 63.18), (37.87, 51.83, 63.18)),
        (1000, 0.99): ((38.19, 52.48, 63.97), (38.19, 52.48, 63.96)),
    },
    "fundamental": {
        (20, 0.95): ((8.59, 15.98, 26.50), (9.02, 16.67, 27.44)),
        (20, 0.99): ((8.98, 16.60, 27.35), (9.36, 17.22, 28.17)),
        (100, 0.95): ((24.62, 37.32, 50.97), (24.79, 37.56, 51.24)),
        (100, 0.99): ((25.38, 38.35, 52.11), (25.54, 38.57, 52.36)),
        (200, 0.95): ((30.09, 43.54, 57.08), (30.16, 43.63, 57.17)),
        (200, 0.99): ((30.86, 44.54, 58.22), (30.93, 44.62, 58.31)),
        (1000, 0.95): ((26.37, 40.42, 54.85), (26.37, 40.42, 54.85)),
        (1000, 0.99): ((26.57, 40.44, 54.37), (26.58, 40.46, 54.38)),
    },
    "pnp": {
        (20, 0.95): ((26.90, 76.97, 93.62), (27.10, 77.16, 93.71)),
        (20, 0.99): ((27.30, 77.19, 93.79), (27.43, 77.37, 93.91)),
        (100, 0.95): ((43.77, 88.10, 97.41), (43.80, 88.13, 97.42)),
        (100, 0.99): ((43.84, 88.31, 97.49), (43.84, 88.32, 97.49)),
        (200, 0.95): ((47.96, 89.76, 97.82), (47.96, 89.77, 97.82)),
        (200, 0.99): ((47.99, 89.88, 97.85), (48.00, 89.88, 97.85)),
        (1000, 0.95): ((50.48, 91.54, 98.24), (50.48, 91.54, 98.24)),
        (1000, 0.99): ((50.54, 91.56, 98.25), (50.54, 91.56, 98.25)),
    },
}
"""The paper's AUC at 5, 10, 20 by (n, s): approximate, exact. Its data sets are other ones."""


def run_problems(
    problems: Sequence[Problem],
    settings: Settings,
    *,
    n_jobs: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,  # noqa: ARG005
) -> list[Case]:
    """Run both rules on subsamples of each problem.

    Parameters
    ----------
    problems, settings
        What is run.
    n_jobs : int, default 1
        Workers. More than the machine's idle cores make the times longer.
    progress : callable
        Called with the subsamples done and all of them.

    Returns
    -------
    list of Case
        In the order of problems, n, repeats and confidences, whatever order they ran in.
    """
    tasks = [
        (problem, n, repeat)
        for problem in problems
        for n in settings.ns
        if len(problem.first) >= n
        for repeat in range(settings.repeats)
    ]
    progress(0, len(tasks))
    parallel = joblib.Parallel(n_jobs=n_jobs, return_as="generator", batch_size=8)
    cases: list[Case] = []
    run = joblib.delayed(run_case)
    for done, found in enumerate(parallel(run(*task, settings) for task in tasks), start=1):
        cases += found
        progress(done, len(tasks))
    return cases


def run_case(problem: Problem, n: int, repeat: int, settings: Settings) -> list[Case]:
    """Run both rules at every confidence on one subsample of a problem."""
    cv2.setNumThreads(1)
    if settings.patched is not None:
        return _run_patched(problem, n, repeat, settings, settings.patched)
    library = LIBRARIES[settings.library]
    k = library.sample_size[problem.kind]
    subsample = problem.subsample(n, settings.seed, repeat)
    known: dict[int, Estimate] = {}

    def after(trials: int) -> Estimate:
        if trials not in known:
            known[trials] = library.run(subsample, trials, settings.seed)
        return known[trials]

    def inliers_after(trials: int) -> int:
        return int(after(trials).inliers.sum())

    def timed(stop: Stop) -> RuleRun:
        n_inliers = inliers_after(stop.trials)
        _, seconds = _timed(lambda: library.run(subsample, stop.trials, settings.seed))
        error = problem.truth.error(subsample, after(stop.trials))
        capped = stop.capped or not library.reaches(stop.trials, n_inliers, n, k)
        return RuleRun(error, stop.trials, seconds, capped)

    cases = []
    for confidence in settings.confidences:
        asked = partial(_asked, n=n, k=k, confidence=confidence)
        approximate = first_stop(
            inliers_after, partial(asked, approximate_required_trials), settings.cap
        )
        exact = first_stop(
            inliers_after, partial(asked, required_trials), settings.cap, start=approximate.trials
        )
        first = timed(approximate)
        second = first if exact == approximate else timed(exact)
        cases.append(_case(problem, n, repeat, confidence, first, second))
    return cases


def _run_patched(
    problem: Problem,
    n: int,
    repeat: int,
    settings: Settings,
    patched: Callable[[], AbstractContextManager[object]],
) -> list[Case]:
    """Run the bare library under its own rule, and the same calls with the library patched."""
    library = LIBRARIES[settings.library]
    subsample = problem.subsample(n, settings.seed, repeat)
    cases = []
    for confidence in settings.confidences:

        def call(s: float = confidence) -> Estimate:
            return library.bare(subsample, s, settings.seed, settings.cap)

        bare, bare_seconds = _timed(call)
        with patched():
            exact, exact_seconds = _timed(call)
        first, second = (
            RuleRun(problem.truth.error(subsample, estimate), None, seconds, capped=False)
            for estimate, seconds in ((bare, bare_seconds), (exact, exact_seconds))
        )
        cases.append(_case(problem, n, repeat, confidence, first, second))
    return cases


def _timed(call: Callable[[], Estimate]) -> tuple[Estimate, float]:
    """Return the first result of a call, and its shortest time."""
    result, seconds = None, float("inf")
    for _ in range(_TIMINGS):
        start = time.perf_counter()
        found = call()
        seconds = min(seconds, time.perf_counter() - start)
        result = found if result is None else result
        if seconds > _LONG_ENOUGH:
            break
    assert result is not None
    return result, seconds


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


def summarise(cases: Iterable[Case], *, by_dataset: bool) -> list[Row]:
    """Return the table's rows: over all data sets of a kind, and for each where asked for."""
    groups: dict[tuple[str, str, str, int, float], list[Case]] = defaultdict(list)
    for case in cases:
        for dataset in ("all", case.dataset) if by_dataset else ("all",):
            key = (case.kind, case.unit, dataset, case.n_samples, case.confidence)
            groups[key].append(case)
    order = list(PAPER)
    return [
        _row(dataset, found)
        for (_, _, dataset, _, _), found in sorted(
            groups.items(), key=lambda item: (order.index(item[1][0].kind), *item[0][1:])
        )
    ]


def _row(dataset: str, cases: list[Case]) -> Row:
    first = cases[0]
    pairs = sorted({(case.dataset, case.name) for case in cases})
    # The subsamples of a pair are not independent of each other; of a single pair there is
    # nothing else.
    cluster = {pair: i for i, pair in enumerate(pairs)}
    alone = len(pairs) == 1
    at = np.array([case.repeat if alone else cluster[case.dataset, case.name] for case in cases])
    gains = np.array(
        [[_gains(run.error) for run in (case.approximate, case.exact)] for case in cases]
    )
    clustered = np.array([gains[at == i].mean(axis=0) for i in np.unique(at)])
    runs = [(case.approximate, case.exact) for case in cases]
    change: list[Interval | None] = []
    for i in range(len(THRESHOLDS)):
        before, after = clustered[:, 0, i], clustered[:, 1, i]
        known = before.any() and len(before) > 1
        change.append(relative_change(before, after).times(100) if known else None)
    known_trials = first.exact.trials is not None
    trials = np.array([[run.trials or 0 for run in pair] for pair in runs], float)
    seconds = np.array([[run.seconds for run in pair] for pair in runs])
    auc = [[mean(clustered[:, rule, i]).value * 100 for i in range(3)] for rule in range(2)]
    return Row(
        kind=first.kind,
        dataset=dataset,
        unit=first.unit,
        n_samples=first.n_samples,
        confidence=first.confidence,
        n_problems=len(pairs),
        n_cases=len(cases),
        approximate=tuple(auc[0]),
        exact=tuple(auc[1]),
        change=tuple(change),
        trials=(float(trials[:, 0].mean()), float(trials[:, 1].mean())) if known_trials else None,
        seconds=(float(seconds[:, 0].mean()), float(seconds[:, 1].mean())),
        capped=_percent([a.capped or e.capped for a, e in runs]) if known_trials else None,
        differing=_percent(trials[:, 0] != trials[:, 1]) if known_trials else None,
    )


def _percent(flags: Iterable[bool]) -> float:
    return 100 * mean(np.array([float(flag) for flag in flags])).value


def _gains(error: float) -> list[float]:
    return [max(0.0, 1.0 - error / threshold) for threshold in THRESHOLDS]
