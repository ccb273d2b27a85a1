"""The wrapper of older pycolmap releases; `benchmarks/wrapper_proof.py` runs it on them."""

import math
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pycolmap
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ransac_fix import patched, required_trials, status
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import colmap
from ransac_fix.patching import missing


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(missing, "_slack", 0.0)
    return


class Library:
    """A pycolmap that counts its trials by the old rule and draws nothing."""

    def __init__(self, n_inliers: int) -> None:
        self.n_inliers = n_inliers
        self.runs: list[float] = []

    def estimate(self, sample_size: int, ransac: Any, n_samples: int) -> dict[str, Any]:
        rule = colmap._rule(
            self.n_inliers / n_samples,
            sample_size,
            ransac.confidence,
            ransac.dyn_num_trials_multiplier,
        )
        self.runs.append(min(max(rule, ransac.min_num_trials), ransac.max_num_trials))
        return {"num_inliers": self.n_inliers}


@given(
    n_samples=st.integers(9, 300),
    data=st.data(),
    confidence=st.floats(0.01, 0.9999),
    floor=st.integers(0, 100),
    limit=st.integers(100, 100_000),
    name=st.sampled_from(list(colmap._ESTIMATORS)),
    as_dict=st.booleans(),
)
def test_trials_run_and_missing_make_the_required_number(
    n_samples: int,
    data: Any,
    confidence: float,
    floor: int,
    limit: int,
    name: str,
    as_dict: bool,
) -> None:
    estimator = colmap._ESTIMATORS[name]
    k = estimator.sample_size
    library = Library(data.draw(st.integers(k, n_samples)))
    settings: Any = {
        "confidence": confidence,
        "min_num_trials": floor,
        "max_num_trials": limit,
        "dyn_num_trials_multiplier": 1.0,
        "min_inlier_ratio": 1e-6,
    }
    is_pose = estimator.kind != "RANSACOptions"
    if is_pose:
        settings = {"ransac": settings}

    def counting(*args: Any, **kwargs: Any) -> dict[str, Any]:
        options = kwargs["estimation_options"]
        if isinstance(options, dict):
            made = getattr(pycolmap, estimator.kind)()
            made.mergedict(options)
            options = made
        return library.estimate(k, options.ransac if is_pose else options, n_samples)

    options = settings
    if not as_dict:
        options = getattr(pycolmap, estimator.kind)()
        options.mergedict(settings)
    points = np.zeros((n_samples, 2))
    colmap._wrap(pycolmap, counting, estimator)(points, points, estimation_options=options)
    first = library.runs[0]
    needed = max(first, min(required_trials(library.n_inliers, n_samples, k, confidence), limit))
    assert sum(library.runs) == needed
    if not as_dict:  # the caller's own object
        ransac = options.ransac if is_pose else options
        assert (ransac.min_num_trials, ransac.max_num_trials) == (floor, limit)


def test_the_ratio_that_the_user_gives_is_a_limit() -> None:
    library = Library(4)

    def counting(_x: Any, _y: Any, options: Any) -> dict[str, Any]:
        return library.estimate(4, options, 40)

    options = pycolmap.RANSACOptions()
    options.min_num_trials, options.min_inlier_ratio, options.confidence = 0, 0.2, 0.9
    options.dyn_num_trials_multiplier = 1.0
    limit = math.ceil(math.log(0.1) / math.log1p(-(0.2**4)))
    options.max_num_trials = limit  # the library sets this bound itself
    exact = colmap._wrap(pycolmap, counting, colmap._ESTIMATORS["estimate_homography_matrix"])
    points = np.zeros((40, 2))
    exact(points, points, options)
    assert library.runs == [limit]


def test_a_model_is_kept_unless_a_later_one_has_more_inliers() -> None:
    for later, kept in ((None, 5), (4, 5), (5, 5), (6, 6)):
        found = [{"num_inliers": 5, "which": 1}, later and {"num_inliers": later, "which": 2}]

        def next_result(*_args: Any, found: list[Any] = found) -> Any:
            return found.pop(0) if found else None

        options = pycolmap.RANSACOptions()
        options.min_num_trials, options.confidence, options.max_num_trials = 0, 0.5, 150
        options.dyn_num_trials_multiplier = 1.0
        exact = colmap._wrap(
            pycolmap, next_result, colmap._ESTIMATORS["estimate_homography_matrix"]
        )
        points = np.zeros((14, 2))
        result = exact(points, points, options)
        assert result["num_inliers"] == kept
        assert result["which"] == (2 if kept == 6 else 1)


def test_inliers_of_a_transform_are_counted_as_colmap_counts_them() -> None:
    rng = np.random.default_rng(0)
    options = pycolmap.RANSACOptions()
    options.max_error = 0.08
    for _ in range(20):
        x = rng.normal(size=(60, 3))
        y = 2 * x + np.array([1, 2, 3]) + rng.normal(size=x.shape) * 0.05
        y[30:] = rng.normal(size=(30, 3)) * 3
        found = pycolmap.estimate_sim3d_robust(x, y, options)
        assert colmap._moved_close(found["tgt_from_src"], x, y, 0.08) == found["num_inliers"]


@pytest.mark.parametrize("by_name", [False, True])
def test_a_release_that_returns_a_transform_alone_draws_what_is_missing(by_name: bool) -> None:
    x = np.random.default_rng(0).normal(size=(22, 3))
    y = x.copy()
    y[5:] += 9.0 + np.arange(17)[:, None]
    runs = []

    def counting(*_args: Any, **kwargs: Any) -> Any:
        ransac = kwargs["estimation_options"]
        rule = colmap._rule(5 / 22, 3, ransac.confidence, 1.0)
        runs.append(min(max(rule, ransac.min_num_trials), ransac.max_num_trials))
        return pycolmap.Sim3d()

    options = pycolmap.RANSACOptions()
    options.max_error, options.confidence, options.min_num_trials = 0.1, 0.9, 0
    options.dyn_num_trials_multiplier, options.min_inlier_ratio = 1.0, 1e-6
    exact = colmap._wrap(pycolmap, counting, colmap._ESTIMATORS["estimate_sim3d_robust"])
    if by_name:
        exact(tgt=y, src=x, estimation_options=options)
    else:
        exact(x, y, estimation_options=options)
    assert len(runs) == 2
    assert sum(runs) == required_trials(5, 22, 3, 0.9)


def test_the_installed_release_is_exact_and_left_alone() -> None:
    before = pycolmap.estimate_homography_matrix
    with patched("colmap", threads=True):
        assert pycolmap.estimate_homography_matrix is before
        state = next(s for s in status().systems if s.system == "colmap")
    assert state.state == "already exact"


def test_looking_at_the_rule_leaves_the_program_s_random_numbers_alone() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 100, (2, 30, 2))

    def draw(look: bool) -> Any:
        pycolmap.set_random_seed(7)
        if look:
            colmap.plan(pycolmap)
        options = {"max_error": 1.0, "max_num_trials": 50, "min_num_trials": 50}
        return pycolmap.estimate_homography_matrix(x, y, options)["inlier_mask"]

    np.testing.assert_array_equal(draw(False), draw(True))


def test_another_shape_is_refused() -> None:
    with pytest.raises(PatchNotApplicable, match="has no estimate_homography_matrix"):
        colmap.plan(ModuleType("pycolmap"))
