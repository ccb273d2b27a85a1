"""A circle in the plane."""

import math
from collections.abc import Sequence

import numpy as np

from ransac_fix.reference.interface import FloatArray
from ransac_fix.reference.models.geometry import centre_and_scale, doubled_area, is_flat
from ransac_fix.reference.models.least_squares import minimise


class Circle:
    """A circle in the plane through 3 points.

    A model is an array ``(centre x, centre y, radius)``. Data are points ``(x, y)``; the residual
    is the distance to the circle.
    """

    sample_size = 3
    n_columns = 2

    def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
        """Return the circle through three points, nothing if they are collinear.

        Parameters
        ----------
        sample : ndarray of shape (3, 2)

        Returns
        -------
        sequence of ndarray of shape (3,)
        """
        p, q, r = sample.tolist()
        if is_flat(p, q, r):
            return ()
        # The centre, from p, has equal distance to p, q and r.
        x1, y1, x2, y2 = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
        square1, square2 = x1 * x1 + y1 * y1, x2 * x2 + y2 * y2
        twice = 2.0 * doubled_area(p, q, r)
        x = (y2 * square1 - y1 * square2) / twice
        y = (x1 * square2 - x2 * square1) / twice
        return (np.array((p[0] + x, p[1] + y, math.hypot(x, y))),)

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        """Return the distance of every point to the circle, shape (n,), in the data's unit."""
        x, y = (data - model[:2]).T
        distances: FloatArray = np.abs(np.hypot(x, y) - model[2])
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        """Return the circle with the least sum of squared distances.

        Parameters
        ----------
        data : ndarray of shape (n, 2)

        Returns
        -------
        ndarray of shape (3,) or None
            None if the points are collinear or fewer than three.

        Notes
        -----
        Starts from the algebraic fit (Kasa): ``x**2 + y**2`` as a linear function of x and y.
        """
        if len(data) < self.sample_size:
            return None
        centre, scale = centre_and_scale(data)
        points = (data - centre) / scale
        rows = np.column_stack((2.0 * points, np.ones(len(points))))
        squares = np.sum(points**2, axis=1)
        solution, _, rank, _ = np.linalg.lstsq(rows, squares, rcond=1e-9)
        if rank < 3:
            return None
        square = float(solution[2] + solution[:2] @ solution[:2])
        start = np.append(solution[:2], math.sqrt(square))

        def distances(circle: FloatArray) -> tuple[FloatArray, FloatArray]:
            offsets = points - circle[:2]
            from_centre = np.hypot(*offsets.T)
            directions = offsets / np.maximum(from_centre, 1e-300)[:, None]
            return from_centre - circle[2], np.column_stack((-directions, -np.ones(len(points))))

        circle = minimise(distances, start)
        x, y, radius = (circle * scale).tolist()
        return np.array((x + centre[0], y + centre[1], abs(radius)))
