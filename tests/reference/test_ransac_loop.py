"""The loop: what it finds, where it ends and what it says about that."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ransac_fix import approximate_required_trials, required_trials
from ransac_fix.reference import (
    Circle,
    DistinctSampler,
    FloatArray,
    Homography,
    IndexArray,
    Line,
    RansacResult,
    Recording,
    ReplacementSampler,
    StratifiedSampler,
    Trial,
    ransac,
)
from ransac_fix.reference.loop import _shuffled

THRESHOLD = 1e-9


def planted_lines(n: int, sizes: Sequence[int], seed: int) -> FloatArray:
    """Return points of which the first `sizes` lie on one line each, and the rest on none."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (n, 2))
    start = 0
    for slope, size in enumerate(sizes):
        x = points[start : start + size, 0]
        points[start : start + size, 1] = (slope - 0.37) * x + rng.uniform(-1.0, 1.0)
        start += size
    return points


def same(one: RansacResult[Any], other: RansacResult[Any]) -> bool:
    """Return whether two results agree in everything."""

    def plain(result: RansacResult[Any]) -> tuple[object, ...]:
        arrays = (result.model, result.inliers, result.refit)
        return (
            *(None if a is None else a.tolist() for a in arrays),
            result.n_inliers,
            result.trials,
            result.required_trials,
            result.enumerated,
            result.ended,
        )

    return plain(one) == plain(other)


class CircleOfRadius:
    """A circle of known radius: up to two models through 2 points."""

    sample_size = 2

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def solve(self, sample: FloatArray) -> list[FloatArray]:
        p, q = sample
        half = (q - p) / 2.0
        rest = self.radius**2 - float(half @ half)
        if not half.any() or rest <= 0.0:
            return []
        offset = np.array((-half[1], half[0])) * math.sqrt(rest / float(half @ half))
        return [p + half + offset, p + half - offset]

    def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
        distances: FloatArray = np.abs(np.hypot(*(data - model).T) - self.radius)
        return distances

    def refit(self, data: FloatArray) -> FloatArray | None:
        return None


class OwnSampler:
    """A sampler that has nothing but `draw`."""

    def draw(self, rng: np.random.Generator) -> IndexArray:
        return rng.choice(12, 2, replace=False)


# Where a run ends.


@given(
    st.integers(3, 10),
    st.integers(10, 20),
    st.sampled_from([0.1, 0.5, 0.9, 0.99, 0.9999]),
    st.sampled_from([required_trials, approximate_required_trials]),
    st.integers(0, 2**32),
)
@settings(max_examples=150, deadline=None)
def test_a_run_ends_with_the_required_trials_of_the_model_in_hand(
    n_inliers: int, n: int, confidence: float, rule: Any, seed: int
) -> None:
    found = 0
    most = 0

    def watch(number: int, trial: Trial[FloatArray]) -> None:
        nonlocal found, most
        for candidate in trial.candidates:
            if candidate.n_inliers > most:
                found, most = number, candidate.n_inliers

    result = ransac(
        planted_lines(n, [n_inliers], seed),
        Line(),
        residual_threshold=THRESHOLD,
        confidence=confidence,
        stopping_rule=rule,
        on_trial=watch,
        rng=seed,
    )
    required = rule(result.n_inliers, n, 2, confidence)
    assert result.required_trials == required
    assert result.n_inliers == most == np.count_nonzero(result.inliers)
    # Found later than its own required number, a model ends the run at once.
    assert result.trials == max(required, found)
    assert result.ended == "rule"
    assert not result.enumerated


def test_planted_data_takes_exactly_the_required_trials() -> None:
    data = planted_lines(20, [8], seed=0)
    for confidence in (0.9, 0.99, 0.999999):
        result = ransac(data, Line(), residual_threshold=THRESHOLD, confidence=confidence, rng=1)
        assert result.n_inliers == 8
        assert result.trials == required_trials(8, 20, 2, confidence)
        assert result.inliers.tolist() == [True] * 8 + [False] * 12


def naive_trials(
    data: FloatArray, rule: Any, confidence: float, cap: int, low: int, offset: int, seed: int
) -> int:
    """Count the trials of a line RANSAC written out plainly, sharing nothing but the sampler."""
    sampler, rng = DistinctSampler(len(data), 2), np.random.default_rng(seed)
    bound, most, done = math.inf, 0, 0
    while True:
        p, q = data[sampler.draw(rng)]
        area = (q[0] - p[0]) * (data[:, 1] - p[1]) - (q[1] - p[1]) * (data[:, 0] - p[0])
        count = int((abs(area) / math.dist(p, q) <= THRESHOLD).sum())
        done += 1
        if count > most:
            most = count
            bound = rule(count, len(data), 2, confidence) + offset
        if done >= cap or (done >= bound and done >= low):
            return done


@given(
    st.lists(st.integers(2, 6), min_size=1, max_size=3),
    st.floats(0.05, 0.9999),
    st.integers(1, 120),
    st.integers(0, 60),
    st.integers(-1, 2),
    st.integers(0, 2**32),
)
@settings(max_examples=100, deadline=None)
def test_a_plainly_written_loop_and_a_recording_agree(
    sizes: list[int], confidence: float, cap: int, low: int, offset: int, seed: int
) -> None:
    data = planted_lines(18, sizes, seed)
    low = min(low, cap)
    options: dict[str, Any] = {
        "confidence": confidence,
        "max_trials": cap,
        "min_trials": low,
        "offset": offset,
    }
    recording = Recording(data, Line(), residual_threshold=THRESHOLD, rng=seed)
    for rule in (required_trials, approximate_required_trials):
        result = ransac(
            data,
            Line(),
            residual_threshold=THRESHOLD,
            stopping_rule=rule,
            rng=seed,
            **options,
        )
        assert result.trials == naive_trials(data, rule, confidence, cap, low, offset, seed)
        assert same(result, recording.run(stopping_rule=rule, **options))
    # Whatever was recorded before, in whatever order.
    assert same(
        recording.run(confidence=0.5, max_trials=7),
        ransac(data, Line(), residual_threshold=THRESHOLD, confidence=0.5, max_trials=7, rng=seed),
    )


def test_a_recording_evaluates_each_trial_once() -> None:
    solved = 0

    class CountingLine(Line):
        def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
            nonlocal solved
            solved += 1
            return super().solve(sample)

    recording = Recording(
        planted_lines(16, [6], seed=0), CountingLine(), residual_threshold=THRESHOLD, rng=0
    )
    trials = [recording.run(confidence=s).trials for s in (0.5, 0.999, 0.9, 0.999)]
    assert solved == len(recording) == max(trials)
    ahead = [t.sample.tolist() for t in itertools.islice(recording, solved + 5)]
    assert solved == len(recording) == len(ahead)
    assert [t.sample.tolist() for t in itertools.islice(recording, 5)] == ahead[:5]


def test_interleaved_readers_of_a_recording_see_the_same_trials() -> None:
    recording = Recording(planted_lines(9, [4], 0), Line(), residual_threshold=THRESHOLD, rng=0)
    one, other = iter(recording), iter(recording)
    seen_by_one = [next(one) for _ in range(3)]
    seen_by_other = [next(other) for _ in range(6)]
    seen_by_one += [next(one) for _ in range(5)]
    seen_by_other += [next(other) for _ in range(2)]
    assert all(a is b for a, b in zip(seen_by_one, seen_by_other, strict=True))


@pytest.mark.parametrize("strategy", ["sample", "auto"])
def test_the_samples_depend_on_the_stream_alone(strategy: Any) -> None:
    data = planted_lines(12, [5, 4], seed=3)

    def samples(**options: Any) -> list[list[int]]:
        seen: list[list[int]] = []
        ransac(
            data,
            Line(),
            residual_threshold=THRESHOLD,
            strategy=strategy,
            rng=9,
            on_trial=lambda _, trial: seen.append(trial.sample.tolist()),
            **options,
        )
        return seen

    longest = samples(min_trials=60)
    for options in (
        {"confidence": 0.3},
        {"confidence": 0.9999},
        {"max_trials": 5},
        {"stopping_rule": approximate_required_trials},
        {"offset": 2},
    ):
        shorter = samples(**options)
        assert 0 < len(shorter) <= len(longest)
        assert shorter == longest[: len(shorter)]


def test_a_bound_tested_on_improvement_alone_runs_to_its_cap() -> None:
    data = planted_lines(16, [7], seed=2)
    usual = ransac(data, Line(), residual_threshold=THRESHOLD, max_trials=500, rng=3)
    defect = ransac(
        data, Line(), residual_threshold=THRESHOLD, max_trials=500, rng=3, tested="improvement"
    )
    assert usual.trials == required_trials(7, 16, 2, 0.99)
    assert (defect.trials, defect.ended) == (500, "max_trials")
    # Without a cap it ends all the same.
    endless = ransac(data, Line(), residual_threshold=THRESHOLD, rng=3, tested="improvement")
    assert (endless.trials, endless.ended) == (math.comb(16, 2), "n_subsets")
    # With a bound below the trial that improves, it ends there.
    at_once = ransac(
        data,
        Line(),
        residual_threshold=THRESHOLD,
        stopping_rule=lambda *_: 1,
        rng=3,
        tested="improvement",
    )
    assert (at_once.trials, at_once.ended) == (1, "rule")


def test_the_rule_is_asked_when_the_model_in_hand_changes() -> None:
    asked: list[tuple[Any, ...]] = []

    def rule(*arguments: Any) -> int | float:
        asked.append(arguments)
        return required_trials(*arguments)

    result = ransac(
        planted_lines(15, [6, 4], seed=1),
        Line(),
        residual_threshold=THRESHOLD,
        confidence=0.95,
        stopping_rule=rule,
        rng=4,
    )
    counts = [arguments[0] for arguments in asked]
    assert all(type(count) is int for count in counts)
    assert counts == sorted(set(counts))
    assert counts[-1] == result.n_inliers
    assert {arguments[1:] for arguments in asked} == {(15, 2, 0.95)}


def test_the_minimum_and_the_maximum_bind() -> None:
    data = planted_lines(12, [9], seed=0)
    capped = ransac(data, Line(), residual_threshold=THRESHOLD, max_trials=1, rng=0)
    assert (capped.trials, capped.ended) == (1, "max_trials")
    assert capped.required_trials > 1
    floor = ransac(data, Line(), residual_threshold=THRESHOLD, min_trials=300, rng=0)
    assert (floor.trials, floor.ended) == (300, "rule")
    assert floor.required_trials == required_trials(9, 12, 2, 0.99)


# Runs that no rule would end.


@pytest.mark.parametrize(
    ("options", "trials", "ended"),
    [
        ({}, 28, "n_subsets"),
        ({"strategy": "auto"}, 28, "enumerated"),
        ({"strategy": "enumerate"}, 28, "enumerated"),
        ({"max_trials": 40}, 40, "max_trials"),
        ({"max_trials": 40, "strategy": "auto"}, 28, "enumerated"),
        ({"max_trials": 28, "strategy": "auto"}, 28, "enumerated"),
        ({"max_trials": 9, "strategy": "auto"}, 9, "max_trials"),
        ({"min_trials": 50}, 50, "n_subsets"),
        ({"sampler": ReplacementSampler(8, 2)}, 28, "n_subsets"),
    ],
)
def test_a_run_without_any_model_ends(options: Any, trials: int, ended: str) -> None:
    one_point = np.ones((8, 2))
    result = ransac(one_point, Line(), residual_threshold=1.0, rng=0, **options)
    assert result.model is None
    assert result.refit is None
    assert result.n_inliers == 0
    assert not result.inliers.any()
    assert (result.trials, result.ended) == (trials, ended)
    assert result.enumerated == (ended == "enumerated")
    assert result.required_trials == math.inf


@pytest.mark.parametrize(("strategy", "ended"), [("sample", "n_subsets"), ("auto", "enumerated")])
def test_a_run_that_wants_certainty_ends(strategy: Any, ended: str) -> None:
    result = ransac(
        planted_lines(10, [6], seed=0),
        Line(),
        residual_threshold=THRESHOLD,
        confidence=1.0,
        strategy=strategy,
        rng=0,
    )
    assert (result.trials, result.ended) == (45, ended)
    assert result.n_inliers == 6


def test_no_confidence_at_all_still_takes_one_trial() -> None:
    result = ransac(
        planted_lines(10, [6], seed=0), Line(), residual_threshold=THRESHOLD, confidence=0, rng=0
    )
    assert (result.trials, result.required_trials) == (1, 0)


def test_a_model_may_miss_its_own_sample() -> None:
    # With fewer inliers than a sample holds, the exact rule is infinite.
    class Far(Line):
        def residuals(self, model: FloatArray, data: FloatArray) -> FloatArray:
            return np.where(np.arange(len(data)) == 3, 0.0, np.nan)

    result = ransac(planted_lines(9, [], 0), Far(), residual_threshold=0.0, rng=0)
    assert (result.n_inliers, result.required_trials) == (1, math.inf)
    assert (result.trials, result.ended) == (36, "n_subsets")


# Enumeration.


@given(
    st.integers(5, 11),
    st.lists(st.integers(2, 4), max_size=2),
    st.floats(0.0, 0.3),
    st.integers(0, 2**32),
)
@settings(max_examples=60, deadline=None)
def test_enumeration_finds_the_largest_consensus(
    n: int, sizes: list[int], threshold: float, seed: int
) -> None:
    data = planted_lines(n, sizes, seed)
    largest = 0
    for p, q in itertools.combinations(data, 2):
        area = (q[0] - p[0]) * (data[:, 1] - p[1]) - (q[1] - p[1]) * (data[:, 0] - p[0])
        largest = max(largest, int((abs(area) <= (threshold + 1e-9) * math.dist(p, q)).sum()))
    tried: set[tuple[int, ...]] = set()
    result = ransac(
        data,
        Line(),
        residual_threshold=threshold + 1e-9,
        strategy="enumerate",
        on_trial=lambda _, trial: tried.add(tuple(trial.sample.tolist())),
    )
    assert result.n_inliers == largest
    assert tried == set(itertools.combinations(range(n), 2))
    assert result.trials == math.comb(n, 2)
    assert result.enumerated
    assert result.ended == "enumerated"
    assert result.required_trials == required_trials(largest, n, 2, 0.99)
    certain = ransac(
        data,
        Line(),
        residual_threshold=threshold + 1e-9,
        strategy="auto",
        confidence=1,
        rng=seed,
    )
    assert certain.n_inliers == largest


@given(st.integers(4, 9), st.integers(2, 9), st.floats(0.5, 0.999999), st.integers(0, 2**32))
@settings(max_examples=100, deadline=None)
def test_auto_enumerates_where_that_takes_no_more_trials(
    n: int, n_inliers: int, confidence: float, seed: int
) -> None:
    data = planted_lines(n, [min(n, n_inliers)], seed)
    tried: list[frozenset[int]] = []
    result = ransac(
        data,
        Line(),
        residual_threshold=THRESHOLD,
        confidence=confidence,
        strategy="auto",
        on_trial=lambda _, trial: tried.append(frozenset(trial.sample.tolist())),
        rng=seed,
    )
    n_subsets = math.comb(n, 2)
    assert len(tried) == len(set(tried)) == result.trials <= n_subsets
    assert result.enumerated == (result.trials == n_subsets)
    assert result.ended == ("enumerated" if result.enumerated else "rule")
    if result.required_trials >= n_subsets:
        assert result.enumerated
    if result.enumerated:
        assert result.n_inliers == min(n, n_inliers)
    else:
        assert result.trials >= result.required_trials


def test_every_order_of_the_subsets_is_equally_likely() -> None:
    rng = np.random.default_rng(5)
    orders = list(itertools.permutations(range(4)))
    counts = dict.fromkeys(orders, 0)
    for _ in range(200 * len(orders)):
        counts[tuple(int(s[0]) for s in _shuffled(DistinctSampler(4, 1), rng))] += 1
    assert stats.chisquare(list(counts.values())).pvalue > 1e-3


def test_auto_samples_where_the_subsets_cannot_be_numbered() -> None:
    data = planted_lines(10_000, [9_000], seed=0)

    class SixPointLine(Line):
        sample_size = 6

        def solve(self, sample: FloatArray) -> Sequence[FloatArray]:
            return super().solve(sample[:2])

    assert math.comb(10_000, 6) > 2**63
    result = ransac(data, SixPointLine(), residual_threshold=THRESHOLD, strategy="auto", rng=0)
    assert result.n_inliers == 9_000
    assert result.trials == required_trials(9_000, 10_000, 6, 0.99)


def test_strata_are_enumerated_and_counted_as_strata() -> None:
    # Two points of the line lie in a stratum of 4, the others in one of 8.
    data = planted_lines(12, [6], seed=6)
    sampler = StratifiedSampler([([0, 1, 10, 11], 1), (list(range(2, 10)), 1)])
    everything = ransac(
        data, Line(), residual_threshold=THRESHOLD, sampler=sampler, strategy="enumerate"
    )
    assert (everything.trials, everything.n_inliers) == (32, 6)
    result = ransac(data, Line(), residual_threshold=THRESHOLD, sampler=sampler, rng=0)
    law = sampler.sampling(result.inliers)
    assert result.n_inliers == 6
    assert result.required_trials == required_trials(6, 12, 2, 0.99, sampling=law) == 17
    assert required_trials(6, 12, 2, 0.99) == 18
    assert result.trials == 17


def test_the_default_rule_follows_the_sampler() -> None:
    data = planted_lines(8, [4], seed=0)
    sampler = ReplacementSampler(8, 2)
    result = ransac(data, Line(), residual_threshold=THRESHOLD, sampler=sampler, rng=1)
    assert result.trials == required_trials(4, 8, 2, 0.99, sampling="replacement")
    assert result.trials > required_trials(4, 8, 2, 0.99)


# Models and results.


def test_all_models_of_a_sample_are_verified() -> None:
    rng = np.random.default_rng(0)
    angles = rng.uniform(0.0, 2.0 * np.pi, 7)
    data = rng.uniform(-3.0, 3.0, (14, 2))
    data[:7] = np.column_stack((np.cos(angles), np.sin(angles))) + np.array((0.5, -0.25))
    model = CircleOfRadius(1.0)
    right_was: set[int] = set()

    def watch(_: int, trial: Trial[FloatArray]) -> None:
        assert len(trial.candidates) in (0, 2)
        right_was.update(i for i, c in enumerate(trial.candidates) if c.n_inliers == 7)

    result = ransac(data, model, residual_threshold=1e-9, min_trials=100, on_trial=watch, rng=0)
    assert right_was == {0, 1}
    assert result.n_inliers == 7
    assert result.model is not None
    np.testing.assert_allclose(result.model, np.array((0.5, -0.25)), atol=1e-12)
    assert result.refit is None


def test_the_first_of_equal_models_stays() -> None:
    data = planted_lines(12, [5, 5], seed=0)
    result = ransac(data, Line(), residual_threshold=THRESHOLD, strategy="enumerate")
    assert result.inliers.tolist() == [True] * 5 + [False] * 7


def test_a_residual_at_the_threshold_is_an_inlier() -> None:
    data = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 0.5], [2.0, 0.75]])
    on = ransac(data, Line(), residual_threshold=0.5, max_trials=1, sampler=First())
    assert on.inliers.tolist() == [True, True, True, False]


class First:
    """A sampler that always draws the first two measurements."""

    def draw(self, rng: np.random.Generator) -> IndexArray:
        return np.array([0, 1], dtype=np.intp)

    def sampling(self, inliers: object) -> Any:
        return "distinct"


def test_the_refit_uses_all_inliers() -> None:
    rng = np.random.default_rng(7)
    data = planted_lines(60, [40], seed=7)
    data[:40, 1] += rng.normal(0.0, 0.01, 40)
    result = ransac(data, Line(), residual_threshold=0.03, rng=7)
    inliers = data[result.inliers]
    expected = Line().refit(inliers)
    np.testing.assert_array_equal(result.refit, expected)
    assert ransac(data, Line(), residual_threshold=0.03, rng=7, refit=False).refit is None


def test_a_generator_is_used_as_it_is() -> None:
    data = planted_lines(12, [6], seed=0)
    generator = np.random.default_rng(11)
    first = ransac(data, Line(), residual_threshold=THRESHOLD, rng=generator)
    assert same(first, ransac(data, Line(), residual_threshold=THRESHOLD, rng=11))
    sampler, expected = DistinctSampler(12, 2), np.random.default_rng(11)
    for _ in range(first.trials):
        sampler.draw(expected)
    assert generator.bit_generator.state == expected.bit_generator.state


def test_any_object_that_draws_is_a_sampler() -> None:
    data = planted_lines(12, [6], seed=0)
    result = ransac(
        data,
        Line(),
        residual_threshold=THRESHOLD,
        sampler=OwnSampler(),
        stopping_rule=required_trials,
        rng=0,
    )
    assert result.trials == required_trials(6, 12, 2, 0.99)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"confidence": 1.5}, "confidence"),
        ({"max_trials": 0}, "max_trials must be at least 1"),
        ({"min_trials": -1}, "min_trials must not be negative"),
        ({"min_trials": 5, "max_trials": 4}, "min_trials must not exceed max_trials = 4"),
        ({"residual_threshold": -1.0}, "residual_threshold must not be negative"),
        ({"residual_threshold": math.nan}, "residual_threshold must not be negative"),
        ({"strategy": "all"}, "strategy must be"),
        ({"strategy": "enumerate", "max_trials": 65}, "at least the number of subsets, 66"),
        ({"tested": "never"}, "tested must be"),
        ({"sampler": OwnSampler()}, "OwnSampler does not state its sampling law"),
        ({"sampler": OwnSampler(), "strategy": "auto"}, "OwnSampler cannot number its subsets"),
        ({"sampler": ReplacementSampler(12, 2), "strategy": "auto"}, "cannot number its subsets"),
        ({"sampler": DistinctSampler(11, 2)}, "sampler must have n_samples = 12, not 11"),
        ({"sampler": DistinctSampler(12, 3)}, "sampler must have sample_size = 2, not 3"),
    ],
)
def test_bad_arguments_are_named(options: dict[str, Any], message: str) -> None:
    arguments = {"residual_threshold": THRESHOLD, "rng": 0} | options
    with pytest.raises(ValueError, match=message):
        ransac(planted_lines(12, [6], seed=0), Line(), **arguments)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (np.zeros((5, 3)), r"data must have shape \(n_samples, 2\), not \(5, 3\)"),
        (np.zeros(5), r"data must have shape \(n_samples, 2\), not \(5,\)"),
        (np.zeros((1, 2)), "data must have at least 2 rows for one sample, not 1"),
        (np.array([[0.0, np.nan], [1.0, 2.0]]), "data must be finite"),
    ],
)
def test_bad_data_are_named(data: FloatArray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ransac(data, Line(), residual_threshold=THRESHOLD)


@pytest.mark.parametrize("model", [Circle(), Homography()])
def test_as_few_measurements_as_a_sample_holds(model: Any) -> None:
    data = np.random.default_rng(0).uniform(size=(model.sample_size, model.n_columns))
    result = ransac(data, model, residual_threshold=1e-9, rng=0)
    assert (result.n_inliers, result.trials) == (model.sample_size, 1)
