"""The synthetic tables: instances to numbers with intervals, and the variants of the setup."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ransac_fix.experiments.intervals import Estimate, mean, relative_change
from ransac_fix.experiments.synthetic.runs import Runs, trial_tables
from ransac_fix.experiments.synthetic.setup import PaperRow, Setup, Shape, paper_row

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a synthetic table.

    Parameters
    ----------
    setup : Setup
        What was run.
    n_instances : int
        How often.
    approximate, exact : tuple of Estimate
        AUC at 1, 2, 3 in percent.
    change : tuple of Estimate or None
        Exact relative to approximate, paired, in percent; None where the approximate AUC is 0.
    in_hand : tuple of float
        Mean inliers in hand when the approximate and the exact rule stop: the fewest with which
        each stops where it did.
    trials : tuple of float
        Mean trials of the approximate and the exact rule.
    trials_if_kept : float
        Mean trials of the exact rule if it kept the model in hand when the approximate one stops.
    more_trials : Estimate
        N_e/a in percent: all trials of the exact rule relative to all of the approximate one.
    more_trials_an_instance : Estimate
        The mean over instances of their own N_e/a in percent.
    tests : int
        Tests of a point against a model.
    paper : PaperRow or None
        The paper's row.
    """

    setup: Setup
    n_instances: int
    approximate: tuple[Estimate, ...]
    exact: tuple[Estimate, ...]
    change: tuple[Estimate | None, ...]
    in_hand: tuple[float, float]
    trials: tuple[float, float]
    trials_if_kept: float
    more_trials: Estimate
    more_trials_an_instance: Estimate
    tests: int
    paper: PaperRow | None


def summarise(setup: Setup, runs: Runs) -> Row:
    """Return the table's row for the runs of one setup."""
    approximate, exact = runs.gains[:, 0], runs.gains[:, 1]
    trials = runs.trials.astype(float)
    asked = trial_tables(setup.n_samples, setup.sample_size, setup.confidence)
    in_hand = [
        _fewest_inliers(table, column) for table, column in zip(asked, runs.trials.T, strict=True)
    ]
    n = range(approximate.shape[1])
    return Row(
        setup=setup,
        n_instances=len(trials),
        approximate=tuple(mean(approximate[:, i]).times(100) for i in n),
        exact=tuple(mean(exact[:, i]).times(100) for i in n),
        change=tuple(
            relative_change(approximate[:, i], exact[:, i]).times(100)
            if approximate[:, i].any()
            else None
            for i in n
        ),
        in_hand=(float(in_hand[0].mean()), float(in_hand[1].mean())),
        trials=(float(trials[:, 0].mean()), float(trials[:, 1].mean())),
        trials_if_kept=float(np.maximum(asked[1][in_hand[0]], runs.trials[:, 0]).mean()),
        more_trials=relative_change(trials[:, 0], trials[:, 1]).times(100),
        more_trials_an_instance=mean(trials[:, 1] / trials[:, 0] - 1).times(100),
        tests=int(runs.tests.sum()),
        paper=paper_row(setup),
    )


def _fewest_inliers(asked: IntArray, trials: IntArray) -> IntArray:
    """Return for each run the fewest inliers with which its rule asks for no more trials."""
    # The rule asks for fewer the more inliers there are.
    fewest: IntArray = len(asked) - np.searchsorted(asked[::-1], trials, side="right")
    return fewest


def paper_change(paper: PaperRow, i: int) -> float:
    """Return the paper's relative improvement of the i-th AUC in percent."""
    return 100 * (paper.exact[i] / paper.approximate[i] - 1)


def variants(shape: Shape) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each plausible reading of the paper: a name, and what differs from the default."""
    yield "as documented", {}
    yield "ties: the first model stays", {"ties": "first"}
    yield "ties: residuals of all measurements", {"ties": "all"}
    placed = "whole chords of the box" if shape == "line" else "ellipses wholly in the box"
    yield placed, {"placement": "whole"}
    clear = {"outliers": "clear"}
    yield "outliers clear of the true shape", clear
    yield "noise: variance in [0.5, 2]", {"noise": "variance"}
    yield "noise: deviation in [0.5, 2]", {"noise": "deviation"}
    yield "noise: drawn for each measurement", {"scope": "measurement"}
    yield "inliers: squared whitened distance at most 3", {"limit": "square"}
    yield "AUC of whitened errors", {"error": "whitened"}
    yield "each rule on its own samples", {"streams": "own"}
    if shape == "ellipse":
        redrawn, radial = {"conics": "redrawn"}, {"distance": "radial"}
        yield "inliers by Sampson's distance", {"distance": "sampson"}
        yield "inliers by the radial distance", radial
        yield "points on no ellipse: drawn again", redrawn
        yield "outliers clear, points drawn again", clear | redrawn
        yield "outliers clear, radial distance", clear | radial
        yield "outliers clear, squared distance at most 3", clear | {"limit": "square"}
    own = {"scope": "measurement", "noise": "deviation"}
    yield "outliers clear, squared distance, own deviations", clear | own | {"limit": "square"}
    yield "control: outliers only", {"placement": "absent"}


def with_changes(setup: Setup, changes: dict[str, str]) -> Setup:
    """Return the setup with the fields of a variant changed."""
    return replace(setup, **changes)  # type: ignore[arg-type]
