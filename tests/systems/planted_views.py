"""Planted problems with known best models, for the wrapped libraries.

Measurements of a group agree exactly with the group's model; clutter agrees with nothing. Groups
differ little from each other, so that checks which redraw odd samples pass every sample.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

CAMERA = np.array([[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Planted:
    """Two sides of n measurements, in random order, and the group of each (-1: clutter)."""

    x: np.ndarray
    y: np.ndarray
    labels: np.ndarray

    def found(self, mask: np.ndarray | None) -> int | None:
        """Return the group that a mask is, None for anything else."""
        if mask is None or not np.any(mask):
            return None
        mask = np.asarray(mask).ravel().astype(bool)
        label = int(self.labels[np.argmax(mask)])
        return label if label >= 0 and np.array_equal(mask, self.labels == label) else None


def plant(
    kind: str, n_samples: int, sizes: Sequence[int], seed: int, dtype: type = np.float64
) -> Planted:
    """Return a planted problem: ``sizes`` are those of the groups, in order of their labels."""
    rng = np.random.default_rng([seed, n_samples])
    labels = np.full(n_samples, -1)
    labels[: sum(sizes)] = np.repeat(np.arange(len(sizes)), sizes)
    rng.shuffle(labels)
    x, y = _KINDS[kind](labels, rng)
    return Planted(x.astype(dtype), y.astype(dtype), labels)


def _ring(n: int, rng: np.random.Generator) -> np.ndarray:
    angle = 2 * np.pi * (np.arange(n) + 0.4 * rng.random(n) + rng.random()) / n
    points = np.round(512 + 400 * np.column_stack([np.cos(angle), np.sin(angle)]))
    return rng.permutation(points)


def _affine(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    x = _ring(len(labels), rng)
    y = x + np.round(rng.uniform(-4, 4, x.shape) * 1024) / 1024
    for label in range(labels.max() + 1):
        group = labels == label
        linear = np.eye(2) + np.round(rng.uniform(-4, 4, (2, 2)) * 2) / 2048
        y[group] = x[group] @ linear.T + np.round(rng.uniform(-4, 4, 2) * 1024) / 1024
    return x, y


def _similarity(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    x = _ring(len(labels), rng)
    y = x + rng.uniform(-4, 4, x.shape)
    for label in range(labels.max() + 1):
        group = labels == label
        a, b = 1 + rng.uniform(-4, 4) / 1024, rng.uniform(-4, 4) / 1024
        y[group] = x[group] @ np.array([[a, -b], [b, a]]).T + rng.uniform(-4, 4, 2)
    return x, y


def _space(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    x = rng.uniform(-400, 400, (len(labels), 3))
    y = x + rng.uniform(-40, 40, x.shape)
    for label in range(labels.max() + 1):
        group = labels == label
        linear = np.eye(3) + rng.uniform(-0.05, 0.05, (3, 3))
        y[group] = x[group] @ linear.T + rng.uniform(-40, 40, 3)
    return x, y


def _rigid(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    x = rng.uniform(-1, 1, (len(labels), 3))
    y = rng.uniform(-1, 1, x.shape)
    for label in range(labels.max() + 1):
        group = labels == label
        y[group] = x[group] @ _rotation(rng, 3.0).T + rng.uniform(-1, 1, 3)
    return x, y


def _translation(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    x = rng.uniform(-400, 400, (len(labels), 3))
    y = x + rng.uniform(-40, 40, x.shape)
    for label in range(labels.max() + 1):
        y[labels == label] = x[labels == label] + rng.uniform(-40, 40, 3)
    return x, y


def _rotation(rng: np.random.Generator, size: float) -> np.ndarray:
    axis = rng.normal(size=3)
    axis *= size * rng.uniform(0.3, 1.0) / np.linalg.norm(axis)
    angle = float(np.linalg.norm(axis))
    cross = np.cross(np.eye(3), axis / -angle)
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross))


def _project(points: np.ndarray) -> np.ndarray:
    image = points @ CAMERA.T
    return np.asarray(image[:, :2] / image[:, 2:])


def _two_views(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    points = rng.uniform((-2, -2, 4), (2, 2, 8), (len(labels), 3))
    x = _project(points)
    y = _project(points + rng.uniform(-1, 1, points.shape))
    for label in range(labels.max() + 1):
        group = labels == label
        shift = rng.normal(size=3)
        shift *= 1.5 / np.linalg.norm(shift)
        y[group] = _project(points[group] @ _rotation(rng, 0.3).T + shift + (0, 0, 2))
    return x, y


def _pose(labels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    x = rng.uniform(-2, 2, (len(labels), 3))
    y = rng.uniform((0, 0), (640, 480), (len(labels), 2))
    for label in range(labels.max() + 1):
        group = labels == label
        y[group] = _project(x[group] @ _rotation(rng, 1.0).T + (0, 0, rng.uniform(7, 9)))
    return x, y


_KINDS: dict[str, Callable[[np.ndarray, np.random.Generator], tuple[np.ndarray, np.ndarray]]] = {
    "affine": _affine,
    "similarity": _similarity,
    "space": _space,
    "rigid": _rigid,
    "translation": _translation,
    "two views": _two_views,
    "pose": _pose,
}


def chance_of_larger(
    trials: float, q_small: float, q_large: float, most: float = math.inf
) -> float:
    """Return the chance that a run ends with the larger group.

    It runs until `trials` once the smaller one is in hand, and until `most` while nothing is;
    `q_small`, `q_large`: the chances that one trial finds either.
    """
    both = q_small + q_large
    neither = (1 - both) ** trials
    small = (1 - q_large) ** trials - neither
    late = neither - (1 - both) ** most
    return 1 - small - late * q_small / both - (1 - both) ** most


def likelihood_ratio(
    run: Callable[[int], bool], likely: float, unlikely: float, error: float = 1e-4
) -> tuple[bool | None, int, int]:
    """Decide sequentially between two success probabilities (Wald's test).

    Returns whether `likely` it is (None: undecided after 4000 runs), successes and runs.
    """
    bound = math.log((1 - error) / error)
    score, successes = 0.0, 0
    for trial in range(4000):
        success = run(trial)
        successes += success
        if success:
            score += math.log(likely / unlikely)
        else:
            score += math.log((1 - likely) / (1 - unlikely))
        if abs(score) >= bound:
            return score > 0, successes, trial + 1
    return None, successes, 4000
