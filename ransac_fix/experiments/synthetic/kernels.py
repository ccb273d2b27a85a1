"""The loops of the synthetic experiments, compiled. Both rules read one stream of samples.

The exact rule never stops before the approximate one, so one run serves both: the model in hand
when the approximate rule stops is kept, and the run goes on.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ransac_fix.experiments.compiled import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30, _SHIFT_27, _SHIFT_31, _SHIFT_32 = (np.uint64(v) for v in (30, 27, 31, 32))

_DISTANCE_STEPS = 110
# Nearer to the longer axis than this, in units of the shorter one, is on it.
_ON_AXIS = 1e-13
# A little more than 1: the bounds that come before a measurement may not lose an inlier.
_ROUNDING = 1.0 + 1e-9


@compiled
def draw_distinct(state: NDArray[np.uint64], n: int, sample: IntArray) -> None:
    """Fill `sample` with distinct indices below `n`, uniformly.

    SplitMix64 (Steele, Lea and Flood 2014) advances `state`; its upper half is scaled to `n`, and
    an index drawn before is drawn again.
    """
    for j in range(sample.size):
        while True:
            state[0] += _GOLDEN
            z = state[0]
            z = (z ^ (z >> _SHIFT_30)) * _MIX_1
            z = (z ^ (z >> _SHIFT_27)) * _MIX_2
            z = z ^ (z >> _SHIFT_31)
            index = np.int64(((z >> _SHIFT_32) * np.uint64(n)) >> _SHIFT_32)
            repeated = False
            for i in range(j):
                if sample[i] == index:
                    repeated = True
            if not repeated:
                sample[j] = index
                break


@compiled
def line_distances(x: FloatArray, y: FloatArray, line: FloatArray) -> FloatArray:
    """Return the distance of each point to the line; infinite where there is no line."""
    distances = np.empty(x.size)
    for i in range(x.size):
        d = abs(line[0] * x[i] + line[1] * y[i] + line[2])
        distances[i] = d if d >= 0.0 else np.inf
    return distances


@compiled
def ellipse_distances(x: FloatArray, y: FloatArray, ellipse: FloatArray) -> FloatArray:
    """Return the distance of each point to the ellipse; infinite where there is no ellipse."""
    distances = np.full(x.size, np.inf)
    if not math.isfinite(ellipse[0]):
        return distances
    axes = np.empty(4)
    ellipse_axes(ellipse, axes)
    for i in range(x.size):
        dx, dy = x[i] - ellipse[0], y[i] - ellipse[1]
        u, v = axes[2] * dx + axes[3] * dy, axes[2] * dy - axes[3] * dx
        distances[i] = distance_to_ellipse(axes[0], axes[1], u, v)
    return distances


@compiled
def squared_whitened(distances: FloatArray, limit: FloatArray, ties: int) -> float:
    """Return the sum of squared distances in units of their limits, of inliers or (2) of all."""
    total = 0.0
    for i in range(distances.size):
        if ties == 2 or distances[i] <= limit[i]:
            total += (distances[i] / limit[i]) ** 2
    return total


@compiled
def ellipse_through(x: FloatArray, y: FloatArray, sample: IntArray, ellipse: FloatArray) -> bool:
    """Compute the ellipse through five points, if the conic through them is one.

    Parameters
    ----------
    x, y : ndarray of shape (n,)
        Measurements.
    sample : ndarray of shape (5,)
        Which five.
    ellipse : ndarray of shape (5,)
        Filled with the centre and the matrix m0, m1, m2 of
        ``m0 dx^2 + m1 dx dy + m2 dy^2 = 1``, dx and dy relative to the centre.

    Notes
    -----
    The conics through four points are the mixtures of two pairs of lines through them, l12 l34
    and l13 l24; the fifth point fixes the mixture. Nothing is divided until it is known to be
    an ellipse, which three conics in four are not.
    """
    ox, oy = x[sample[4]], y[sample[4]]
    x1, y1 = x[sample[0]] - ox, y[sample[0]] - oy
    x2, y2 = x[sample[1]] - ox, y[sample[1]] - oy
    x3, y3 = x[sample[2]] - ox, y[sample[2]] - oy
    x4, y4 = x[sample[3]] - ox, y[sample[3]] - oy
    # A line through two points, a x + b y + c = 0. The fifth point is the origin: its value is c.
    a12, b12, c12 = y1 - y2, x2 - x1, x1 * y2 - x2 * y1
    a34, b34, c34 = y3 - y4, x4 - x3, x3 * y4 - x4 * y3
    a13, b13, c13 = y1 - y3, x3 - x1, x1 * y3 - x3 * y1
    a24, b24, c24 = y2 - y4, x4 - x2, x2 * y4 - x4 * y2
    first, second = c13 * c24, c12 * c34
    a = first * a12 * a34 - second * a13 * a24
    b = first * (a12 * b34 + a34 * b12) - second * (a13 * b24 + a24 * b13)
    c = first * b12 * b34 - second * b13 * b24
    discriminant = 4.0 * a * c - b * b
    if not discriminant > 0.0:
        return False
    d = first * (a12 * c34 + a34 * c12) - second * (a13 * c24 + a24 * c13)
    e = first * (b12 * c34 + b34 * c12) - second * (b13 * c24 + b24 * c13)
    u, v = (b * e - 2.0 * c * d) / discriminant, (b * d - 2.0 * a * e) / discriminant
    # About its centre: a u^2 + b u v + c v^2 = level, and the origin lies on it.
    level = -0.5 * (d * u + e * v)
    ellipse[0] = ox + u
    ellipse[1] = oy + v
    ellipse[2] = a / level
    ellipse[3] = b / level
    ellipse[4] = c / level
    # Rounding can make either matter for points on nearly one line.
    determinant = ellipse[2] * ellipse[4] - 0.25 * ellipse[3] * ellipse[3]
    return bool(ellipse[2] > 0.0 and 0.0 < determinant < np.inf)


@compiled
def largest_curvature(ellipse: FloatArray) -> float:
    """Return the larger eigenvalue of the ellipse's matrix: one over the smaller axis squared."""
    a, b, c = ellipse[2], ellipse[3], ellipse[4]
    return float(0.5 * (a + c + math.sqrt((a - c) * (a - c) + b * b)))


@compiled
def ellipse_axes(ellipse: FloatArray, axes: FloatArray) -> None:
    """Fill `axes` with the semi-axes a >= b and the cosine and sine of the first's direction."""
    a, b, c = ellipse[2], ellipse[3], ellipse[4]
    root = math.sqrt((a - c) * (a - c) + b * b)
    large = 0.5 * (a + c + root)
    # The product of the eigenvalues, not their difference: nothing cancels for thin ellipses.
    small = (a * c - 0.25 * b * b) / large
    angle = 0.5 * math.atan2(-b, c - a)
    axes[0] = 1.0 / math.sqrt(small)
    axes[1] = 1.0 / math.sqrt(large)
    axes[2] = math.cos(angle)
    axes[3] = math.sin(angle)


@compiled
def distance_to_ellipse(a: float, b: float, u: float, v: float) -> float:
    """Return the distance of the point (u, v) to the ellipse with semi-axes a >= b on the axes.

    Newton's method for the parameter of the normal through the point (Eberly, "Distance from a
    point to an ellipse"), from the side where it converges without overshooting.
    """
    u, v = abs(u), abs(v)
    if v <= _ON_AXIS * b:  # the foot is off the axis inside the evolute, at the vertex outside
        if u * a < a * a - b * b:
            cosine = u * a / (a * a - b * b)
            foot = b * math.sqrt(max(0.0, 1.0 - cosine * cosine))
            return math.hypot(u - a * cosine, foot)
        return abs(u - a)
    ratio = (a / b) * (a / b)
    offset = (a - b) * (a + b) / (b * b)
    z0, z1 = u / a, v / b
    if z0 * z0 + z1 * z1 == 1.0:
        return 0.0
    n0 = ratio * z0
    # g falls and is convex, so from where it is not negative Newton's steps never go too far.
    s = max(z1, n0 - offset)
    for _ in range(_DISTANCE_STEPS):
        first, second = n0 / (s + offset), z1 / s
        g = first * first + second * second - 1.0
        step = 0.5 * g / (first * first / (s + offset) + second * second / s)
        if not s + step > s:
            break
        s += step
    return math.hypot(ratio * u / (s + offset) - u, v / s - v)


@compiled
def count_sampson(x: FloatArray, y: FloatArray, limit: FloatArray, ellipse: FloatArray) -> int:
    """Return how many points are within their limit of the ellipse by Sampson's distance."""
    cx, cy, m0, m1, m2 = ellipse[0], ellipse[1], ellipse[2], ellipse[3], ellipse[4]
    count = 0
    for i in range(x.size):
        dx, dy = x[i] - cx, y[i] - cy
        gx, gy = 2.0 * m0 * dx + m1 * dy, 2.0 * m2 * dy + m1 * dx
        value = 0.5 * (gx * dx + gy * dy) - 1.0
        count += value * value <= limit[i] * limit[i] * (gx * gx + gy * gy)
    return count


@compiled
def count_radial(x: FloatArray, y: FloatArray, limit: FloatArray, ellipse: FloatArray) -> int:
    """Return how many points are within their limit of where their ray meets the ellipse."""
    cx, cy, m0, m1, m2 = ellipse[0], ellipse[1], ellipse[2], ellipse[3], ellipse[4]
    count = 0
    for i in range(x.size):
        dx, dy = x[i] - cx, y[i] - cy
        rho = math.sqrt(m0 * dx * dx + m1 * dx * dy + m2 * dy * dy)
        count += abs(rho - 1.0) * math.sqrt(dx * dx + dy * dy) <= limit[i] * rho
    return count


@compiled
def count_geometric(
    x: FloatArray,
    y: FloatArray,
    limit: FloatArray,
    ellipse: FloatArray,
    to_beat: int,
    axes: FloatArray,
) -> int:
    """Return the inliers of an ellipse by geometric distance, if they are `to_beat` or more.

    Parameters
    ----------
    x, y, limit : ndarray of shape (n,)
        Measurements and the largest distance of an inlier.
    ellipse : ndarray of shape (5,)
        As `ellipse_through` fills it.
    to_beat : int
        With fewer inliers than this, any number below it is returned.
    axes : ndarray of shape (4,)
        Room to work in.

    Notes
    -----
    Let q(x) = 1 be the ellipse and g the length of q's gradient at the point. A point at a
    distance d has ``q - 1 <= g d`` (q is convex) and ``1 - q <= g d + d^2 / b^2``, b the smaller
    semi-axis. These bounds are close, and decide most ellipses in one vector loop without a
    square root. Where enough points pass, those that are not inliers by the distance along the
    ray from the centre, which is never too small, are measured.
    """
    n = x.size
    cx, cy, m0, m1, m2 = ellipse[0], ellipse[1], ellipse[2], ellipse[3], ellipse[4]
    curvature = largest_curvature(ellipse)
    possible = 0
    for i in range(n):
        dx, dy = x[i] - cx, y[i] - cy
        gx, gy = 2.0 * m0 * dx + m1 * dy, 2.0 * m2 * dy + m1 * dx
        value = 0.5 * (gx * dx + gy * dy) - 1.0
        square = limit[i] * limit[i]
        excess = max(value, -value - curvature * square, 0.0)
        possible += excess * excess <= square * (gx * gx + gy * gy) * _ROUNDING
    if possible < to_beat:
        return possible
    ellipse_axes(ellipse, axes)
    for i in range(n):
        dx, dy = x[i] - cx, y[i] - cy
        gx, gy = 2.0 * m0 * dx + m1 * dy, 2.0 * m2 * dy + m1 * dx
        q = 0.5 * (gx * dx + gy * dy)
        square = limit[i] * limit[i]
        excess = max(q - 1.0, 1.0 - q - curvature * square, 0.0)
        if excess * excess > square * (gx * gx + gy * gy) * _ROUNDING:
            continue
        rho = math.sqrt(q)
        if abs(rho - 1.0) * math.sqrt(dx * dx + dy * dy) <= limit[i] * rho:
            continue
        u, v = axes[2] * dx + axes[3] * dy, axes[2] * dy - axes[3] * dx
        if distance_to_ellipse(axes[0], axes[1], u, v) > limit[i]:
            possible -= 1
            if possible < to_beat:
                return possible
    return possible


@compiled
def fit_lines(
    x: FloatArray,
    y: FloatArray,
    limit: FloatArray,
    seed: np.uint64,
    approximate_trials: IntArray,
    exact_trials: IntArray,
    ties: int,
    trials: IntArray,
    models: FloatArray,
) -> int:
    """Run RANSAC for a line under both rules.

    Parameters
    ----------
    x, y : ndarray of shape (n,)
        Measurements.
    limit : ndarray of shape (n,)
        Largest distance of an inlier.
    seed : uint64
        Start of the stream of samples.
    approximate_trials, exact_trials : ndarray of shape (n + 1,)
        Trials each rule asks for with that many inliers in hand.
    ties : int
        Of two models with as many inliers the better one is the first (0), or has the smaller
        sum of squared whitened distances over its inliers (1) or over all measurements (2).
    trials : ndarray of shape (2,)
        Filled with the trials that the approximate and the exact rule ran.
    models : ndarray of shape (2, 3)
        Filled with the best line under each: a, b, c with a x + b y + c = 0, a^2 + b^2 = 1.

    Returns
    -------
    int
        Tests of a point against a model.
    """
    n = x.size
    state = np.empty(1, np.uint64)
    state[0] = seed
    sample = np.empty(2, np.int64)
    line = np.empty(3)
    held = np.full(3, np.nan)
    held_cost = np.inf
    best, done, tests = 0, 0, 0
    trials[0] = -1
    while done < exact_trials[best]:
        if trials[0] < 0 and done >= approximate_trials[best]:
            trials[0] = done
            models[0, :] = held
        done += 1
        draw_distinct(state, n, sample)
        i, j = sample[0], sample[1]
        dx, dy = x[j] - x[i], y[j] - y[i]
        length = math.sqrt(dx * dx + dy * dy)
        if length == 0.0:
            continue
        a, b = -dy / length, dx / length
        c = -(a * x[i] + b * y[i])
        count = 0
        for m in range(n):
            count += abs(a * x[m] + b * y[m] + c) <= limit[m]
        tests += n
        if count < best or (count == best and ties == 0):
            continue
        line[0], line[1], line[2] = a, b, c
        cost = 0.0
        if ties > 0:
            cost = squared_whitened(line_distances(x, y, line), limit, ties)
            if count == best and cost >= held_cost:
                continue
        best = count
        held[:] = line
        held_cost = cost
    if trials[0] < 0:
        trials[0] = done
        models[0, :] = held
    trials[1] = done
    models[1, :] = held
    return tests


@compiled
def fit_ellipses(
    x: FloatArray,
    y: FloatArray,
    limit: FloatArray,
    seed: np.uint64,
    approximate_trials: IntArray,
    exact_trials: IntArray,
    ties: int,
    distance: int,
    redrawn: bool,
    trials: IntArray,
    models: FloatArray,
) -> int:
    """Run RANSAC for an ellipse under both rules.

    Parameters and result as in `fit_lines`, but for `distance` (who is an inlier is decided by the
    geometric distance (0), Sampson's first-order one (1) or the one along the ray from the centre
    (2)), `redrawn` (a trial draws until its five points lie on an ellipse) and `models` of shape
    (2, 5), as `ellipse_through` fills them.
    """
    n = x.size
    state = np.empty(1, np.uint64)
    state[0] = seed
    sample = np.empty(5, np.int64)
    ellipse = np.empty(5)
    axes = np.empty(4)
    held = np.full(5, np.nan)
    held_cost = np.inf
    best, done, tests = 0, 0, 0
    trials[0] = -1
    while done < exact_trials[best]:
        if trials[0] < 0 and done >= approximate_trials[best]:
            trials[0] = done
            models[0, :] = held
        done += 1
        draw_distinct(state, n, sample)
        found = ellipse_through(x, y, sample, ellipse)
        while redrawn and not found:
            draw_distinct(state, n, sample)
            found = ellipse_through(x, y, sample, ellipse)
        if not found:
            continue
        tests += n
        to_beat = best if ties > 0 else best + 1
        if distance == 1:
            count = count_sampson(x, y, limit, ellipse)
        elif distance == 2:
            count = count_radial(x, y, limit, ellipse)
        else:
            count = count_geometric(x, y, limit, ellipse, to_beat, axes)
        if count < to_beat:
            continue
        cost = 0.0
        if ties > 0:
            cost = squared_whitened(ellipse_distances(x, y, ellipse), limit, ties)
            if count == best and cost >= held_cost:
                continue
        best = count
        held[:] = ellipse
        held_cost = cost
    if trials[0] < 0:
        trials[0] = done
        models[0, :] = held
    trials[1] = done
    models[1, :] = held
    return tests
