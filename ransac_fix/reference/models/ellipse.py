"""An ellipse in the plane."""

import math
from collections.abc import Sequence

import numpy as np

from ransac_fix.reference.interface import FloatArray
from ransac_fix.reference.models.geometry import centre_and_scale
from ransac_fix.reference.models.least_squares import minimise

# Conics through five points are unique above this ratio of singular values, and ellipses rather
# than parabolas above this discriminant (of a conic of norm 1 in centred, scaled coordinates).
_UNIQUE = 1e-10
_ROUND = 1e-10


class Ellipse:
    """An ellipse in the plane through 5 points.

    A model is an array ``(centre x, centre y, a, b, angle)``: semi-axes ``a >= b > 0``, and the
    angle of the first from the x axis in radians, from -pi/2 to pi/2. Data are points ``(x, y)``;
    the residual is the orthogonal distance to the ellipse, to full precision rather than the
    first-order (Sampson) one.
    """

    sample_size = 5
    n_columns = 2

    def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
        """Return the ellipse through five points.

        Parameters
        ----------
        sample : ndarray of shape (5, 2)

        Returns
        -------
        sequence of ndarray of shape (5,)
            Nothing if the conic through the points is not unique (four of them are collinear, or
            two coincide) or no ellipse.
        """
        centre, scale = centre_and_scale(sample)
        if not scale < math.inf:  # beyond floating point
            return ()
        x, y = ((sample - centre) / scale).T
        monomials = np.stack((x * x, x * y, y * y, x, y, np.ones(5)), axis=1)
        _, spread, rows = np.linalg.svd(monomials, full_matrices=True)
        if spread[4] <= _UNIQUE * spread[0]:
            return ()
        ellipse = _from_conic(rows[5].tolist())
        if ellipse is None:
            return ()
        return (_rescaled(ellipse, centre, scale),)

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        """Return the distance of every point to the ellipse, shape (n,), in the data's unit."""
        points, nearest, _ = _nearest(model, data)
        x, y = (points - nearest).T
        distances: FloatArray = np.hypot(x, y)
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        """Return the ellipse with a least sum of squared distances.

        Parameters
        ----------
        data : ndarray of shape (n, 2)

        Returns
        -------
        ndarray of shape (5,) or None
            None if fewer than five points, or no ellipse fits them.

        Notes
        -----
        Starts from the direct least squares fit of ellipses (Halir and Flusser 1998, after
        Fitzgibbon, Pilu and Fisher).
        """
        if len(data) < self.sample_size:
            return None
        centre, scale = centre_and_scale(data)
        points = (data - centre) / scale
        conic = _direct_fit(points)
        start = None if conic is None else _from_conic(conic)
        if start is None:
            return None

        def distances(ellipse: FloatArray) -> tuple[FloatArray, FloatArray]:
            if not (ellipse[2] > 0.0 and ellipse[3] > 0.0 and np.all(np.abs(ellipse) < 1e6)):
                return np.full(len(points), np.inf), np.zeros((len(points), 5))
            return _signed_distances(ellipse, points)

        ellipse = minimise(distances, start)
        return _rescaled(_ordered(*ellipse.tolist()), centre, scale)


def _from_conic(conic: list[float]) -> FloatArray | None:
    """Return the ellipse ``A x**2 + B x y + C y**2 + D x + E y + F = 0``, None if it is none."""
    a, b, c, d, e, f = conic
    if a + c < 0.0:
        a, b, c, d, e, f = -a, -b, -c, -d, -e, -f
    discriminant = 4.0 * a * c - b * b
    if discriminant <= _ROUND:
        return None
    x, y = (b * e - 2.0 * c * d) / discriminant, (b * d - 2.0 * a * e) / discriminant
    level = -(f + 0.5 * (d * x + e * y))
    if level <= 0.0:
        return None
    # Eigenvalues of the quadratic form: the smaller one belongs to the longer axis.
    root = math.hypot(a - c, b)
    larger = 0.5 * (a + c + root)
    smaller = 0.25 * discriminant / larger
    angle = 0.5 * math.atan2(-b, c - a)
    return np.array((x, y, math.sqrt(level / smaller), math.sqrt(level / larger), angle))


def _direct_fit(points: FloatArray) -> list[float] | None:
    """Return the conic of least algebraic error among ellipses, None if it is not unique."""
    x, y = points.T
    quadratic = np.stack((x * x, x * y, y * y), axis=1)
    linear = np.stack((x, y, np.ones(len(points))), axis=1)
    moments = linear.T @ linear
    if np.linalg.cond(moments) > 1e12:
        return None
    elimination = -np.linalg.solve(moments, linear.T @ quadratic)
    reduced = quadratic.T @ quadratic + quadratic.T @ linear @ elimination
    # The constraint 4 A C - B**2 = 1, inverted.
    constrained = np.stack((reduced[2] / 2.0, -reduced[1], reduced[0] / 2.0))
    _, vectors = np.linalg.eig(constrained)
    for vector in np.real(vectors).T:
        if 4.0 * vector[0] * vector[2] - vector[1] ** 2 > 0.0:
            conic = np.concatenate((vector, elimination @ vector))
            return [float(entry) for entry in conic / np.linalg.norm(conic)]
    return None


def _ordered(x: float, y: float, a: float, b: float, angle: float) -> FloatArray:
    """Return the same ellipse with ``a >= b`` and the angle from -pi/2 to pi/2."""
    if a < b:
        a, b, angle = b, a, angle + math.pi / 2.0
    return np.array((x, y, a, b, math.remainder(angle, math.pi)))


def _rescaled(ellipse: FloatArray, centre: FloatArray, scale: float) -> FloatArray:
    x, y, a, b, angle = ellipse.tolist()
    return np.array((x * scale + centre[0], y * scale + centre[1], a * scale, b * scale, angle))


def _local(ellipse: FloatArray, data: FloatArray) -> FloatArray:
    """Return points in the coordinates of the ellipse's centre and axes."""
    c, s = math.cos(ellipse[4]), math.sin(ellipse[4])
    points: FloatArray = (data - ellipse[:2]) @ np.array(((c, -s), (s, c)))
    return points


def _nearest(ellipse: FloatArray, data: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points, the nearest points on the ellipse and the outward normals there.

    All in the coordinates of the ellipse's axes, shape (n, 2).

    Notes
    -----
    For the point (x, y), both not negative, and ``a >= b``, the nearest is
    ``(a**2 x / (t + a**2 - b**2), b**2 y / t)`` with the largest root t of
    ``(a x / (t + a**2 - b**2))**2 + (b y / t)**2 = 1`` (after D. Eberly, "Distance from a Point
    to an Ellipse, an Ellipsoid, or a Hyperellipsoid"). For t > 0 the left side is convex and
    falls, and either term alone gives a lower bound of the root, from which Newton's method rises
    to it and cannot overshoot.
    """
    points = _local(ellipse, data)
    a, b = np.abs(ellipse[2:4]).tolist()
    x, y = np.abs(points).T
    # Only the longer axis has a gap; a and b may come in either order from a refit's steps.
    gap_x, gap_y = max(a - b, 0.0) * (a + b), max(b - a, 0.0) * (a + b)
    ax, by = a * x, b * y
    t = np.maximum(ax - gap_x, by - gap_y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(100):
            over_x, over_y = 1.0 / (t + gap_x), 1.0 / (t + gap_y)
            term_x, term_y = (ax * over_x) ** 2, (by * over_y) ** 2
            excess = term_x + term_y - 1.0
            step = 0.5 * excess / (term_x * over_x + term_y * over_y)
            risen = np.where(step > 0.0, t + step, t)  # false for NaN: on an axis
            if np.array_equal(risen, t):
                break
            t = risen
        near_x, near_y = a * ax / (t + gap_x), b * by / (t + gap_y)
    # A coordinate that is 0 / 0 is a point's on an axis, within the evolute.
    lost = np.isnan(near_x)
    if lost.any():
        rest = np.nan_to_num(near_y[lost] / b)  # the centre of a circle has lost both
        near_x[lost] = a * np.sqrt(np.maximum(0.0, 1.0 - rest * rest))
    lost = np.isnan(near_y)
    if lost.any():
        rest = near_x[lost] / a
        near_y[lost] = b * np.sqrt(np.maximum(0.0, 1.0 - rest * rest))
    nearest = np.copysign(np.column_stack((near_x, near_y)), points)
    normals = nearest / (a * a, b * b)
    normals /= np.hypot(normals[:, 0], normals[:, 1])[:, None]
    return points, nearest, normals


def _signed_distances(ellipse: FloatArray, data: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return distances to the ellipse, negative inside, and their derivatives."""
    points, nearest, normals = _nearest(ellipse, data)
    distances = np.sum((points - nearest) * normals, axis=1)
    # To first order a distance changes by how far the nearest point moves along the normal.
    c, s = math.cos(ellipse[4]), math.sin(ellipse[4])
    jacobian = np.column_stack(
        (
            -(normals @ np.array((c, -s))),
            -(normals @ np.array((s, c))),
            -normals[:, 0] * nearest[:, 0] / ellipse[2],
            -normals[:, 1] * nearest[:, 1] / ellipse[3],
            normals[:, 0] * nearest[:, 1] - normals[:, 1] * nearest[:, 0],
        )
    )
    return distances, jacobian
