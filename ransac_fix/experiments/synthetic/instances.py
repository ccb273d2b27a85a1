"""Synthetic problem instances, each from its own seed."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ransac_fix.experiments.synthetic import kernels
from ransac_fix.experiments.synthetic.setup import HALF_BOX, NOISE_RANGE, WHITENED_LIMIT, Setup

FloatArray = NDArray[np.float64]

# The power of a number uniform in NOISE_RANGE that is the deviation.
_NOISE_POWER = {"determinant": 0.25, "variance": 0.5, "deviation": 1.0}
_SHAPE_STREAM = {"line": 1, "ellipse": 2}


@dataclass(frozen=True, slots=True)
class Instance:
    """One problem.

    Parameters
    ----------
    truth : ndarray of shape (n_inliers, 2)
        Points of the shape.
    points : ndarray of shape (n_samples, 2)
        Measurements: the points with noise, then the outliers.
    deviations : ndarray of shape (n_samples,)
        Standard deviation of each measurement's noise along each axis.
    streams : tuple of uint64
        Seeds of two streams of samples.
    """

    truth: FloatArray
    points: FloatArray
    deviations: FloatArray
    streams: tuple[np.uint64, np.uint64]


def make_instance(setup: Setup, seed: int, index: int) -> Instance:
    """Return instance number `index`; it depends on these arguments alone.

    Parameters
    ----------
    setup : Setup
        What it is like. Setups that differ only in how models are compared or judged share
        their instances, but for the limit of an inlier where outliers keep clear of it.
    seed, index : int
        Not negative.
    """
    rng = np.random.default_rng([seed, _SHAPE_STREAM[setup.shape], setup.n_inliers, index])
    own = setup.n_samples if setup.scope == "measurement" else 1
    deviations = np.empty(setup.n_samples)
    deviations[:] = rng.uniform(*NOISE_RANGE, own) ** _NOISE_POWER[setup.noise]
    first, second = rng.integers(2**64, size=2, dtype=np.uint64)
    truth, model = _on_segment(rng, setup) if setup.shape == "line" else _on_ellipse(rng, setup)
    noisy = truth + rng.normal(0.0, deviations[: len(truth), None], truth.shape)
    outliers = rng.uniform(-HALF_BOX, HALF_BOX, (setup.n_samples - setup.n_inliers, 2))
    if setup.placement == "absent":
        noisy = rng.uniform(-HALF_BOX, HALF_BOX, truth.shape)
    elif setup.outliers == "clear":
        _clear(rng, outliers, model, WHITENED_LIMIT[setup.limit] * deviations[len(truth) :])
    return Instance(truth, np.concatenate((noisy, outliers)), deviations, (first, second))


def _clear(
    rng: np.random.Generator, outliers: FloatArray, model: FloatArray, limit: FloatArray
) -> None:
    """Draw those outliers again, in place, that are inliers of the true model."""
    distances = kernels.line_distances if len(model) == 3 else kernels.ellipse_distances
    while True:
        x, y = np.ascontiguousarray(outliers.T)
        near = distances(x, y, model) <= limit
        if not near.any():
            return
        outliers[near] = rng.uniform(-HALF_BOX, HALF_BOX, (int(near.sum()), 2))


def _on_segment(rng: np.random.Generator, setup: Setup) -> tuple[FloatArray, FloatArray]:
    """Return points of a segment, and a, b, c of its line a x + b y + c = 0, a^2 + b^2 = 1."""
    ends = rng.uniform(-HALF_BOX, HALF_BOX, (2, 2))
    if setup.placement == "whole":
        ends = _chord(ends)
    along: FloatArray = rng.uniform(size=(setup.n_inliers, 1))
    points: FloatArray = ends[0] + along * (ends[1] - ends[0])
    dx, dy = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    return points, np.array([-dy, dx, dy * ends[0, 0] - dx * ends[0, 1]])


def _chord(ends: FloatArray) -> FloatArray:
    """Return where the line through two points of the box leaves it."""
    direction = ends[1] - ends[0]
    with np.errstate(divide="ignore"):
        at_walls = (np.array([[-HALF_BOX], [HALF_BOX]]) - ends[0]) / direction
    start, stop = at_walls.min(axis=0).max(), at_walls.max(axis=0).min()
    return np.stack((ends[0] + start * direction, ends[0] + stop * direction))


def _on_ellipse(rng: np.random.Generator, setup: Setup) -> tuple[FloatArray, FloatArray]:
    """Return points of an ellipse, and the ellipse as `kernels.ellipse_through` fills it."""
    while True:
        centre = rng.uniform(-HALF_BOX, HALF_BOX, 2)
        first, second = rng.uniform(0.0, HALF_BOX, 2)
        angle = rng.uniform(0.0, math.pi)
        cosine, sine = math.cos(angle), math.sin(angle)
        reach = np.hypot((first * cosine, first * sine), (second * sine, second * cosine))
        if setup.placement != "whole" or np.all(np.abs(centre) + reach <= HALF_BOX):
            break
    around = rng.uniform(0.0, 2.0 * math.pi, setup.n_inliers)
    u, v = first * np.cos(around), second * np.sin(around)
    points = np.stack(
        (centre[0] + cosine * u - sine * v, centre[1] + sine * u + cosine * v), axis=1
    )
    turn = np.array([[cosine, sine], [-sine, cosine]])
    matrix = turn.T @ np.diag((first**-2.0, second**-2.0)) @ turn
    return points, np.array([*centre, matrix[0, 0], 2.0 * matrix[0, 1], matrix[1, 1]])
