"""An affine map of the plane."""

from collections.abc import Sequence

import numpy as np

from ransac_fix.reference.interface import FloatArray
from ransac_fix.reference.models.geometry import centre_and_scale, doubled_area, is_flat


class Affine:
    """An invertible affine map between two images from 3 matches.

    A model is an array of shape (2, 3): ``(x', y') = A (x, y, 1)``. Data are matches
    ``(x, y, x', y')``; the residual is the distance in the second image between the match and
    the mapped point.
    """

    sample_size = 3
    n_columns = 4

    def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
        """Return the affine map of three matches, nothing if collinear in either image.

        Parameters
        ----------
        sample : ndarray of shape (3, 4)

        Returns
        -------
        sequence of ndarray of shape (2, 3)
        """
        p, q, r = sample.tolist()
        if is_flat(p, q, r) or is_flat(p[2:], q[2:], r[2:]):
            return ()
        area = doubled_area(p, q, r)
        x1, y1, x2, y2 = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
        rows = []
        for axis in (2, 3):
            first, second = q[axis] - p[axis], r[axis] - p[axis]
            a = (first * y2 - second * y1) / area
            b = (second * x1 - first * x2) / area
            rows.append((a, b, p[axis] - a * p[0] - b * p[1]))
        return (np.array(rows),)

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        """Return the transfer error of every match, shape (n,), in the second image's unit."""
        x, y = (data[:, :2] @ model[:, :2].T + model[:, 2] - data[:, 2:]).T
        distances: FloatArray = np.hypot(x, y)
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        """Return the affine map with the least sum of squared transfer errors.

        Parameters
        ----------
        data : ndarray of shape (n, 4)

        Returns
        -------
        ndarray of shape (2, 3) or None
            None if the points of the first image are collinear or fewer than three.
        """
        if len(data) < self.sample_size:
            return None
        centre, scale = centre_and_scale(data[:, :2])
        rows = np.column_stack(((data[:, :2] - centre) / scale, np.ones(len(data))))
        solution, _, rank, _ = np.linalg.lstsq(rows, data[:, 2:], rcond=1e-9)
        if rank < self.sample_size:
            return None
        linear = solution[:2].T / scale
        return np.column_stack((linear, solution[2] - linear @ centre))
