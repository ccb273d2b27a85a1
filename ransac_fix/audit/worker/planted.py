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

from collections.abc import Callable, Sequence
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
    strata : ndarray of int, shape (n,)
        Stratum of each measurement, such as its camera; all 0 where there is one.
    """

    problem: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    labels: NDArray[np.int64]
    threshold: float
    strata: NDArray[np.int64]

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

    def count(self, inliers: NDArray[np.bool_]) -> tuple[tuple[int, int], ...]:
        """(inliers, measurements) of each stratum."""
        return tuple(
            (int(inliers[self.strata == stratum].sum()), int((self.strata == stratum).sum()))
            for stratum in range(int(self.strata.max()) + 1)
        )


def _grid(values: float | NDArray[np.float64], bits: int) -> NDArray[np.float64]:
    """Round to multiples of 2^-bits, so that sums and products stay exact."""
    return np.asarray(np.round(np.multiply(values, 2.0**bits)) / 2.0**bits)


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
    labels: NDArray[np.int64], rng: np.random.Generator, spread: float, similarity: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    src = _ring(len(labels), rng)
    dst = src + _grid(rng.uniform(-spread, spread, src.shape), 10)
    for label in range(labels.max() + 1):
        linear = np.eye(2) + _grid(rng.uniform(-spread, spread, (2, 2)) / 1024, 11)
        if similarity:
            a, b = linear[0]
            linear = np.array([[a, -b], [b, a]])
        shift = _grid(rng.uniform(-spread, spread, 2), 10)
        dst[labels == label] = src[labels == label] @ linear.T + shift
    return src, dst


def _affine(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _plane_map(labels, rng, 4)


def _affine_wide(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _plane_map(labels, rng, 100)


def _scattered(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Clutter that goes anywhere, as wrong matches do: orders of three points then disagree."""
    src, dst = _plane_map(labels, rng, 4)
    clutter = np.flatnonzero(labels == CLUTTER)
    dst[clutter] = _ring(len(labels), rng)[rng.permutation(len(labels))[: len(clutter)]]
    return src, dst


def _segments(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # Any two of the points make a segment: neighbours would make short ones.
    ends = rng.permutation(2 * len(labels))
    of_ends = np.empty(2 * len(labels), dtype=np.int64)
    of_ends[ends] = np.repeat(labels, 2)
    src, dst = _plane_map(of_ends, rng, 4)
    return src[ends].reshape(-1, 4), dst[ends].reshape(-1, 4)


def _similarity(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _plane_map(labels, rng, 4, similarity=True)


def _translation(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    src = _ring(len(labels), rng)
    dst = src + _grid(rng.uniform(-4, 4, src.shape), 10)
    for label in range(labels.max() + 1):
        dst[labels == label] = src[labels == label] + _grid(rng.uniform(-4, 4, 2), 10)
    return src, dst


def _fundamental(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points on the epipolar lines of a family of matrices for which they are exact.

    The second row of every matrix is (0, 0, 1), so the second coordinate follows from the first
    by sums and products of multiples of powers of two. Its first row times a is its third, up to
    the last column, which makes the rank 2.
    """
    n = len(labels)
    x = 4 * np.round(rng.uniform(30, 200, (n, 2)))
    y = x + 4 * np.round(rng.uniform(-15, 15, (n, 2)))
    for label in range(labels.max() + 1):
        members = labels == label
        a = 2.0**13 * rng.choice([-1, 1])
        f11 = rng.integers(-3, 4) * 2.0**-18
        f13, f33 = _grid(rng.uniform(-0.05, 0.05), 10), _grid(rng.uniform(-30, 30), 4)
        x1, x2 = x[members].T
        y1 = y[members, 0]
        slope = f11 * x1 - x2 / a
        y[members, 1] = -(slope + f13) * y1 - a * slope - f33
    return x, y


FOCAL = 1000.0
CENTRE = 512.0


def _small_rotation(rng: np.random.Generator, angle: float) -> NDArray[np.float64]:
    """Rotate about a random axis by up to an angle, in radians."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    theta = rng.uniform(-angle, angle)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + np.sin(theta) * cross + (1 - np.cos(theta)) * cross @ cross)


def project(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project points in the camera's frame, shape (n, 3), to pixels, shape (n, 2)."""
    return np.asarray(FOCAL * points[:, :2] / points[:, 2:] + CENTRE)


def bearings(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions, of length 1 and shape (n, 3), of pixels in such a camera."""
    rays = np.column_stack([(pixels - CENTRE) / FOCAL, np.ones(len(pixels))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _seen(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return n points in front of a camera at the origin."""
    return rng.uniform([-2, -2, 4], [2, 2, 8], (n, 3))


def _two_views(
    labels: NDArray[np.int64], rng: np.random.Generator, angle: float, distance: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points = _seen(len(labels), rng)
    moved = points + rng.uniform(-0.5, 0.5, points.shape)
    for label in range(labels.max() + 1):
        members = labels == label
        shift = rng.normal(size=3)
        shift *= distance / np.linalg.norm(shift)
        moved[members] = points[members] @ _small_rotation(rng, angle).T + shift
    return project(points), project(moved)


def _essential(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _two_views(labels, rng, angle=0.1, distance=0.5)


def _rotation(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _two_views(labels, rng, angle=0.1, distance=0.0)


def _translation_direction(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _two_views(labels, rng, angle=0.0, distance=0.5)


def _one_view(
    labels: NDArray[np.int64], rng: np.random.Generator, angle: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points = _seen(len(labels), rng)
    moved = points + rng.uniform(-0.3, 0.3, points.shape)
    for label in range(labels.max() + 1):
        members = labels == label
        rotation = _small_rotation(rng, angle)
        moved[members] = points[members] @ rotation.T + rng.uniform(-0.2, 0.2, 3)
    return points, project(moved)


def _absolute_pose(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _one_view(labels, rng, angle=0.05)


def _absolute_position(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _one_view(labels, rng, angle=0.0)


def _solid(
    labels: NDArray[np.int64], rng: np.random.Generator, scaled: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    src = np.round(rng.uniform(-500, 500, (len(labels), 3)))
    dst = src + rng.uniform(-60, 60, src.shape)
    for label in range(labels.max() + 1):
        members = labels == label
        scale = rng.uniform(0.9, 1.1) if scaled else 1.0
        moved = scale * src[members] @ _small_rotation(rng, 0.1).T
        dst[members] = moved + rng.uniform(-20, 20, 3)
    return src, dst


def _rigid3d(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _solid(labels, rng, scaled=False)


def _similarity3d(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return _solid(labels, rng, scaled=True)


def _affine3d(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    src = np.round(rng.uniform(-500, 500, (len(labels), 3)))
    dst = src + _grid(rng.uniform(-60, 60, src.shape), 8)
    for label in range(labels.max() + 1):
        members = labels == label
        linear = np.eye(3) + _grid(rng.uniform(-0.1, 0.1, (3, 3)), 8)
        dst[members] = src[members] @ linear.T + _grid(rng.uniform(-20, 20, 3), 8)
    return src, dst


def _translation3d(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    src = np.round(rng.uniform(-500, 500, (len(labels), 3)))
    dst = src + _grid(rng.uniform(-60, 60, src.shape), 8)
    for label in range(labels.max() + 1):
        dst[labels == label] = src[labels == label] + _grid(rng.uniform(-60, 60, 3), 8)
    return src, dst


def _plane(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points = np.round(rng.uniform(-500, 500, (len(labels), 3)))
    for label in range(labels.max() + 1):
        members = labels == label
        slope_x, slope_y, height = _grid(rng.uniform([-0.5, -0.5, -300], [0.5, 0.5, 300]), 8)
        points[members, 2] = slope_x * points[members, 0] + slope_y * points[members, 1] + height
    return points, np.empty((len(labels), 0))


def _plane_patch(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points, nothing = _plane(labels, rng)
    for label in range(labels.max() + 1):
        members = labels == label
        slope_x, slope_y, height = _grid(rng.uniform([-0.5, -0.5, -300], [0.5, 0.5, 300]), 8)
        corner = rng.choice([-450, 250], 2)
        points[members, :2] = corner + np.round(rng.uniform(0, 200, (members.sum(), 2)))
        points[members, 2] = slope_x * points[members, 0] + slope_y * points[members, 1] + height
    return points, nothing


def _line3d(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points = np.round(rng.uniform(-500, 500, (len(labels), 3)))
    for label in range(labels.max() + 1):
        members = labels == label
        along = points[members, :1]
        slope, offset = _grid(rng.uniform([[-1, -1], [-300, -300]], [[1, 1], [300, 300]]), 8)
        points[members, 1:] = slope * along + offset
    return points, np.empty((len(labels), 0))


def _round(
    directions: NDArray[np.float64], labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Put points in these directions, those of a group on one circle or sphere."""
    n, dimensions = directions.shape
    points = directions * rng.uniform(100, 700, (n, 1))
    for label in range(labels.max() + 1):
        members = labels == label
        centre = rng.uniform(-30, 30, dimensions)
        points[members] = directions[members] * rng.uniform(370, 430) + centre
    return points, np.empty((n, 0))


def _circle(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    n = len(labels)
    angle = 2 * np.pi * (np.arange(n) + 0.4 * rng.random(n) + rng.random()) / n
    return _round(np.column_stack([np.cos(angle), np.sin(angle)]), labels, rng)


def _sphere(
    labels: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    directions = rng.normal(size=(len(labels), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return _round(directions, labels, rng)


def rig(n_cameras: int) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the rotation and the shift that bring points of a rig into each of its cameras.

    Parameters
    ----------
    n_cameras : int
        How many.
    """
    poses = []
    for number in range(n_cameras):
        angle = 0.125 * number
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        centre = np.array([0.75 * number, 0.25 * (number % 2), 0])
        poses.append((rotation, -rotation @ centre))
    return poses


def _in_cameras(points: NDArray[np.float64], strata: NDArray[np.int64]) -> NDArray[np.float64]:
    """Project points of a rig to the pixels of the camera that sees each."""
    pixels = np.empty((len(points), 2))
    for number, (rotation, shift) in enumerate(rig(int(strata.max()) + 1)):
        seen = strata == number
        pixels[seen] = project(points[seen] @ rotation.T + shift)
    return pixels


def _rig_absolute_pose(
    labels: NDArray[np.int64], rng: np.random.Generator, strata: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points = _seen(len(labels), rng)
    moved = points + rng.uniform(-0.3, 0.3, points.shape)
    for label in range(labels.max() + 1):
        members = labels == label
        rotation = _small_rotation(rng, 0.05)
        moved[members] = points[members] @ rotation.T + rng.uniform(-0.2, 0.2, 3)
    return points, _in_cameras(moved, strata)


def _point_line_pose(
    labels: NDArray[np.int64], rng: np.random.Generator, strata: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points, then lines by two of their points; of a point both are the same."""
    start = _seen(len(labels), rng)
    start_seen = project(start + rng.uniform(-0.3, 0.3, start.shape))
    end = start + rng.uniform(-1, 1, start.shape)
    end_seen = start_seen + rng.uniform(-100, 100, start_seen.shape)
    for label in range(labels.max() + 1):
        members = np.flatnonzero(labels == label)
        rotation, shift = _small_rotation(rng, 0.05), rng.uniform(-0.2, 0.2, 3)
        start_seen[members] = project(start[members] @ rotation.T + shift)
        end_seen[members] = project(end[members] @ rotation.T + shift)
    points = strata == 0
    end[points], end_seen[points] = start[points], start_seen[points]
    return np.hstack([start, end]), np.hstack([start_seen, end_seen])


def _rig_relative_pose(
    labels: NDArray[np.int64], rng: np.random.Generator, strata: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    points = _seen(len(labels), rng)
    moved = points + rng.uniform(-0.5, 0.5, points.shape)
    for label in range(labels.max() + 1):
        members = labels == label
        shift = rng.normal(size=3)
        shift *= 0.5 / np.linalg.norm(shift)
        moved[members] = points[members] @ _small_rotation(rng, 0.3).T + shift
    return _in_cameras(points, strata), _in_cameras(moved, strata)


Maker = Callable[
    ["NDArray[np.int64]", np.random.Generator], "tuple[NDArray[np.float64], NDArray[np.float64]]"
]

# name -> (maker, threshold). Coordinates are pixels where they are two, else units of length.
PROBLEMS: dict[str, tuple[Maker, float]] = {
    # y = a x + b; x (n, 1), y (n, 1)
    "line": (_line, 1e-6),
    # a x = d; x (n, 3), y (n, 0)
    "plane": (_plane, 1e-3),
    # with the points of each group close together
    "plane_patch": (_plane_patch, 1e-3),
    # |x - c| = r; x (n, 2), y (n, 0)
    "circle": (_circle, 0.01),
    # and in space; x (n, 3), y (n, 0)
    "line3d": (_line3d, 1e-3),
    "sphere": (_sphere, 0.01),
    # image to image; x (n, 2), y (n, 2)
    "translation": (_translation, 0.01),
    "similarity": (_similarity, 0.01),
    "affine": (_affine, 0.01),
    # An affine map is a homography too, and one that single precision holds exactly.
    "homography": (_affine, 0.01),
    # the same with clutter that a check of a sample's shape rejects now and then
    "affine_scattered": (_scattered, 0.01),
    "homography_scattered": (_scattered, 0.01),
    # the same for segments by their two ends; x (n, 4), y (n, 4)
    "segments": (_segments, 0.01),
    # with clutter far off, for scores that reach beyond the threshold
    "affine_wide": (_affine_wide, 0.5),
    "homography_wide": (_affine_wide, 0.5),
    "fundamental_wide": (_fundamental, 0.5),
    "fundamental": (_fundamental, 1e-3),
    # the same with cameras of FOCAL and CENTRE
    "essential": (_essential, 1e-3),
    # world to image; x (n, 3), y (n, 2), with such a camera
    "absolute_pose": (_absolute_pose, 0.02),
    # the same by cameras whose rotation is known: the identity
    "absolute_position": (_absolute_position, 0.02),
    # image to image between cameras that only rotate, or whose rotation is the identity
    "rotation": (_rotation, 0.02),
    "translation_direction": (_translation_direction, 1e-3),
    # space to space; x (n, 3), y (n, 3)
    "translation3d": (_translation3d, 0.01),
    "rigid3d": (_rigid3d, 0.01),
    "similarity3d": (_similarity3d, 0.01),
    "affine3d": (_affine3d, 0.01),
}

RigMaker = Callable[
    ["NDArray[np.int64]", np.random.Generator, "NDArray[np.int64]"],
    "tuple[NDArray[np.float64], NDArray[np.float64]]",
]

# The same with strata that matter: cameras of a rig as `rig` makes them, pairs of cameras of one
# number, or kinds of measurement.
RIG_PROBLEMS: dict[str, tuple[RigMaker, float]] = {
    # world to image; x (n, 3), y (n, 2) in the measurement's camera
    "rig_absolute_pose": (_rig_absolute_pose, 0.02),
    # image to image; x (n, 2) in the camera of one rig, y (n, 2) in that of another
    "rig_relative_pose": (_rig_relative_pose, 1e-3),
    # world to image, points (stratum 0) and lines (1) by two points; x (n, 6), y (n, 4)
    "point_line_pose": (_point_line_pose, 0.02),
}


def evenly(n_samples: int, group_size: int, larger: int, n_strata: int) -> list[tuple[int, ...]]:
    """Return the strata of `plant` that share everything as evenly as can be."""
    return [
        tuple(
            (total + n_strata - 1 - number) // n_strata for total in (n_samples, group_size, larger)
        )
        for number in range(n_strata)
    ]


def plant(
    problem: str,
    n_samples: int,
    group_size: int,
    n_groups: int,
    larger: int,
    seed: int,
    *,
    first: str = "anything",
    strata: Sequence[Sequence[int]] = (),
) -> Planted:
    """Make a planted problem.

    Parameters
    ----------
    problem : str
        Key of ``PROBLEMS`` or ``RIG_PROBLEMS``.
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
    strata : sequence of (n, A, B), optional
        How many of all measurements, of each A and of B each stratum holds; one stratum holds
        everything if left out.

    Returns
    -------
    Planted

    Raises
    ------
    ValueError
        If the groups do not fit into ``n_samples``, or the strata do not add up.
    """
    sizes = [group_size] * n_groups + ([larger] if larger else [])
    if sum(sizes) > n_samples:
        raise ValueError(f"groups of {sizes} do not fit into {n_samples} measurements")
    parts = [tuple(part) for part in strata] or [(n_samples, group_size, larger)]
    if tuple(map(sum, zip(*parts, strict=True))) != (n_samples, group_size, larger):
        raise ValueError(f"strata {parts} do not add up to {(n_samples, group_size, larger)}")
    rng = np.random.default_rng([seed, n_samples, group_size])
    labels = np.full(n_samples, CLUTTER, dtype=np.int64)
    stratum = np.repeat(np.arange(len(parts)), [part[0] for part in parts])
    for number, (n, smaller, most) in enumerate(parts):
        of_groups = np.repeat(np.arange(len(sizes)), [smaller] * n_groups + [most] * bool(larger))
        if len(of_groups) > n:
            raise ValueError(f"the groups do not fit into stratum {number} of {parts}")
        labels[np.flatnonzero(stratum == number)[: len(of_groups)]] = of_groups
    # Where a measurement lies must not depend on its group.
    shuffled = rng.permutation(n_samples)
    labels, stratum = labels[shuffled], stratum[shuffled]
    if problem in RIG_PROBLEMS:
        rig_maker, threshold = RIG_PROBLEMS[problem]
        x, y = rig_maker(labels, rng, stratum)
    else:
        maker, threshold = PROBLEMS[problem]
        x, y = maker(labels, rng)
    order = rng.permutation(n_samples)
    if first != "anything":
        clutter = labels[order] == CLUTTER
        order = order[np.argsort(clutter if first == "groups" else ~clutter, kind="stable")]
    return Planted(problem, x[order], y[order], labels[order], threshold, stratum[order])
