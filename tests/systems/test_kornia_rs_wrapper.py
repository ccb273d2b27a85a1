"""kornia-rs keeps its promise: by the iterations it reports and by outcomes."""

import math
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import kornia_rs
import numpy as np
import pytest
from planted_views import CAMERA, Planted, chance_of_larger, likelihood_ratio, plant

from ransac_fix import approximate_required_trials, patched, required_trials, status, unpatch
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import kornia_rs as patch_file
from ransac_fix.patching import missing


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(missing, "_slack", 0.0)
    yield
    unpatch("kornia-rs")


def pixels(planted: Planted) -> np.ndarray:
    return np.hstack([planted.x, planted.y])


def rays(planted: Planted) -> np.ndarray:
    return (pixels(planted) - np.tile(CAMERA[:2, 2], 2)) / 800.0


# Thresholds are of squared distances.
# Kind of problem, n, sizes of the groups, k, matches, threshold, chance of an all-inlier sample.
Case = tuple[str, int, tuple[int, int], int, Callable[[Planted], np.ndarray], float, float]
CASES: dict[str, Case] = {
    "homography": ("affine", 14, (5, 6), 4, pixels, 0.0025, 1.0),
    "fundamental": ("two views", 22, (10, 11), 8, pixels, 1e-4, 1.0),
    "essential": ("two views", 16, (7, 8), 5, rays, 1e-8, 1.0),
}


@pytest.mark.parametrize("name", CASES)
def test_outcomes_are_those_of_the_exact_number_of_trials(name: str) -> None:
    kind, n_samples, sizes, sample_size, matches, threshold, chance = CASES[name]
    setting = sizes[0], n_samples, sample_size, 0.5
    hits = [chance * math.comb(s, sample_size) / math.comb(n_samples, sample_size) for s in sizes]
    likely = chance_of_larger(required_trials(*setting), *hits)
    unlikely = chance_of_larger(approximate_required_trials(*setting), *hits)

    def run(seed: int) -> bool:
        planted = plant(kind, n_samples, sizes, seed)
        function = getattr(kornia_rs.ransac, name)
        found = function(matches(planted), threshold, 100_000, 0.5, seed)
        return planted.found(np.array(found.inliers)) == 1

    with patched("kornia-rs"):
        is_exact, successes, runs = likelihood_ratio(run, likely, unlikely, error=1e-3)
    assert is_exact, f"{successes} of {runs}: exact {likely:.3f}, approximate {unlikely:.3f}"


@pytest.mark.parametrize("name", CASES)
def test_iterations_run_make_the_required_number(name: str) -> None:
    kind, n_samples, sizes, sample_size, matches, threshold, _ = CASES[name]
    runs: list[Any] = []

    def counting(*args: Any, **kwargs: Any) -> Any:
        runs.append(getattr(kornia_rs.ransac, name)(*args, **kwargs))
        return runs[-1]

    exact = patch_file._wrap(counting, sample_size)
    second_runs = 0
    for seed in range(20):
        runs.clear()
        data = matches(plant(kind, n_samples, sizes[1:], seed))
        found = exact(data, threshold, 100_000, 0.9, seed=seed)
        n_inliers = sum(found.inliers)
        needed = required_trials(n_inliers, n_samples, sample_size, 0.9)
        if sum(runs[0].inliers) == n_inliers and runs[0].num_iters <= needed:
            assert sum(result.num_iters for result in runs) == needed
            second_runs += len(runs) == 2
    assert second_runs > 5


def test_results_repeat_limits_win_and_nothing_hangs() -> None:
    planted = plant("affine", 14, (5, 6), 0)
    data = pixels(planted)
    noise = np.random.default_rng(0).uniform(0, 1000, (100, 4))
    with patched("kornia-rs"):
        first, second = (
            kornia_rs.ransac.homography(data, 0.05, confidence=0.5, seed=4) for _ in range(2)
        )
        assert first.model == second.model
        assert first.inliers == second.inliers
        assert kornia_rs.ransac.homography(data, 0.05, 25, 0.9999, 4).num_iters <= 25
        assert kornia_rs.ransac.homography(noise, 0.5).num_iters <= 1000
        with pytest.raises(ValueError, match="expected"):
            kornia_rs.ransac.homography(data[:, :3])


def test_status_and_refusals() -> None:
    with patched("kornia-rs", threads=True):
        state = next(s for s in status().systems if s.system == "kornia-rs")
        assert state.state == "patched"
    with pytest.raises(PatchNotApplicable, match="no module ransac"):
        patch_file.plan(ModuleType("kornia_rs"))
