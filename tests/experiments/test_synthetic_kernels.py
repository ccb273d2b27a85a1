import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.experiments.synthetic import kernels
from ransac_fix.experiments.synthetic.instances import make_instance
from ransac_fix.experiments.synthetic.runs import fit_both, run_instances, trial_tables
from ransac_fix.experiments.synthetic.setup import PAPER, Setup
from ransac_fix.reference.models import Ellipse

LINE = Setup("line", 50, 15)
ELLIPSE = Setup("ellipse", 60, 30)
M64 = 2**64 - 1


def stream(seed: int):
    """SplitMix64 in Python's own integers."""
    state = seed
    while True:
        state = (state + 0x9E3779B97F4A7C15) & M64
        z = state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & M64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & M64
        yield z ^ (z >> 31)


def distinct(numbers, n, k):
    sample = []
    while len(sample) < k:
        index = (next(numbers) >> 32) * n >> 32
        if index not in sample:
            sample.append(index)
    return sample


def plain_ransac(instance, setup, rule, solve, distances):
    """RANSAC as a textbook has it: the loop the compiled one must agree with."""
    numbers = stream(int(instance.streams[0]))
    n, k = setup.n_samples, setup.sample_size
    limit = {"distance": 3, "square": 3**0.5}[setup.limit]
    best, cost, held, done = 0, math.inf, None, 0
    while best < k or done < rule(best, n, k, setup.confidence):
        done += 1
        model = solve(instance.points[distinct(numbers, n, k)])
        while model is None and setup.conics == "redrawn":
            model = solve(instance.points[distinct(numbers, n, k)])
        if model is None:
            continue
        d = distances(model, instance.points) / instance.deviations
        count = int((d <= limit).sum())
        ties = {
            "first": math.inf,
            "inliers": float((d[d <= limit] ** 2).sum()),
            "all": float((d**2).sum()),
        }[setup.ties]
        if count > best or (count == best and ties < cost):
            best, cost, held = count, ties, model
    return done, held


def line_through(sample):
    (x1, y1), (x2, y2) = sample
    normal = np.array([y1 - y2, x2 - x1])
    normal /= np.linalg.norm(normal)
    return np.append(normal, -normal @ sample[0])


def line_distances(line, points):
    return np.abs(points @ line[:2] + line[2])


def ellipse_through(sample):
    found = Ellipse().solve(sample)
    return found[0] if found else None


def conic_axes(ellipse):
    """Centre, semi-axes a >= b and angle from the compiled code's matrix."""
    cx, cy, m0, m1, m2 = ellipse
    values, vectors = np.linalg.eigh([[m0, m1 / 2], [m1 / 2, m2]])
    return cx, cy, values[0] ** -0.5, values[1] ** -0.5, math.atan2(*vectors[::-1, 0])


@pytest.mark.parametrize("ties", ["first", "inliers", "all"])
@pytest.mark.parametrize("index", range(3))
def test_both_rules_on_lines_agree_with_the_textbook_loop(index, ties):
    setup = replace(LINE, ties=ties)
    instance = make_instance(setup, 1, index)
    trials, models = np.empty(2, np.int64), np.empty((2, 3))
    fit_both(setup, instance, trials, models)
    for i, rule in enumerate((approximate_required_trials, required_trials)):
        done, line = plain_ransac(instance, setup, rule, line_through, line_distances)
        assert trials[i] == done
        assert abs(models[i, :2] @ line[:2]) == pytest.approx(1, abs=1e-9)
        np.testing.assert_allclose(
            line_distances(models[i], instance.truth),
            line_distances(line, instance.truth),
            atol=1e-7,
        )


@pytest.mark.parametrize(
    "changes",
    [
        {"ties": "first"},
        {"ties": "inliers"},
        {"ties": "all"},
        {"conics": "redrawn"},
        {"scope": "measurement", "noise": "deviation"},
        {"limit": "square"},
        {"outliers": "clear"},
    ],
)
@pytest.mark.parametrize("index", range(2))
def test_both_rules_on_ellipses_agree_with_the_textbook_loop(index, changes):
    setup = replace(ELLIPSE, **changes)
    instance = make_instance(setup, 2, index)
    trials, models = np.empty(2, np.int64), np.empty((2, 5))
    fit_both(setup, instance, trials, models)
    model = Ellipse()
    for i, rule in enumerate((approximate_required_trials, required_trials)):
        done, ellipse = plain_ransac(instance, setup, rule, ellipse_through, model.residuals)
        assert trials[i] == done
        x, y = np.ascontiguousarray(instance.truth.T)
        np.testing.assert_allclose(
            kernels.ellipse_distances(x, y, models[i]),
            model.residuals(ellipse, instance.truth),
            atol=1e-6,
        )


@given(st.integers(0, 2**32), st.integers(0, 3))
@settings(max_examples=60, derandomize=True)
def test_ellipse_through_five_points_is_the_references(seed, squeeze):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-100, 100, (5, 2)) * [1, 10.0**-squeeze]
    ellipse = np.empty(5)
    sample = np.arange(5)
    found = kernels.ellipse_through(*np.ascontiguousarray(points.T), sample, ellipse)
    expected = ellipse_through(points)
    if expected is None or expected[2] > 1e6:
        return  # on the border to a parabola either may say so
    assert found
    cx, cy, a, b, _ = conic_axes(ellipse)
    np.testing.assert_allclose((cx, cy, a, b), expected[:4], rtol=1e-4, atol=1e-6)
    x, y = np.ascontiguousarray(points.T)
    assert kernels.ellipse_distances(x, y, ellipse).max() < 1e-6


# Coordinates that are 0 or far from the smallest floats, where the reference itself overflows.
COORDINATES = st.floats(-2000, 2000).map(lambda u: 0.0 if abs(u) < 1e-100 else u)


@given(st.floats(0.01, 1000), st.floats(1e-3, 1), COORDINATES, COORDINATES)
@settings(max_examples=200, derandomize=True)
def test_distance_to_an_ellipse_is_the_references(a, flatness, u, v):
    b = a * flatness
    expected = Ellipse().residuals(np.array([0, 0, a, b, 0]), np.array([[u, v]]))[0]
    assert kernels.distance_to_ellipse(a, b, u, v) == pytest.approx(
        expected, rel=1e-7, abs=1e-9 * a
    )


@given(st.integers(0, 2**32))
@settings(max_examples=100, derandomize=True)
def test_bounds_before_the_measurement_never_change_the_count(seed):
    """Thin and round ellipses, limits smaller and larger than their axes."""
    rng = np.random.default_rng(seed)
    a = 10 ** rng.uniform(0, 2.5)
    b = a * 10 ** rng.uniform(-2, 0)
    angle = rng.uniform(0, math.pi)
    cosine, sine = math.cos(angle), math.sin(angle)
    m = (cosine**2 / a**2 + sine**2 / b**2, sine**2 / a**2 + cosine**2 / b**2)
    cross = 2 * cosine * sine * (1 / a**2 - 1 / b**2)
    ellipse = np.array([*rng.uniform(-50, 50, 2), m[0], cross, m[1]])
    x, y = rng.uniform(-100, 100, (2, 300))
    limit = np.full(300, rng.uniform(0.5, 20))
    axes = np.empty(4)
    counted = kernels.count_geometric(x, y, limit, ellipse, 0, axes)
    assert counted == (kernels.ellipse_distances(x, y, ellipse) <= limit).sum()
    for to_beat in (counted, counted + 1, 300):
        bounded = kernels.count_geometric(x, y, limit, ellipse, to_beat, axes)
        assert bounded == counted if counted >= to_beat else bounded < to_beat


def test_sampson_is_the_geometric_distance_near_the_ellipse():
    ellipse = np.array([3.0, -2.0, 1 / 40**2, 0.0, 1 / 20**2])
    angle = np.linspace(0, 2 * math.pi, 100)
    x, y = 3 + 40.2 * np.cos(angle), -2 + 20.2 * np.sin(angle)
    distances = kernels.ellipse_distances(x, y, ellipse)
    just_above, just_below = distances.max() * 1.02, distances.min() * 0.98
    assert kernels.count_sampson(x, y, np.full(100, just_above), ellipse) == 100
    assert kernels.count_sampson(x, y, np.full(100, just_below), ellipse) == 0


def test_the_radial_distance_is_to_where_the_ray_from_the_centre_meets_the_ellipse():
    ellipse = np.array([3.0, -2.0, 1 / 40**2, 0.0, 1 / 20**2])
    angle = np.linspace(0, 2 * math.pi, 100)
    u, v = 40 * np.cos(angle), 20 * np.sin(angle)
    for off in (0.95, 1.1):
        x, y = 3 + off * u, -2 + off * v
        radial = abs(off - 1) * np.hypot(u, v)
        assert kernels.count_radial(x, y, radial * 1.000001, ellipse) == 100
        assert kernels.count_radial(x, y, radial * 0.999999, ellipse) == 0
        assert (kernels.ellipse_distances(x, y, ellipse) <= radial * 1.000001).all()


@pytest.mark.parametrize("shape", ["line", "ellipse"])
@pytest.mark.parametrize("limit", ["distance", "square"])
def test_clear_outliers_are_no_inliers_of_the_true_shape(shape, limit):
    setup = Setup(shape, 100, 30, outliers="clear", limit=limit, scope="measurement")
    anywhere = replace(setup, outliers="anywhere")
    near = []
    for i in range(40):
        instance, other = make_instance(setup, 4, i), make_instance(anywhere, 4, i)
        np.testing.assert_array_equal(instance.points[:30], other.points[:30])
        moved = (instance.points[30:] != other.points[30:]).any(axis=1)
        limits = {"distance": 3, "square": 3**0.5}[limit] * instance.deviations[30:]
        # The true shape, from its own points.
        if shape == "line":
            model = line_through(instance.truth[[0, 1]])
            distances = line_distances(model, other.points[30:])
            kept = line_distances(model, instance.points[30:])
        else:
            model = np.empty(5)
            x, y = np.ascontiguousarray(instance.truth.T)
            order = np.argsort(np.arctan2(*(instance.truth - instance.truth.mean(axis=0)).T))
            assert kernels.ellipse_through(x, y, order[::6].copy(), model)
            distances = kernels.ellipse_distances(*np.ascontiguousarray(other.points[30:].T), model)
            kept = kernels.ellipse_distances(*np.ascontiguousarray(instance.points[30:].T), model)
        np.testing.assert_array_equal(moved, distances <= limits)
        assert (kept > limits).all()
        near.append(moved.sum())
    assert sum(near) > 20


def test_samples_are_distinct_and_uniform():
    state = np.array([7], np.uint64)
    sample = np.empty(3, np.int64)
    counts = np.zeros((6, 6, 6), int)
    for _ in range(12_000):
        kernels.draw_distinct(state, 6, sample)
        counts[tuple(sample)] += 1
    drawn = np.array([c for index, c in np.ndenumerate(counts) if len(set(index)) == 3])
    assert drawn.sum() == 12_000
    assert stats.chisquare(drawn).pvalue > 1e-6


def test_trials_asked_for_are_the_criterions():
    approximate, exact = trial_tables(50, 2, Fraction(99, 100))
    for inliers in range(2, 51):
        assert approximate[inliers] == approximate_required_trials(inliers, 50, 2, 0.99)
        assert exact[inliers] == required_trials(inliers, 50, 2, 0.99)
    assert exact[1] == np.iinfo(np.int64).max


@pytest.mark.parametrize("shape", ["line", "ellipse"])
def test_instances_do_not_depend_on_how_they_are_grouped(shape):
    setup = LINE if shape == "line" else ELLIPSE
    whole = run_instances(setup, 3, 0, 12)
    parts = [run_instances(setup, 3, 0, 5), run_instances(setup, 3, 5, 12)]
    for name in ("gains", "trials", "tests"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(getattr(whole, name), joined)


@pytest.mark.parametrize("setup", [LINE, ELLIPSE], ids=["line", "ellipse"])
def test_the_exact_rule_goes_on_from_the_approximate_one(setup):
    runs = run_instances(setup, 0, 0, 200)
    assert (runs.trials[:, 1] >= runs.trials[:, 0]).all()
    stopped_together = runs.trials[:, 1] == runs.trials[:, 0]
    np.testing.assert_array_equal(runs.gains[stopped_together, 0], runs.gains[stopped_together, 1])
    assert ((runs.gains >= 0) & (runs.gains <= 1)).all()


def test_own_streams_share_the_instance_but_not_the_samples():
    own = run_instances(replace(LINE, streams="own"), 0, 0, 100)
    shared = run_instances(LINE, 0, 0, 100)
    np.testing.assert_array_equal(own.trials[:, 0], shared.trials[:, 0])
    assert (own.trials[:, 1] != shared.trials[:, 1]).any()
    assert (own.trials[:, 1] < own.trials[:, 0]).any()


@pytest.mark.parametrize("noise", ["determinant", "variance", "deviation"])
def test_noise_is_what_was_asked_for(noise):
    power = {"determinant": 4, "variance": 2, "deviation": 1}[noise]
    setup = replace(LINE, noise=noise)
    instances = [make_instance(setup, 5, i) for i in range(2000)]
    deviations = np.array([instance.deviations for instance in instances])
    assert (deviations == deviations[:, :1]).all()
    uniform = (deviations[:, 0] ** power - 0.5) / 1.5
    assert stats.kstest(uniform, "uniform").pvalue > 1e-6
    added = np.concatenate(
        [(i.points[: len(i.truth)] - i.truth).ravel() / i.deviations[0] for i in instances]
    )
    assert stats.kstest(added, "norm").pvalue > 1e-6


def test_each_measurement_can_have_its_own_noise():
    setup = replace(LINE, noise="variance", scope="measurement")
    instances = [make_instance(setup, 5, i) for i in range(200)]
    uniform = (np.concatenate([i.deviations for i in instances]) ** 2 - 0.5) / 1.5
    assert stats.kstest(uniform, "uniform").pvalue > 1e-6
    added = np.concatenate(
        [
            ((i.points[: len(i.truth)] - i.truth) / i.deviations[: len(i.truth), None]).ravel()
            for i in instances
        ]
    )
    assert stats.kstest(added, "norm").pvalue > 1e-6


def test_without_a_shape_all_measurements_are_outliers():
    instances = [make_instance(replace(LINE, placement="absent"), 5, i) for i in range(200)]
    uniform = np.concatenate([i.points.ravel() for i in instances]) / 200 + 0.5
    assert stats.kstest(uniform, "uniform").pvalue > 1e-6
    present = make_instance(LINE, 5, 0)
    np.testing.assert_array_equal(instances[0].truth, present.truth)


@pytest.mark.parametrize("shape", ["line", "ellipse"])
def test_whole_shapes_lie_in_the_box_and_free_ones_are_segments_or_may_leave_it(shape):
    free = Setup(shape, 100, 50)
    whole = replace(free, placement="whole")
    inside = [make_instance(whole, 0, i).truth for i in range(300)]
    assert max(np.abs(points).max() for points in inside) <= 100 + 1e-9
    extents = [np.ptp(make_instance(free, 0, i).truth, axis=0).max() for i in range(300)]
    if shape == "line":  # a chord spans the box in one direction or leaves through two walls
        assert np.mean([np.ptp(points, axis=0).max() for points in inside]) > np.mean(extents)
    else:
        assert max(np.abs(make_instance(free, 0, i).truth).max() for i in range(300)) > 100


@pytest.mark.parametrize("index", range(10))
def test_truth_lies_on_a_shape(index):
    truth = make_instance(Setup("ellipse", 60, 40), 0, index).truth
    ellipse = np.empty(5)
    x, y = np.ascontiguousarray(truth.T)
    spread = np.argsort(np.arctan2(*(truth - truth.mean(axis=0)).T))[::8].copy()
    assert kernels.ellipse_through(x, y, spread, ellipse)
    assert kernels.ellipse_distances(x, y, ellipse).max() < 1e-4
    line = make_instance(LINE, 0, index).truth
    assert np.linalg.svd(line - line.mean(axis=0))[1][1] < 1e-9


def test_the_papers_numbers_are_whole():
    for table in PAPER.values():
        assert sorted(table) == [Fraction(i, 10) for i in (2, 3, 4, 5)]
        for row in table.values():
            assert all(e > a for a, e in zip(row.approximate, row.exact, strict=True))
