"""Both rules on one instance after another."""

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.experiments.synthetic import kernels
from ransac_fix.experiments.synthetic.instances import Instance, make_instance
from ransac_fix.experiments.synthetic.setup import THRESHOLDS, WHITENED_LIMIT, Setup

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_TIES = {"first": 0, "inliers": 1, "all": 2}
_DISTANCES = {"geometric": 0, "sampson": 1, "radial": 2}
_ENDLESS = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class Runs:
    """Results of consecutive instances, one row each; column 0 is the approximate rule, 1 exact.

    Parameters
    ----------
    gains : ndarray of shape (instances, 2, 3)
        The instance's part of AUC@1, @2 and @3: the mean over its ground-truth points of
        ``max(0, 1 - error / threshold)``. Their mean over instances is the AUC.
    trials : ndarray of shape (instances, 2)
        Trials run.
    tests : ndarray of shape (instances,)
        Tests of a point against a model, in the run of the exact rule.
    """

    gains: FloatArray
    trials: IntArray
    tests: IntArray


def run_instances(setup: Setup, seed: int, start: int, stop: int) -> Runs:
    """Run instances `start` to `stop`, exclusive.

    The results depend on the arguments alone, not on how instances are grouped or where they run.

    Parameters
    ----------
    setup : Setup
        The row of a table.
    seed, start, stop : int
        Not negative.
    """
    n = stop - start
    gains = np.empty((n, 2, len(THRESHOLDS)))
    trials = np.empty((n, 2), np.int64)
    tests = np.empty(n, np.int64)
    for row in range(n):
        instance = make_instance(setup, seed, start + row)
        models = np.empty((2, 3 if setup.shape == "line" else 5))
        tests[row] = fit_both(setup, instance, trials[row], models)
        gains[row, 0] = gain(setup, instance, models[0])
        # Most runs hold the same model at both stops.
        same = np.array_equal(models[0], models[1])
        gains[row, 1] = gains[row, 0] if same else gain(setup, instance, models[1])
    return Runs(gains, trials, tests)


def fit_both(setup: Setup, instance: Instance, trials: IntArray, models: FloatArray) -> int:
    """Run both rules on one instance's stream; return the tests of a point against a model.

    Parameters
    ----------
    setup, instance
        The problem.
    trials : ndarray of shape (2,)
        Filled with the trials of the approximate and the exact rule.
    models : ndarray of shape (2, 3) for a line, (2, 5) for an ellipse
        Filled with the best models.
    """
    shared, own = instance.streams
    tests = _fit(setup, instance, shared, trials, models)
    if setup.streams == "own":
        own_trials, own_models = np.empty_like(trials), np.empty_like(models)
        tests = _fit(setup, instance, own, own_trials, own_models)
        trials[1], models[1] = own_trials[1], own_models[1]
    return tests


def _fit(
    setup: Setup, instance: Instance, stream: np.uint64, trials: IntArray, models: FloatArray
) -> int:
    approximate, exact = trial_tables(setup.n_samples, setup.sample_size, setup.confidence)
    x, y = np.ascontiguousarray(instance.points.T)
    limit = WHITENED_LIMIT[setup.limit] * instance.deviations
    common = (x, y, limit, stream, approximate, exact, _TIES[setup.ties])
    if setup.shape == "line":
        return kernels.fit_lines(*common, trials, models)
    distance, redrawn = _DISTANCES[setup.distance], setup.conics == "redrawn"
    return kernels.fit_ellipses(*common, distance, redrawn, trials, models)


def gain(setup: Setup, instance: Instance, model: FloatArray) -> FloatArray:
    """Return the instance's part of each AUC, shape (3,)."""
    x, y = np.ascontiguousarray(instance.truth.T)
    distances = kernels.line_distances if setup.shape == "line" else kernels.ellipse_distances
    errors = distances(x, y, model)
    if setup.error == "whitened":
        errors = errors / instance.deviations[: len(errors)]
    return np.array([np.maximum(0.0, 1.0 - errors / t).mean() for t in THRESHOLDS])


@lru_cache
def trial_tables(
    n_samples: int, sample_size: int, confidence: Fraction
) -> tuple[IntArray, IntArray]:
    """Return the trials each rule asks for at 0 to n inliers, approximate first, exact second.

    Parameters
    ----------
    n_samples, sample_size, confidence
        As in `ransac_fix.criterion.required_trials`.

    Returns
    -------
    tuple of two ndarrays of shape (n_samples + 1,)
        The largest 64-bit integer where there are more, or no number is enough.
    """

    def table(rule: object) -> IntArray:
        assert callable(rule)
        asked = [rule(i, n_samples, sample_size, confidence) for i in range(n_samples + 1)]
        return np.array([int(min(n, _ENDLESS)) for n in asked], np.int64)

    return table(approximate_required_trials), table(required_trials)
