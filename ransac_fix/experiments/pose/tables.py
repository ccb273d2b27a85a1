"""The pose tables: runs under both rules to numbers with intervals."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ransac_fix.experiments.intervals import Estimate as Interval
from ransac_fix.experiments.intervals import mean, relative_change
from ransac_fix.experiments.pose.problems import Kind
from ransac_fix.experiments.pose.runs import Case

THRESHOLDS = (5.0, 10.0, 20.0)


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a pose table; AUC and changes in percent.

    Parameters
    ----------
    library, kind, dataset, unit : str
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
        Means of the approximate and the exact rule, the times processor times; of trials None
        where they are not known.
    capped, differing : float or None
        Shares of the subsamples in percent: where a rule was not met within the cap, and where
        the rules stopped at different trials. None where the trials are not known.
    """

    library: str
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

PAPER_MILLISECONDS: dict[Kind, dict[tuple[int, float], tuple[float, float]]] = {
    "homography": {
        (20, 0.95): (0.2, 0.7),
        (20, 0.99): (0.3, 0.7),
        (100, 0.95): (1.0, 1.0),
        (100, 0.99): (1.0, 1.0),
        (200, 0.95): (1.2, 1.2),
        (200, 0.99): (1.2, 1.2),
        (1000, 0.95): (3.9, 4.0),
        (1000, 0.99): (4.3, 4.3),
    },
    "essential": {
        (20, 0.95): (0.4, 0.8),
        (20, 0.99): (0.6, 1.4),
        (100, 0.95): (2.0, 2.1),
        (100, 0.99): (2.1, 2.2),
        (200, 0.95): (2.2, 2.2),
        (200, 0.99): (2.3, 2.3),
        (1000, 0.95): (1.8, 1.8),
        (1000, 0.99): (2.0, 2.0),
    },
    "fundamental": {
        (20, 0.95): (0.2, 0.5),
        (20, 0.99): (0.3, 0.7),
        (100, 0.95): (1.4, 1.4),
        (100, 0.99): (1.5, 1.5),
        (200, 0.95): (1.9, 1.9),
        (200, 0.99): (3.1, 2.0),
        (1000, 0.95): (2.2, 2.2),
        (1000, 0.99): (2.3, 2.3),
    },
    "pnp": {
        (20, 0.95): (0.051, 0.052),
        (20, 0.99): (0.057, 0.058),
        (100, 0.95): (0.2, 0.2),
        (100, 0.99): (0.2, 0.2),
        (200, 0.95): (0.3, 0.3),
        (200, 0.99): (0.4, 0.3),
        (1000, 0.95): (1.5, 1.5),
        (1000, 0.99): (1.7, 1.7),
    },
}
"""The paper's average run time of PoseLib, as printed: approximate, exact."""


def summarise(cases: Iterable[Case], library: str, *, by_dataset: bool) -> list[Row]:
    """Return the table's rows: over all data sets of a kind, and for each where asked for.

    Parameters
    ----------
    cases : iterable of Case
        Of one library, in any order.
    library : str
        Its name.
    by_dataset : bool
        Whether each data set has rows of its own, too.

    Returns
    -------
    list of Row
        By kind in the paper's order, unit, data set, n and s.
    """
    groups: dict[tuple[str, str, str, int, float], list[Case]] = defaultdict(list)
    for case in cases:
        for dataset in ("all", case.dataset) if by_dataset else ("all",):
            key = (case.kind, case.unit, dataset, case.n_samples, case.confidence)
            groups[key].append(case)
    order = list(PAPER)
    return [
        _row(library, dataset, found)
        for (_, _, dataset, _, _), found in sorted(
            groups.items(), key=lambda item: (order.index(item[1][0].kind), *item[0][1:])
        )
    ]


def _row(library: str, dataset: str, cases: list[Case]) -> Row:
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
        library=library,
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
