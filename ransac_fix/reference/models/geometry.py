"""Small geometry that several models share."""

import math
from typing import TypeAlias

import numpy as np

from ransac_fix.reference.interface import FloatArray

Point: TypeAlias = list[float]

# A triangle with less area than this, in units of its longest side squared, is degenerate: far
# above rounding, far below what any measurement would be trusted with.
FLAT = 1e-10


def doubled_area(p: Point, q: Point, r: Point) -> float:
    """Return twice the signed area of a triangle in the plane."""
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def is_flat(p: Point, q: Point, r: Point) -> bool:
    """Return whether three points in the plane are collinear or coincide, at any scale."""
    x1, y1, x2, y2 = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
    x3, y3 = x2 - x1, y2 - y1
    longest = max(x1 * x1 + y1 * y1, x2 * x2 + y2 * y2, x3 * x3 + y3 * y3)
    return abs(x1 * y2 - y1 * x2) <= FLAT * longest


def centre_and_scale(points: FloatArray) -> tuple[FloatArray, float]:
    """Return the centroid of points and their root mean square distance from it.

    Parameters
    ----------
    points : ndarray of shape (n, dimensions)

    Returns
    -------
    centre : ndarray of shape (dimensions,)
    scale : float
        1 where all points coincide.
    """
    centre: FloatArray = points.mean(axis=0)
    scale = math.sqrt(float(np.mean(np.sum((points - centre) ** 2, axis=1))))
    return centre, scale or 1.0
