"""A plane in space."""

import math
from collections.abc import Sequence

import numpy as np

from ransac_fix.reference.interface import FloatArray
from ransac_fix.reference.models.geometry import FLAT


class Plane:
    """A plane in space through 3 points.

    A model is an array ``(a, b, c, d)`` with ``a x + b y + c z + d = 0`` and a unit normal
    ``(a, b, c)``; its sign is arbitrary. Data are points ``(x, y, z)``; the residual is the
    distance to the plane.
    """

    sample_size = 3
    n_columns = 3

    def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
        """Return the plane through three points, nothing if they are collinear.

        Parameters
        ----------
        sample : ndarray of shape (3, 3)

        Returns
        -------
        sequence of ndarray of shape (4,)
        """
        (x, y, z), (x1, y1, z1), (x2, y2, z2) = sample.tolist()
        x1, y1, z1 = x1 - x, y1 - y, z1 - z
        x2, y2, z2 = x2 - x, y2 - y, z2 - z
        a, b, c = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
        area = math.hypot(a, b, c)
        x3, y3, z3 = x2 - x1, y2 - y1, z2 - z1
        longest = max(
            x1 * x1 + y1 * y1 + z1 * z1,
            x2 * x2 + y2 * y2 + z2 * z2,
            x3 * x3 + y3 * y3 + z3 * z3,
        )
        if area <= FLAT * longest:
            return ()
        a, b, c = a / area, b / area, c / area
        return (np.array((a, b, c, -(a * x + b * y + c * z))),)

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        """Return the distance of every point to the plane, shape (n,), in the data's unit."""
        distances: FloatArray = np.abs(data @ model[:3] + model[3])
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        """Return the plane with the least sum of squared distances.

        Parameters
        ----------
        data : ndarray of shape (n, 3)

        Returns
        -------
        ndarray of shape (4,) or None
            None if the points are collinear or fewer than three.
        """
        if len(data) < self.sample_size:
            return None
        centre = data.mean(axis=0)
        _, spread, axes = np.linalg.svd(data - centre, full_matrices=False)
        if spread[1] <= FLAT * spread[0]:
            return None
        normal = axes[2]
        return np.append(normal, -(normal @ centre))
