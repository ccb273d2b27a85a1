"""PoseLib's estimators keep their promise: by the iterations they report and by outcomes."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations
from types import ModuleType
from typing import Any

import numpy as np
import poselib
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_views import CAMERA, Planted, chance_of_larger, likelihood_ratio, plant

from ransac_fix import approximate_required_trials, patched, required_trials, status, unpatch
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import poselib as patch_file
from ransac_fix.patching import missing

PINHOLE = {
    "model": "PINHOLE",
    "width": 640,
    "height": 480,
    "params": [800.0, 800.0, 320.0, 240.0],
}
CENTRE = CAMERA[:2, 2]


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("RANSAC_FIX_SLACK", "0")
    monkeypatch.setattr(missing, "_slack", 0.0)
    yield
    unpatch("poselib")


def options(confidence: float = 0.5, seed: int = 0, **more: Any) -> dict[str, Any]:
    return {
        "min_iterations": 0,
        "dyn_num_trials_mult": 1.0,
        "success_prob": confidence,
        "seed": seed,
        "max_reproj_error": 0.02,
        "max_epipolar_error": 0.01,
        **more,
    }


@dataclass(frozen=True, slots=True)
class Case:
    """One estimator on one planted problem; `chance` as in the tests of OpenCV."""

    kind: str
    n_samples: int
    sizes: tuple[int, int]
    sample_size: int
    call: Callable[[Any, Planted, dict[str, Any]], tuple[Any, dict[str, Any]]]
    chance: float = 1.0


CASES = {
    "estimate_absolute_pose": Case(
        "pose", 14, (5, 6), 3, lambda f, p, o: f(p.y, p.x, PINHOLE, o, {}), 1.1
    ),
    "estimate_relative_pose": Case(
        "two views", 16, (7, 8), 5, lambda f, p, o: f(p.x, p.y, PINHOLE, PINHOLE, o, {}), 1.1
    ),
    "estimate_shared_focal_relative_pose": Case(
        "two views",
        18,
        (8, 9),
        6,
        lambda f, p, o: f(p.x - CENTRE, p.y - CENTRE, np.zeros(2), o, {}),
    ),
    "estimate_fundamental": Case(
        "two views", 20, (9, 10), 7, lambda f, p, o: f(p.x, p.y, ransac_opt=o), 0.85
    ),
    "estimate_homography": Case("affine", 14, (5, 6), 4, lambda f, p, o: f(p.x, p.y, o, {}), 1.1),
    "estimate_1D_radial_absolute_pose": Case(
        "pose", 16, (7, 8), 5, lambda f, p, o: f(p.y - CENTRE, p.x, o, {}), 1.15
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_outcomes_are_those_of_the_exact_number_of_trials(name: str) -> None:
    case = CASES[name]
    setting = case.sizes[0], case.n_samples, case.sample_size, 0.5
    total = math.comb(case.n_samples, case.sample_size)
    hits = [case.chance * math.comb(size, case.sample_size) / total for size in case.sizes]
    likely = chance_of_larger(required_trials(*setting), *hits)
    unlikely = chance_of_larger(approximate_required_trials(*setting), *hits)

    def run(seed: int) -> bool:
        planted = plant(case.kind, case.n_samples, case.sizes, seed)
        _, info = case.call(getattr(poselib, name), planted, options(seed=seed))
        return planted.found(np.array(info["inliers"])) == 1

    with patched("poselib"):
        is_exact, successes, runs = likelihood_ratio(run, likely, unlikely, error=1e-3)
    assert is_exact, f"{successes} of {runs}: exact {likely:.3f}, approximate {unlikely:.3f}"


@pytest.mark.parametrize("raising", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_iterations_run_make_the_required_number(
    name: str, raising: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = CASES[name]
    if not raising:
        monkeypatch.setattr(
            patch_file, "raised_confidence", lambda _n, _k, confidence, *_, **__: confidence
        )
    counts: list[int] = []
    inliers: list[int] = []

    def counting(*args: Any, **kwargs: Any) -> Any:
        result = getattr(poselib, name)(*args, **kwargs)
        counts.append(result[1]["iterations"])
        inliers.append(result[1]["num_inliers"])
        return result

    exact = patch_file._wrap(counting, patch_file._ESTIMATORS[name])
    second_runs = 0
    for seed in range(20):
        planted = plant(case.kind, case.n_samples, (case.sizes[1],), seed)
        counts.clear()
        inliers.clear()
        _, info = case.call(exact, planted, options(0.9, seed))
        needed = required_trials(info["num_inliers"], case.n_samples, case.sample_size, 0.9)
        if inliers[0] == info["num_inliers"]:
            assert sum(counts) == max(counts[0], needed)
            second_runs += len(counts) == 2
    assert raising or second_runs > 5


def test_the_user_s_limit_wins() -> None:
    planted = plant("affine", 14, (5, 6), 0)
    with patched("poselib"):
        settings = options(0.9999, max_iterations=120)
        _, info = poselib.estimate_homography(planted.x, planted.y, settings, {})
    assert info["iterations"] <= 120


def test_results_repeat_and_the_options_are_left_alone() -> None:
    planted = plant("two views", 20, (9, 10), 3)
    settings = options(0.5, 3)
    before = dict(settings)
    with patched("poselib"):
        first = poselib.estimate_fundamental(planted.x, planted.y, settings, {})
        second = poselib.estimate_fundamental(planted.x, planted.y, ransac_opt=settings)
    assert settings == before
    np.testing.assert_array_equal(first[0], second[0])
    assert first[1] == second[1]
    bare = poselib.estimate_fundamental(planted.x, planted.y, settings, {})
    assert set(bare[1]) == set(first[1])
    assert first[1]["model_score"] <= bare[1]["model_score"]


def test_points_and_lines_are_one_pool() -> None:
    planted = plant("pose", 16, (6,), 0)
    pose, _ = poselib.estimate_absolute_pose(planted.y, planted.x, PINHOLE, options(0.999), {})
    rng = np.random.default_rng(0)
    ends = rng.uniform(-2, 2, (2, 6, 3))
    image = (ends @ pose.R.T + pose.t) @ CAMERA.T
    image = image[..., :2] / image[..., 2:]
    image[:, 3:] += rng.uniform(-90, 90, (2, 3, 2))
    total = []

    def counting(*args: Any, **kwargs: Any) -> Any:
        result = poselib.estimate_absolute_pose_pnpl(*args, **kwargs)
        total.append(result[1]["iterations"])
        return result

    name = "estimate_absolute_pose_pnpl"
    exact = patch_file._wrap(counting, patch_file._ESTIMATORS[name])
    _, info = exact(planted.y, planted.x, *image, *ends, PINHOLE, options(0.99), {})
    assert info["num_inliers"] == 9
    assert sum(total) == max(total[0], required_trials(9, 22, 3, 0.99))


def test_the_chance_of_a_sample_over_cameras_of_different_size() -> None:
    """One iteration at a time: the camera is drawn first, then one of its points."""
    sizes = 4, 16
    inliers = 3, 5
    expected = patch_file._chance_by_camera(list(zip(inliers, sizes, strict=True)))
    pooled = math.comb(8, 3) / math.comb(20, 3)
    assert expected > 1.5 * pooled
    rng = np.random.default_rng(5)
    points = rng.uniform(-2, 2, (20, 3))
    image = (points + np.array([0, 0, 8])) @ CAMERA.T
    image = image[:, :2] / image[:, 2:]
    outliers = np.ones(20, bool)
    outliers[[0, 1, 2, 4, 5, 6, 7, 8]] = False
    image[outliers] = rng.uniform((0, 0), (640, 480), (outliers.sum(), 2))
    cut = [slice(0, 4), slice(4, 20)]
    poses = [poselib.CameraPose(), poselib.CameraPose()]

    def run(seed: int) -> bool:
        settings = options(0.9, seed, min_iterations=1, max_iterations=1)
        _, info = poselib.estimate_generalized_absolute_pose(
            [image[c] for c in cut], [points[c] for c in cut], poses, [PINHOLE] * 2, settings, {}
        )
        return bool(np.array_equal(np.concatenate(info["inliers"]), ~outliers))

    is_weighted, successes, runs = likelihood_ratio(run, expected, pooled)
    assert is_weighted, f"{successes} of {runs}: {expected:.4f}, not {pooled:.4f}"


def test_generalized_absolute_pose_runs_what_its_sampler_needs() -> None:
    planted = plant("pose", 18, (7,), 0)
    cut = [slice(0, 6), slice(6, 18)]
    poses = [poselib.CameraPose(), poselib.CameraPose()]
    counts = []

    def counting(*args: Any, **kwargs: Any) -> Any:
        result = poselib.estimate_generalized_absolute_pose(*args, **kwargs)
        counts.append(result[1]["iterations"])
        return result

    name = "estimate_generalized_absolute_pose"
    exact = patch_file._wrap(counting, patch_file._ESTIMATORS[name])
    _, info = exact(
        [planted.y[c] for c in cut],
        [planted.x[c] for c in cut],
        poses,
        [PINHOLE] * 2,
        options(0.99),
        {},
    )
    cameras = [(sum(inliers), len(inliers)) for inliers in info["inliers"]]
    assert sum(i for i, _ in cameras) == 7
    chance = patch_file._chance_by_camera(cameras)
    needed = math.ceil(math.log1p(-0.99) / math.log1p(-chance))
    assert sum(counts) == max(counts[0], needed)


def test_generalized_relative_pose_runs_what_its_sampler_needs() -> None:
    rng = np.random.default_rng(0)
    sine, cosine = math.sin(0.2), math.cos(0.2)
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    matches, poses = [], []
    for number, (n_inliers, n_samples) in enumerate([(7, 10), (4, 12)]):
        pose = poselib.CameraPose()
        pose.t = np.array([0.9 * number, 0.2 * number, 0.0])
        points = rng.uniform((-2, -2, 4), (2, 2, 9), (n_samples, 3))
        sides = []
        for moved in (points, points @ turn.T + np.array([0.3, 0.1, 0.5])):
            image = (moved + pose.t) @ CAMERA.T
            sides.append(image[:, :2] / image[:, 2:])
        sides[1][n_inliers:] = rng.uniform(0, 640, (n_samples - n_inliers, 2))
        pair = poselib.PairwiseMatches()
        pair.cam_id1 = pair.cam_id2 = number
        pair.x1, pair.x2 = sides
        matches.append(pair)
        poses.append(pose)
    counts: list[int] = []

    def counting(*args: Any, **kwargs: Any) -> Any:
        result = poselib.estimate_generalized_relative_pose(*args, **kwargs)
        counts.append(result[1]["iterations"])
        return result

    name = "estimate_generalized_relative_pose"
    exact = patch_file._wrap(counting, patch_file._ESTIMATORS[name])
    cameras = poses, [PINHOLE] * 2
    second_runs = 0
    for seed in range(5):
        counts.clear()
        _, info = exact(matches, *cameras, *cameras, options(0.9, seed), {})
        pairs = [(sum(inliers), len(inliers)) for inliers in info["inliers"]]
        assert pairs == [(7, 10), (4, 12)]
        needed = math.ceil(math.log(0.1) / math.log1p(-patch_file._chance_by_pair(pairs)))
        assert sum(counts) == max(counts[0], needed)
        second_runs += len(counts) > 1
    assert second_runs


@given(
    st.lists(
        st.integers(0, 9).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))),
        min_size=2,
        max_size=5,
    )
)
def test_the_chance_of_five_matches_of_one_pair_and_one_of_another(
    pairs: list[tuple[int, int]],
) -> None:
    chances = [
        Fraction(math.comb(inliers, 5), math.comb(n_samples, 5)) * Fraction(others, of)
        for (inliers, n_samples), (others, of) in permutations(pairs, 2)
        if n_samples >= 5 and of > 0
    ]
    expected = sum(chances) / len(chances) if chances else 1
    assert patch_file._chance_by_pair(pairs) == pytest.approx(float(expected), abs=1e-15)


@pytest.mark.parametrize("matches", [[], ["a pair"]])
def test_hybrid_pose_is_exact_without_matches_to_a_map(matches: list[str]) -> None:
    planted = plant("pose", 14, (5, 6), 0)
    counts = []

    def counting(x: Any, points: Any, _: Any, *args: Any, **kwargs: Any) -> Any:
        # With matches the library would read beyond its points.
        result = poselib.estimate_hybrid_pose(x, points, [], *args, **kwargs)
        counts.append(result[1]["iterations"])
        return result

    exact = patch_file._wrap(counting, patch_file._ESTIMATORS["estimate_hybrid_pose"])
    no_cameras: list[Any] = []
    settings = options(0.9, 1)
    rest = PINHOLE, [], no_cameras, settings, {}
    _, bare = poselib.estimate_hybrid_pose(planted.y, planted.x, [], *rest)
    _, info = exact(planted.y, planted.x, matches, *rest)
    needed = required_trials(info["num_inliers"], 14, 3, 0.9)
    assert needed > bare["iterations"]
    assert sum(counts) == (bare["iterations"] if matches else max(counts[0], needed))


def test_no_model_does_not_hang() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1000, (2, 200, 2))
    settings = options(0.99, max_iterations=2000)
    with patched("poselib"):
        _, info = poselib.estimate_homography(x, y, settings, {})
        assert info["iterations"] <= 2000
        _, info = poselib.estimate_homography(x[:3], y[:3], settings, {})
        assert not any(info["inliers"])


def test_progressive_sampling_passes_through() -> None:
    planted = plant("affine", 14, (5, 6), 0)
    settings = options(0.3, progressive_sampling=True)
    bare = poselib.estimate_homography(planted.x, planted.y, settings, {})
    with patched("poselib"):
        wrapped = poselib.estimate_homography(planted.x, planted.y, settings, {})
    assert bare[1] == wrapped[1]


def test_status_and_copies() -> None:
    with patched("poselib", threads=True):
        assert poselib._core.estimate_homography is poselib.estimate_homography
        state = next(s for s in status().systems if s.system == "poselib")
        assert state.state == "patched"
        assert len(state.sites) == len(patch_file._ESTIMATORS)


def stand_in(rule: Callable[..., float]) -> ModuleType:
    """Return a library that reports the iterations of a given rule."""

    def estimate_homography(x: Any, y: Any, ransac_opt: Any, bundle_opt: Any) -> Any:
        """estimate_homography(x, y, ransac_opt: dict = {})"""
        trials = int(rule(9, len(x), 4, ransac_opt["success_prob"]))
        inliers = [True] * 9 + [False] * (len(x) - 9)
        return np.eye(3), {"iterations": trials, "num_inliers": 9, "inliers": inliers}

    module = ModuleType("poselib")
    module.estimate_homography = estimate_homography  # type: ignore[attr-defined]
    return module


def test_an_exact_release_is_left_alone_and_another_rule_is_refused() -> None:
    assert patch_file.plan(stand_in(required_trials)) == ()
    assert len(patch_file.plan(stand_in(approximate_required_trials))) == 1
    with pytest.raises(PatchNotApplicable, match="neither rule"):
        patch_file.plan(stand_in(lambda *args: 3 * required_trials(*args)))
