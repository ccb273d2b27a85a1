"""A line in the plane."""

import math
from collections.abc import Sequence

import numpy as np

from ransac_fix.reference.interface import FloatArray


class Line:
    """A line in the plane through 2 points.

    A model is an array ``(a, b, c)`` with ``a x + b y + c = 0`` and ``a**2 + b**2 = 1``; its sign
    is arbitrary. Data are points ``(x, y)``; the residual is the distance to the line.
    """

    sample_size = 2
    n_columns = 2

    def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
        """Return the line through two points, nothing if they coincide.

        Parameters
        ----------
        sample : ndarray of shape (2, 2)

        Returns
        -------
        sequence of ndarray of shape (3,)
        """
        (x1, y1), (x2, y2) = sample.tolist()
        length = math.hypot(x2 - x1, y2 - y1)
        if length == 0.0:
            return ()
        a, b = (y1 - y2) / length, (x2 - x1) / length
        return (np.array((a, b, -(a * x1 + b * y1))),)

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        """Return the distance of every point to the line, shape (n,), in the data's unit."""
        distances: FloatArray = np.abs(data @ model[:2] + model[2])
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        """Return the line with the least sum of squared distances.

        Parameters
        ----------
        data : ndarray of shape (n, 2)

        Returns
        -------
        ndarray of shape (3,) or None
            None if the points coincide or are fewer than two.
        """
        if len(data) < self.sample_size:
            return None
        centre = data.mean(axis=0)
        _, spread, axes = np.linalg.svd(data - centre, full_matrices=False)
        if spread[0] == 0.0:
            return None
        normal = axes[1]
        return np.append(normal, -(normal @ centre))
