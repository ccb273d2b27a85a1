"""The models: minimal solvers, residuals and refits."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from ransac_fix.reference import (
    Affine,
    Circle,
    Ellipse,
    FloatArray,
    Homography,
    Line,
    Model,
    Plane,
)

SEEDS = st.integers(0, 2**32)


@dataclass(frozen=True)
class Kind:
    """A kind of model, how to plant one, and what two equal models have in common."""

    model: Model[FloatArray]
    plant: Callable[[np.random.Generator, int], tuple[FloatArray, FloatArray]]
    canonical: Callable[[FloatArray], FloatArray]
    maps: bool = False  # between two images, with a residual in the second


def up_to_sign(model: FloatArray) -> FloatArray:
    entries = model.ravel()
    return entries if entries[np.argmax(np.abs(entries))] > 0.0 else -entries


def plant_line(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    angle, offset = rng.uniform(0.0, math.pi), rng.uniform(-2.0, 2.0)
    normal = np.array((math.cos(angle), math.sin(angle)))
    along = spread(rng, n, -3.0, 3.0)[:, None] * np.array((-normal[1], normal[0]))
    return np.append(normal, -offset), along + offset * normal


def plant_plane(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    offset = rng.uniform(-2.0, 2.0)
    return np.append(frame[2], -offset), scattered(rng, n) @ frame[:2] + offset * frame[2]


def plant_circle(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    circle = np.append(rng.uniform(-2.0, 2.0, 2), rng.uniform(0.5, 3.0))
    angles = spread(rng, n, 0.0, 2.0 * math.pi * (1.0 - 1.0 / n))
    points = circle[2] * np.column_stack((np.cos(angles), np.sin(angles))) + circle[:2]
    return circle, points


def plant_ellipse(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    x, y, b, angle = *rng.uniform(-2.0, 2.0, 2), rng.uniform(0.5, 2.0), rng.uniform(-1.5, 1.5)
    a = b * rng.uniform(1.2, 4.0)
    return np.array((x, y, a, b, angle)), on_ellipse(
        (x, y, a, b, angle), spread(rng, n, 0.0, 2.0 * math.pi * (1.0 - 1.0 / n))
    )


def on_ellipse(ellipse: Any, angles: FloatArray) -> FloatArray:
    x, y, a, b, angle = ellipse
    c, s = math.cos(angle), math.sin(angle)
    u, v = a * np.cos(angles), b * np.sin(angles)
    return np.column_stack((x + c * u - s * v, y + s * u + c * v))


def plant_affine(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    left, right = np.linalg.qr(rng.normal(size=(2, 2)))[0], np.linalg.qr(rng.normal(size=(2, 2)))[0]
    linear = left @ np.diag(rng.uniform(0.3, 3.0, 2)) @ right
    affine = np.column_stack((linear, rng.uniform(-2.0, 2.0, 2)))
    points = scattered(rng, n)
    return affine, np.hstack((points, points @ linear.T + affine[:, 2]))


def plant_homography(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    affine, _ = plant_affine(rng, 3)
    # The points lie within 4.3 of the origin, so the last coordinate stays above 0.3.
    h = np.vstack((affine, np.append(rng.uniform(-0.1, 0.1, 2), 1.0)))
    points = scattered(rng, n)
    mapped = np.column_stack((points, np.ones(n))) @ h.T
    return h / np.linalg.norm(h), np.hstack((points, mapped[:, :2] / mapped[:, 2:]))


def spread(rng: np.random.Generator, n: int, low: float, high: float) -> FloatArray:
    """Return n numbers from low to high in random order, none close to another."""
    steps = np.linspace(low, high, n)
    jitter = rng.uniform(-0.3, 0.3, n) * (high - low) / max(n - 1, 1)
    return rng.permutation(steps + jitter)


def scattered(rng: np.random.Generator, n: int) -> FloatArray:
    """Return n points in the plane of which no three are near a line."""
    while True:
        points = rng.uniform(-3.0, 3.0, (n, 2))
        flattest = min(
            abs((q - p)[0] * (r - p)[1] - (q - p)[1] * (r - p)[0])
            / max(float((a - b) @ (a - b)) for a, b in ((p, q), (p, r), (q, r)))
            for p, q, r in itertools.combinations(points[:6], 3)
        )
        if flattest > 0.02:
            return points


KINDS = {
    "line": Kind(Line(), plant_line, up_to_sign),
    "plane": Kind(Plane(), plant_plane, up_to_sign),
    "circle": Kind(Circle(), plant_circle, np.asarray),
    # The angle of the first axis, on the double circle.
    "ellipse": Kind(
        Ellipse(),
        plant_ellipse,
        lambda m: np.array((*m[:4], math.cos(2.0 * m[4]), math.sin(2.0 * m[4]))),
    ),
    "affine": Kind(Affine(), plant_affine, np.asarray, maps=True),
    "homography": Kind(Homography(), plant_homography, up_to_sign, maps=True),
}

every_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def only(models: Any) -> FloatArray:
    (model,) = models
    assert isinstance(model, np.ndarray)
    return model


@every_kind
@given(seed=SEEDS)
@settings(deadline=None)
def test_a_minimal_sample_gives_back_the_planted_model(kind: Kind, seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = kind.model.sample_size
    planted, data = kind.plant(rng, 12 if not kind.maps else 6)
    sample = data[:: len(data) // k][:k]
    found = only(kind.model.solve(sample))
    conditioning = 1e-7 if isinstance(kind.model, Ellipse) else 1e-9
    np.testing.assert_allclose(
        kind.canonical(found), kind.canonical(planted), rtol=0, atol=conditioning * 10
    )
    assert np.all(kind.model.residuals(found, sample) <= conditioning)
    assert np.all(kind.model.residuals(planted, data) <= 1e-12)


@every_kind
@given(seed=SEEDS)
@settings(deadline=None)
def test_the_order_of_a_sample_does_not_matter(kind: Kind, seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, data = kind.plant(rng, kind.model.sample_size)
    one, other = only(kind.model.solve(data)), only(kind.model.solve(rng.permutation(data)))
    np.testing.assert_allclose(kind.canonical(one), kind.canonical(other), rtol=0, atol=1e-8)


@every_kind
@given(seed=SEEDS)
@settings(deadline=None)
def test_a_repeated_measurement_gives_no_model(kind: Kind, seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, data = kind.plant(rng, max(6, kind.model.sample_size))
    data = data * 10.0 ** rng.integers(-6, 7) + rng.uniform(-100.0, 100.0)
    sample = data[: kind.model.sample_size].copy()
    one, other = rng.choice(len(sample), 2, replace=False)
    sample[one] = sample[other]
    assert len(kind.model.solve(sample)) == 0


def moved(kind: Kind, data: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return the data after a similarity in each space, and the scale of the residuals."""
    columns = 3 if data.shape[1] == 3 else 2
    parts = []
    scale = 1.0
    for part in np.split(data, data.shape[1] // columns, axis=1):
        turn, _ = np.linalg.qr(rng.normal(size=(columns, columns)))
        scale = 10.0 ** rng.uniform(-3.0, 3.0)
        parts.append(scale * (part @ turn + rng.uniform(-5.0, 5.0, columns)))
    return np.hstack(parts), scale  # the last image's


@every_kind
@given(seed=SEEDS)
@settings(deadline=None)
def test_residuals_move_with_the_data(kind: Kind, seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = kind.model.sample_size
    _, data = kind.plant(rng, 8)
    data = np.vstack((data[:k], data + rng.normal(0.0, 0.2, data.shape)))
    elsewhere, scale = moved(kind, data, rng)
    before = kind.model.residuals(only(kind.model.solve(data[:k])), data)
    after = kind.model.residuals(only(kind.model.solve(elsewhere[:k])), elsewhere)
    # Relative to the size of what is measured; a homography magnifies near its horizon.
    tolerance = 1e-6 * (1.0 + before)
    assert np.all(np.abs(after / scale - before) <= tolerance)


@every_kind
@given(seed=SEEDS, noise=st.sampled_from([1e-4, 1e-2, 5e-2]))
@settings(deadline=None, max_examples=50)
def test_a_refit_lies_closer_to_its_measurements(kind: Kind, seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    planted, data = kind.plant(rng, 30)
    data = data + rng.normal(0.0, noise, data.shape)
    fitted = kind.model.refit(data)
    assert fitted is not None

    def cost(model: FloatArray) -> float:
        return float(np.sum(kind.model.residuals(model, data) ** 2))

    least = cost(fitted)
    assert least <= cost(planted) * (1.0 + 1e-9)
    # The minimal models of the same measurements are no closer either.
    for _ in range(5):
        for model in kind.model.solve(data[rng.choice(30, kind.model.sample_size, False)]):
            assert least <= cost(model) * (1.0 + 1e-9)
    # Nor is any model near it: a unit normal's length is not free, so lines and planes are
    # perturbed along with it.
    for _ in range(10):
        near = fitted + rng.normal(0.0, 1e-3, fitted.shape)
        if isinstance(kind.model, Line | Plane):
            near = near / np.linalg.norm(near[:-1])
        assert least <= cost(near) * (1.0 + 1e-9)


@every_kind
@given(seed=SEEDS)
@settings(deadline=None, max_examples=50)
def test_a_refit_to_exact_measurements_is_exact(kind: Kind, seed: int) -> None:
    planted, data = kind.plant(np.random.default_rng(seed), 12)
    fitted = kind.model.refit(data)
    assert fitted is not None
    np.testing.assert_allclose(kind.canonical(fitted), kind.canonical(planted), rtol=0, atol=1e-7)


@every_kind
def test_a_refit_of_very_many_measurements_stays_small(kind: Kind) -> None:
    planted, data = kind.plant(np.random.default_rng(0), 20_000)  # squared they fill 3 GB
    fitted = kind.model.refit(data)
    assert fitted is not None
    np.testing.assert_allclose(kind.canonical(fitted), kind.canonical(planted), rtol=0, atol=1e-9)


@every_kind
def test_a_refit_needs_measurements_that_determine_it(kind: Kind) -> None:
    _, data = kind.plant(np.random.default_rng(0), 8)
    assert kind.model.refit(np.ones_like(data)) is None
    assert kind.model.refit(data[: kind.model.sample_size - 1]) is None
    assert kind.model.refit(data[: kind.model.sample_size]) is not None


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("name", ["plane", "circle", "affine", "homography", "ellipse"])
def test_collinear_samples_give_no_model(name: str, scale: float) -> None:
    rng = np.random.default_rng(0)
    model = KINDS[name].model
    columns = model.n_columns  # type: ignore[attr-defined]
    for _ in range(50):
        k = model.sample_size
        data = rng.uniform(-1.0, 1.0, (k, columns))
        # All but the last point of a homography, and of an ellipse, on one line.
        flat = k if k == 3 else k - 1
        dimensions = min(columns, 3) if columns == 3 else 2
        begin = int(rng.integers(columns // dimensions)) * dimensions  # in either image
        start, direction = rng.uniform(-1.0, 1.0, (2, dimensions))
        steps = rng.uniform(-1.0, 1.0, flat)[:, None]
        data[:flat, begin : begin + dimensions] = start + steps * direction
        assert len(model.solve(rng.permutation(data * scale))) == 0
        if k == 3 and dimensions == columns:
            assert model.refit(data * scale) is None


def test_conics_that_are_no_ellipses_give_no_model() -> None:
    x = np.array((-2.0, -1.0, 0.3, 1.1, 2.5))
    for curve in (x**2, 1.0 / x):
        assert len(Ellipse().solve(np.column_stack((x, curve)))) == 0
    two_lines = np.array(((0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (0.0, 1.0), (2.0, 1.0)))
    assert len(Ellipse().solve(two_lines)) == 0


@given(seed=SEEDS)
@settings(deadline=None)
def test_distances_to_an_ellipse_are_orthogonal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    b = rng.uniform(0.05, 2.0)
    ellipse = np.array((*rng.uniform(-1.0, 1.0, 2), b * rng.uniform(1.0, 20.0), b, 0.7))
    points = ellipse[:2] + rng.uniform(-4.0, 4.0, (6, 2))
    angles = np.linspace(0.0, 2.0 * math.pi, 2001)
    curve = on_ellipse(ellipse, angles)
    for point, distance in zip(points, Ellipse().residuals(ellipse, points), strict=True):
        coarse = np.hypot(*(curve - point).T)
        around = angles[int(np.argmin(coarse))]

        def to_point(angle: float, point: FloatArray = point) -> float:
            return math.dist(on_ellipse(ellipse, np.array([angle]))[0], point)

        best = optimize.minimize_scalar(
            to_point, bounds=(around - 0.004, around + 0.004), options={"xatol": 1e-12}
        )
        assert distance == pytest.approx(min(best.fun, coarse.min()), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((0.0, 0.0), 1.0),  # the centre
        ((1.0, 0.0), math.sqrt(2.0 / 3.0)),  # on the major axis within the evolute
        ((1.5, 0.0), 0.5),  # its end
        ((1.9, 0.0), 0.1),
        ((2.0, 0.0), 0.0),
        ((-5.0, 0.0), 3.0),
        ((0.0, 0.25), 0.75),  # on the minor axis
        ((0.0, -1.0), 0.0),
        ((0.0, 7.0), 6.0),
        ((1e-200, 1e-200), 1.0),
        ((1.0, 1e-18), math.sqrt(2.0 / 3.0)),
        ((1.0, 1e-15), math.sqrt(2.0 / 3.0)),
    ],
)
def test_distances_from_the_axes_of_an_ellipse(point: tuple[float, float], distance: float) -> None:
    ellipse = np.array((0.0, 0.0, 2.0, 1.0, 0.0))
    assert Ellipse().residuals(ellipse, np.array([point]))[0] == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e5])
def test_an_ellipse_may_be_a_circle(radius: float) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-2.0, 2.0, (50, 2)) * radius
    points[0] = 0.0
    round_one = np.array((0.0, 0.0, radius, radius, 0.0))
    np.testing.assert_allclose(
        Ellipse().residuals(round_one, points),
        Circle().residuals(np.array((0.0, 0.0, radius)), points),
        atol=1e-12 * radius,
    )


def test_a_point_mapped_to_infinity_has_an_infinite_residual() -> None:
    h = np.array(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
    residuals = Homography().residuals(h, np.array(((0.0, 1.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0))))
    assert not residuals[0] <= 1e300
    assert residuals[1] == 0.0


@given(seed=SEEDS)
@settings(deadline=None)
def test_a_homography_of_an_affine_map_is_that_map(seed: int) -> None:
    affine, data = plant_affine(np.random.default_rng(seed), 4)
    h = only(Homography().solve(data))
    np.testing.assert_allclose(h / h[2, 2], np.vstack((affine, (0.0, 0.0, 1.0))), atol=1e-9)


@given(seed=SEEDS, far=st.sampled_from([1e2, 1e4, 1e6]))
@settings(deadline=None)
def test_homographies_far_from_the_origin_keep_their_precision(seed: int, far: float) -> None:
    rng = np.random.default_rng(seed)
    _, data = plant_homography(rng, 6)
    data = data + far
    residuals = Homography().residuals(only(Homography().solve(data[:4])), data[:4])
    assert np.all(residuals <= 1e-13 * far * far)


@given(seed=SEEDS)
@settings(deadline=None, max_examples=25)
def test_the_refit_of_an_affine_map_is_linear_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = rng.normal(size=(15, 4))
    fitted = Affine().refit(data)
    assert fitted is not None
    rows = np.column_stack((data[:, :2], np.ones(15)))
    left_over = data[:, 2:] - rows @ fitted.T
    np.testing.assert_allclose(rows.T @ left_over, 0.0, atol=1e-12)


@every_kind
@pytest.mark.parametrize("decades", [30.0, 160.0, 308.0])
def test_extreme_samples_raise_no_error(kind: Kind, decades: float) -> None:
    rng = np.random.default_rng(0)
    shape = (8, kind.model.n_columns)  # type: ignore[attr-defined]
    with np.errstate(all="ignore"):
        for _ in range(100):
            data = rng.uniform(-1.0, 1.0, shape) * 10.0 ** rng.uniform(-decades, decades, shape)
            for model in kind.model.solve(data[: kind.model.sample_size]):
                assert kind.model.residuals(model, data).shape == (8,)


def test_line_of_two_points_by_hand() -> None:
    line = only(Line().solve(np.array(((0.0, 1.0), (4.0, 4.0)))))
    np.testing.assert_allclose(up_to_sign(line), up_to_sign(np.array((-0.6, 0.8, -0.8))))
