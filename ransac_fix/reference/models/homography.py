"""A homography between two images."""

import math
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
        areas1, areas2 = _areas(source), _areas(target)
        if areas1 is None or areas2 is None:
            return ()
        # With P_i the points relative to the fourth and u_i the areas opposite them, the map from
        # the basis has the columns u_i P_i. So H = sum over i of (v_i / u_i) Q_i times row i of
        # the inverse of (P_1 P_2 P_3).
        (x1, y1), (x2, y2), (x3, y3), (x4, y4) = source
        (p1, q1), (p2, q2), (p3, q3), (p4, q4) = target
        w1, w2, w3 = (v / u for v, u in zip(areas2, areas1, strict=True))
        x1, y1, x2, y2, x3, y3 = x1 - x4, y1 - y4, x2 - x4, y2 - y4, x3 - x4, y3 - y4
        a = (w1 * (y2 - y3), w2 * (y3 - y1), w3 * (y1 - y2))
        b = (w1 * (x3 - x2), w2 * (x1 - x3), w3 * (x2 - x1))
        c = (w1 * (x2 * y3 - x3 * y2), w2 * (x3 * y1 - x1 * y3), w3 * (x1 * y2 - x2 * y1))
        p1, p2, p3, q1, q2, q3 = p1 - p4, p2 - p4, p3 - p4, q1 - q4, q2 - q4, q3 - q4
        rows = []
        for t1, t2, t3 in ((p1, p2, p3), (q1, q2, q3), (1.0, 1.0, 1.0)):
            rows.append(tuple(t1 * m[0] + t2 * m[1] + t3 * m[2] for m in (a, b, c)))
        # From coordinates relative to the fourth points to those of the images.
        (a1, b1, c1), (a2, b2, c2), (a3, b3, c3) = rows
        a1, b1, c1 = a1 + p4 * a3, b1 + p4 * b3, c1 + p4 * c3
        a2, b2, c2 = a2 + q4 * a3, b2 + q4 * b3, c2 + q4 * c3
        h = np.array(
            (
                (a1, b1, c1 - a1 * x4 - b1 * y4),
                (a2, b2, c2 - a2 * x4 - b2 * y4),
                (a3, b3, c3 - a3 * x4 - b3 * y4),
            )
        )
        return (_normalised(h),)

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
        triangle = np.linalg.qr(equations, mode="r")  # same null space, however many matches
        _, spread, rows = np.linalg.svd(triangle)
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


def _areas(points: list[Point]) -> tuple[float, float, float] | None:
    """Return the doubled areas of the triangles opposite points 1, 2 and 3.

    They are the barycentric coordinates of the fourth point up to a common factor. None if any
    three of the points are collinear.
    """
    p, q, r, o = points
    if is_flat(p, q, r) or is_flat(q, r, o) or is_flat(r, p, o) or is_flat(p, q, o):
        return None
    return doubled_area(q, r, o), doubled_area(r, p, o), doubled_area(p, q, o)


def _normalised(h: FloatArray) -> FloatArray:
    norm = math.sqrt(float(np.vdot(h, h)))
    return h / (norm if h[2, 2] >= 0.0 else -norm)
