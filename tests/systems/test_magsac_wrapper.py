"""pymagsac keeps its promise: by trial counts and by outcomes."""

import math
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pymagsac
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_views import CAMERA, Planted, chance_of_larger, likelihood_ratio, plant

from ransac_fix import approximate_required_trials, patched, required_trials, status, unpatch
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import magsac as patch_file
from ransac_fix.patching import docstrings, missing


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("RANSAC_FIX_SLACK", "0")
    monkeypatch.setattr(missing, "_slack", 0.0)
    yield
    unpatch("magsac")


def arguments(name: str, planted: Planted) -> tuple[Any, ...]:
    sides = np.hstack([planted.x, planted.y])
    size = 1100, 1100, 1100, 1100
    equal = np.ones(len(sides))
    return {
        "findHomography": (sides, *size, equal),
        "findFundamentalMatrix": (sides, *size, equal),
        "findEssentialMatrix": (sides, CAMERA, CAMERA, *size, equal),
        "findRigidTransformation": (sides, equal),
    }[name]


def run(name: str, planted: Planted, confidence: float, **settings: Any) -> Any:
    chosen = {"sampler": 0, "sigma_th": 0.02, "min_iters": 0, "max_iters": 20_000, **settings}
    return getattr(pymagsac, name)(*arguments(name, planted), conf=confidence, **chosen)


# Kind of problem, n, sizes of the groups, k. Fundamental and essential matrices take thousands of
# slow trials: benchmarks/wrapper_proof.py.
CASES = {
    "findHomography": ("affine", 14, (5, 6), 4),
    "findRigidTransformation": ("rigid", 14, (5, 6), 3),
}


@pytest.mark.parametrize("name", CASES)
def test_outcomes_are_those_of_the_exact_number_of_trials(name: str) -> None:
    kind, n_samples, sizes, k = CASES[name]
    hits = [math.comb(size, k) / math.comb(n_samples, k) for size in sizes]
    likely, unlikely = (
        chance_of_larger(rule(sizes[0], n_samples, k, 0.5), *hits, most=rule(k, n_samples, k, 0.5))
        for rule in (required_trials, approximate_required_trials)
    )

    def finds_larger(seed: int) -> bool:
        planted = plant(kind, n_samples, sizes, seed)
        mask = run(name, planted, 0.5)[1]
        return bool(mask[planted.labels == 1].all())

    # There is no seed: the test is wrong once in ten million times.
    is_bare_exact, *_ = likelihood_ratio(finds_larger, likely, unlikely, error=1e-7)
    with patched("magsac"):
        is_exact, successes, runs = likelihood_ratio(finds_larger, likely, unlikely, error=1e-7)
    assert is_exact, f"{successes} of {runs}: exact {likely:.3f}, approximate {unlikely:.3f}"
    assert is_bare_exact is False


@given(
    n_samples=st.integers(9, 300),
    data=st.data(),
    confidence=st.floats(0.01, 0.9999),
    least=st.integers(0, 100),
    limit=st.integers(1, 200_000),
    name=st.sampled_from(list(patch_file._ESTIMATORS)),
)
def test_trials_run_and_missing_make_the_required_number(
    n_samples: int, data: Any, confidence: float, least: int, limit: int, name: str
) -> None:
    estimator = patch_file._ESTIMATORS[name]
    k = estimator.sample_size
    n_inliers = data.draw(st.integers(k, n_samples))
    runs: list[float] = []

    def counting(**settings: Any) -> Any:
        rule = patch_file._rule(n_inliers, n_samples, k, settings["conf"])
        runs.append(max(min(rule, settings["max_iters"]), settings["min_iters"], 1))
        return np.zeros((4, 4) if k == 3 else (3, 3)), np.arange(n_samples) < n_inliers

    defaults = {"sampler": 0, "use_magsac_plus_plus": True, "sigma_th": 1.0}
    patch_file._wrap(counting, estimator, defaults)(
        correspondences=np.ones((n_samples, 6 if k == 3 else 4)),
        K1=CAMERA,
        K2=CAMERA,
        conf=confidence,
        min_iters=least,
        max_iters=limit,
    )
    needed = min(required_trials(n_inliers, n_samples, k, confidence), limit)
    assert sum(runs) == max(runs[0], needed)


@pytest.mark.parametrize("name", patch_file._ESTIMATORS)
@pytest.mark.parametrize("threshold", [0.5, 1.0, 3.0])
def test_residuals_are_those_of_the_library(name: str, threshold: float) -> None:
    rng = np.random.default_rng(0)
    kind = {"findHomography": "affine", "findRigidTransformation": "rigid"}.get(name, "two views")
    planted = plant(kind, 200, (140,), 1)
    scale = 100.0 if kind == "rigid" else 1.0
    x, y = (scale * side + rng.normal(0, 0.3, side.shape) for side in (planted.x, planted.y))
    noisy = Planted(x, y, planted.labels)
    model, mask = run(name, noisy, 0.99, sigma_th=threshold, min_iters=50)
    estimator = patch_file._ESTIMATORS[name]
    settings = {"correspondences": np.hstack([x, y]), "K1": CAMERA, "K2": CAMERA}
    squares = estimator.squares(settings, model, False)
    reach = threshold**2 if estimator.squared_mask else threshold
    np.testing.assert_array_equal(squares <= reach**2, mask)
    worse = np.array(model) + 1e-2 * np.abs(model).max()
    losses = [
        patch_file._loss(estimator.squares(settings, matrix, True), threshold)
        for matrix in (model, worse)
    ]
    assert losses[0] < losses[1]


def test_other_samplers_and_limits_are_left_alone() -> None:
    calls: list[dict[str, Any]] = []

    def counting(**settings: Any) -> Any:
        calls.append(settings)
        return np.eye(3), np.arange(50) < 10

    estimator = patch_file._ESTIMATORS["findHomography"]
    defaults = {"sampler": 4, "use_magsac_plus_plus": True, "sigma_th": 1.0, "conf": 0.99}
    exact = patch_file._wrap(counting, estimator, defaults)
    exact(correspondences=np.ones((50, 4)), min_iters=0, max_iters=10_000)
    assert len(calls) == 1
    exact(correspondences=np.ones((50, 4)), sampler=0, min_iters=0, max_iters=20)
    assert len(calls) == 2


def test_no_model_and_few_points_do_not_hang() -> None:
    rng = np.random.default_rng(0)
    clutter = Planted(*rng.uniform(0, 1000, (2, 60, 2)), np.full(60, -1))
    with patched("magsac"):
        run("findHomography", clutter, 0.99, max_iters=2000)
        run("findFundamentalMatrix", clutter, 0.99, max_iters=200)
        found, mask = run("findEssentialMatrix", clutter, 0.99, max_iters=100)
        assert found is None
        assert not mask.any()


def test_status_and_refusals(monkeypatch: pytest.MonkeyPatch) -> None:
    with patched("magsac", threads=True):
        state = next(s for s in status().systems if s.system == "magsac")
        assert state.state == "patched"
        assert len(state.sites) == len(patch_file._ESTIMATORS)
    monkeypatch.setattr(docstrings, "version", lambda _: "9.9")
    with pytest.raises(PatchNotApplicable, match=r"release 9\.9 was not measured"):
        patch_file.plan(pymagsac)
    monkeypatch.undo()
    with pytest.raises(PatchNotApplicable, match="has no findHomography"):
        patch_file.plan(ModuleType("pymagsac"))
