"""A homography between two images."""

import itertools
from collections.abc import Sequence

import numpy as np

from ransac_fix.reference.interface import FloatArray
from ransac_fix.reference.models.geometry import (
    Point,
    centre_and_scale,
    doubled_area,
    is_flat,
)
from ransac_fix.reference.models.least_squares import minimise


class Homography:
    """A homography between two images from 4 matches.

    A model is an array of shape (3, 3), ``(x', y', 1) ~ H (x, y, 1)``, of Frobenius norm 1
    with a last entry that is not negative. Data are matches ``(x, y, x', y')``; the residual is
    the distance in the second image between the match and the mapped point (infinite where the
    point maps to infinity).
    """

    sample_size = 4
    n_columns = 4

    def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
        """Return the homography of four matches.

        Parameters
        ----------
        sample : ndarray of shape (4, 4)

        Returns
        -------
        sequence of ndarray of shape (3, 3)
            Nothing if three of the points are collinear in either image.

        Notes
        -----
        With the fourth point as origin, each image is mapped to the projective basis of its four
        points; the homography is one map followed by the inverse of the other.
        """
        matches = sample.tolist()
        source, target = [m[:2] for m in matches], [m[2:] for m in matches]
        for a, b, c in itertools.combinations(range(4), 3):
            if is_flat(source[a], source[b], source[c]) or is_flat(target[a], target[b], target[c]):
                return ()
        # Coordinates relative to the fourth point keep the digits of images far from the origin.
        basis1, basis2 = _basis(source), _basis(target)
        local = basis2 @ _adjugate(basis1)
        origin1, origin2 = source[3], target[3]
        # H = T(origin2) local T(-origin1), where T translates.
        local[:, 2] -= local[:, 0] * origin1[0] + local[:, 1] * origin1[1]
        local[0] += local[2] * origin2[0]
        local[1] += local[2] * origin2[1]
        return (_normalised(local),)

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        """Return the transfer error of every match, shape (n,), in the second image's unit."""
        x, y, w = model[:, :2] @ data[:, :2].T + model[:, 2:]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            distances: FloatArray = np.hypot(x / w - data[:, 2], y / w - data[:, 3])
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        """Return the homography with a least sum of squared transfer errors.

        Parameters
        ----------
        data : ndarray of shape (n, 4)

        Returns
        -------
        ndarray of shape (3, 3) or None
            None if fewer than four matches, or they do not determine a homography.

        Notes
        -----
        Starts from the normalised direct linear transform; Hartley and Zisserman, "Multiple View
        Geometry", section 4.4.
        """
        if len(data) < self.sample_size:
            return None
        centre1, scale1 = centre_and_scale(data[:, :2])
        centre2, scale2 = centre_and_scale(data[:, 2:])
        x1, y1 = ((data[:, :2] - centre1) / scale1).T
        x2, y2 = ((data[:, 2:] - centre2) / scale2).T
        one, zero = np.ones(len(data)), np.zeros(len(data))
        points = np.column_stack((x1, y1, one))
        nothing = np.column_stack((zero, zero, zero))
        equations = np.vstack(
            (
                np.column_stack((points, nothing, -x2[:, None] * points)),
                np.column_stack((nothing, points, -y2[:, None] * points)),
            )
        )
        _, spread, rows = np.linalg.svd(equations, full_matrices=True)
        if spread[7] <= 1e-9 * spread[0]:
            return None

        def transfer(entries: FloatArray) -> tuple[FloatArray, FloatArray]:
            x, y, w = entries.reshape(3, 3) @ points.T
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                x, y, over = x / w, y / w, points / w[:, None]
                jacobian = np.vstack(
                    (
                        np.column_stack((over, nothing, -x[:, None] * over)),
                        np.column_stack((nothing, over, -y[:, None] * over)),
                    )
                )
                return np.concatenate((x - x2, y - y2)), jacobian

        h = minimise(transfer, rows[8]).reshape(3, 3)
        to_local = np.array(((1.0, 0.0, -centre1[0]), (0.0, 1.0, -centre1[1]), (0.0, 0.0, scale1)))
        from_local = np.array(
            ((scale2, 0.0, centre2[0]), (0.0, scale2, centre2[1]), (0.0, 0.0, 1.0))
        )
        return _normalised(from_local @ h @ to_local)


def _basis(points: list[Point]) -> FloatArray:
    """Return the map from the projective basis to four points, the fourth taken as origin.

    Its columns are the first three points, weighted so that they add up to the fourth.
    """
    p, q, r, o = points
    # Barycentric coordinates of the origin, up to a common factor.
    u, v, w = doubled_area(q, r, o), doubled_area(r, p, o), doubled_area(p, q, o)
    return np.array(
        (
            (u * (p[0] - o[0]), v * (q[0] - o[0]), w * (r[0] - o[0])),
            (u * (p[1] - o[1]), v * (q[1] - o[1]), w * (r[1] - o[1])),
            (u, v, w),
        )
    )


def _adjugate(m: FloatArray) -> FloatArray:
    """Return the inverse of a 3 x 3 matrix up to scale."""
    (a, b, c), (d, e, f), (g, h, i) = m.tolist()
    return np.array(
        (
            (e * i - f * h, c * h - b * i, b * f - c * e),
            (f * g - d * i, a * i - c * g, c * d - a * f),
            (d * h - e * g, b * g - a * h, a * e - b * d),
        )
    )


def _normalised(h: FloatArray) -> FloatArray:
    norm = float(np.sqrt(np.sum(h * h)))
    return h / (norm if h[2, 2] >= 0.0 else -norm)
