"""Planted problems: small data sets in which the best models and their counts are known.

Every problem holds some groups of ``group_size`` measurements (A), one group of one more (B) and
clutter. Members of a group agree exactly with their group's model, so the consensus of a run can
only be a minimal sample with what it happens to meet, an A or the B.

Measurements of different groups differ little: all of them lie close to one common motion. Checks
that reject odd samples before they count as trials (orientation, collinearity) then pass every
sample, and the draws can be told from the filter. Coordinates are exact in single precision, so
the agreement is exact in libraries that convert to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

CLUTTER = -1


@dataclass(frozen=True)
class Planted:
    """One planted problem, its measurements in random order.

    Attributes
    ----------
    problem : str
        Key of ``PROBLEMS``.
    x, y : ndarray, shape (n, d_x) and (n, d_y)
        The two sides of each measurement; what they mean depends on the problem.
    labels : ndarray of int, shape (n,)
        Group of each measurement, ``CLUTTER`` for none. The B group has the highest label.
    threshold : float
        Residual below which a measurement agrees, in the units of the data.
    """

    problem: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    labels: NDArray[np.int64]
    threshold: float

    @property
    def n_samples(self) -> int:
        """Number of measurements."""
        return len(self.labels)

    def group_of(self, inliers: NDArray[np.bool_] | None) -> int | None:
        """Label of the group that the inliers are exactly, or None."""
        if inliers is None or not inliers.any():
            return None
        label = int(self.labels[int(np.argmax(inliers))])
        if label == CLUTTER or not np.array_equal(inliers, self.labels == label):
            return None
        return label


def _grid(values: NDArray[np.float64], bits: int) -> NDArray[np.float64]:
    """Round to multiples of 2^-bits, so that sums and products stay exact."""
    return np.asarray(np.round(values * 2.0**bits) / 2.0**bits)


def _ring(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return n integer points near a circle: no three on a line, none close to another."""
    angle = 2 * np.pi * (np.arange(n) + 0.4 * rng.random(n) + rng.random()) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(np.round(512 + 400 * circle))


def _line(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    n = len(labels)
    x = rng.permutation(np.arange(1, 4 * n + 1))[:n].astype(np.float64)
    y = _grid(rng.uniform(-200, 200, n), 10)
    for label in range(labels.max() + 1):
        slope, offset = _grid(rng.uniform(-2, 2, 2), 10)
        y[labels == label] = slope * x[labels == label] + offset
    return x[:, None], y[:, None]


def _plane_map(
    labels: NDArray[np.int64], rng: np.random.Generator, similarity: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    src = _ring(len(labels), rng)
    dst = src + _grid(rng.uniform(-4, 4, src.shape), 10)
    for label in range(labels.max() + 1):
        linear = np.eye(2) + _grid(rng.uniform(-4, 4, (2, 2)) / 1024, 11)
        if similarity:
            a, b = linear[0]
            linear = np.array([[a, -b], [b, a]])
        dst[labels == label] = src[labels == label] @ linear.T + _grid(rng.uniform(-4, 4, 2), 10)
    return src, dst


def _affine(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _plane_map(labels, rng, similarity=False)


def _similarity(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _plane_map(labels, rng, similarity=True)


Maker = Callable[
    ["NDArray[np.int64]", np.random.Generator], "tuple[NDArray[np.float64], NDArray[np.float64]]"
]

# name -> (maker, threshold)
PROBLEMS: dict[str, tuple[Maker, float]] = {
    # y = a x + b; x (n, 1), y (n, 1)
    "line": (_line, 1e-6),
    # plane to plane in pixels; x (n, 2), y (n, 2). An affine map is a homography too, and one
    # that single precision holds exactly.
    "affine": (_affine, 0.01),
    "homography": (_affine, 0.01),
    "similarity": (_similarity, 0.01),
}


def plant(
    problem: str,
    n_samples: int,
    group_size: int,
    n_groups: int,
    larger: int,
    seed: int,
    *,
    first: str = "anything",
) -> Planted:
    """Make a planted problem.

    Parameters
    ----------
    problem : str
        Key of ``PROBLEMS``.
    n_samples : int
        n, the number of measurements.
    group_size : int
        m_A, the size of each A group.
    n_groups : int
        How many A groups.
    larger : int
        Size of the B group; 0 for none.
    seed : int
        Fixes the data and their order.
    first : {"anything", "groups", "clutter"}
        What comes first in the order of the measurements.

    Returns
    -------
    Planted

    Raises
    ------
    ValueError
        If the groups do not fit into ``n_samples``.
    """
    sizes = [group_size] * n_groups + ([larger] if larger else [])
    if sum(sizes) > n_samples:
        raise ValueError(f"groups of {sizes} do not fit into {n_samples} measurements")
    rng = np.random.default_rng([seed, n_samples, group_size])
    labels = np.full(n_samples, CLUTTER, dtype=np.int64)
    labels[: sum(sizes)] = np.repeat(np.arange(len(sizes)), sizes)
    # Where a measurement lies must not depend on its group.
    rng.shuffle(labels)
    maker, threshold = PROBLEMS[problem]
    x, y = maker(labels, rng)
    order = rng.permutation(n_samples)
    if first != "anything":
        clutter = labels[order] == CLUTTER
        order = order[np.argsort(clutter if first == "groups" else ~clutter, kind="stable")]
    return Planted(problem, x[order], y[order], labels[order], threshold)
