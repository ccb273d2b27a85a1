"""The wrapper of Open3D, on a stand-in; `benchmarks/wrapper_proof.py` runs it on the library."""

import math
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ransac_fix import required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import open3d
from ransac_fix.patching import missing


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "_slack", 0.0)


class Criteria:
    """Like Open3D's RANSACConvergenceCriteria."""

    def __init__(self, max_iteration: int = 100_000, confidence: float = 0.999) -> None:
        self.max_iteration, self.confidence = max_iteration, confidence


REGISTRATION = SimpleNamespace(RANSACConvergenceCriteria=Criteria)
CORRESPONDENCE = open3d._CORRESPONDENCE_NAMES


@given(
    n_samples=st.integers(5, 300),
    data=st.data(),
    confidence=st.floats(0.01, 0.9999),
    limit=st.integers(1, 10**6),
    k=st.integers(3, 4),
)
def test_registration_draws_what_sampling_with_replacement_needs(
    n_samples: int, data: Any, confidence: float, limit: int, k: int
) -> None:
    n_inliers = data.draw(st.integers(k, n_samples))
    runs: list[float] = []

    def counting(*_args: Any, criteria: Criteria, **_kwargs: Any) -> Any:
        setting = n_inliers, n_samples, k, criteria.confidence, criteria.max_iteration
        runs.append(open3d._trials(*setting, math.ceil))
        return SimpleNamespace(
            correspondence_set=range(n_inliers), fitness=0.5, inlier_rmse=len(runs)
        )

    exact = open3d._wrap_registration(REGISTRATION, counting, CORRESPONDENCE)
    pairs = np.zeros((n_samples, 2))
    result = exact(
        source=None,
        target=None,
        corres=pairs,
        max_correspondence_distance=1.0,
        ransac_n=k,
        criteria=Criteria(limit, confidence),
    )
    needed = required_trials(n_inliers, n_samples, k, confidence, sampling="replacement")
    assert sum(runs) == max(runs[0], min(needed, limit))
    assert result.inlier_rmse == 1  # the first of equals


@given(
    n_samples=st.integers(4, 300),
    data=st.data(),
    confidence=st.floats(0.01, 0.9999),
    limit=st.integers(1, 10**6),
)
def test_planes_are_segmented_from_distinct_points(
    n_samples: int, data: Any, confidence: float, limit: int
) -> None:
    n_inliers = data.draw(st.integers(3, n_samples))
    runs: list[float] = []

    def counting(
        _cloud: Any,
        distance_threshold: float,
        ransac_n: int,
        num_iterations: int,
        probability: float = 0.99999999,
    ) -> Any:
        setting = n_inliers, n_samples, ransac_n, probability, num_iterations
        runs.append(open3d._trials(*setting, math.floor))
        return np.zeros(4), list(range(n_inliers))

    exact = open3d._wrap_segment_plane(
        counting, open3d._PLANE_DEFAULTS, lambda cloud: len(cloud.points)
    )
    exact(SimpleNamespace(points=range(n_samples)), 0.1, 3, limit, probability=confidence)
    needed = required_trials(n_inliers, n_samples, 3, confidence)
    assert sum(runs) == max(runs[0], min(needed, limit))


@pytest.mark.parametrize(("mutual", "n_samples"), [(False, 50), (True, 20)])
def test_features_are_matched_once(mutual: bool, n_samples: int) -> None:
    matched, runs = [], []

    def match(source_feature: Any, target_feature: Any, mutual_filter: bool) -> Any:
        matched.append((source_feature, target_feature))
        return range(20 if mutual_filter else 50)

    def counting(*_args: Any, criteria: Criteria, **kwargs: Any) -> Any:
        n = len(kwargs["corres"])
        assert kwargs["max_correspondence_distance"] == 1.0
        runs.append(open3d._trials(5, n, 3, criteria.confidence, criteria.max_iteration, math.ceil))
        return SimpleNamespace(correspondence_set=range(5), fitness=0.1, inlier_rmse=0.0)

    register = open3d._wrap_registration(REGISTRATION, counting, CORRESPONDENCE)
    exact = open3d._wrap_feature_matching(counting, match, register)
    exact(None, None, "s", "t", mutual, 1.0, criteria=Criteria(10**6, 0.9))
    assert matched == [("s", "t")]
    assert len(runs) == 2
    assert sum(runs) == required_trials(5, n_samples, 3, 0.9, sampling="replacement")


def test_what_is_missing_the_library_says() -> None:
    def original(source: Any, target: Any) -> Any:
        raise TypeError("no features")

    with pytest.raises(TypeError, match="no features"):
        open3d._wrap_feature_matching(original, original, original)(None, None)


def test_the_better_result_wins() -> None:
    results = [(0.3, 0.2), (0.3, 0.1)]

    def next_result(*_args: Any, **_kwargs: Any) -> Any:
        fitness, rmse = results.pop(0)
        return SimpleNamespace(correspondence_set=range(6), fitness=fitness, inlier_rmse=rmse)

    exact = open3d._wrap_registration(REGISTRATION, next_result, CORRESPONDENCE)
    found = exact(None, None, np.zeros((20, 2)), 1.0, criteria=Criteria(10**5, 0.9))
    assert found.inlier_rmse == 0.1


@pytest.mark.parametrize("version", ["0.18.0", "0.21.0", "", "next"])
def test_other_releases_are_refused(version: str) -> None:
    module = ModuleType("open3d")
    module.__version__ = version  # type: ignore[attr-defined]
    with pytest.raises(PatchNotApplicable, match="was not measured"):
        open3d.plan(module)
