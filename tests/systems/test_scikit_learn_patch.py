"""scikit-learn's RANSACRegressor made exact: `patch`, blocks, the drop-in, and what they keep."""

import inspect
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sklearn
from joblib import Parallel, delayed
from sklearn.base import clone, is_regressor
from sklearn.linear_model import LinearRegression, RANSACRegressor, _ransac
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.utils.estimator_checks import check_estimator

import ransac_fix
from ransac_fix import approximate_required_trials, required_trials
from ransac_fix.patches.scikit_learn import RANSACRegressor as Exact

ORIGINAL = _ransac._dynamic_max_trials

# (n, I, k) where the two rules differ by at least 5 trials.
PROBLEMS = [(20, 6, 2), (30, 9, 2), (18, 9, 5)]


@pytest.fixture(autouse=True)
def undo() -> Iterator[None]:
    yield
    ransac_fix.unpatch()
    assert _ransac._dynamic_max_trials is ORIGINAL


def points(n: int, inliers: int, dimensions: int = 1) -> tuple[Any, Any]:
    """Return n points of which `inliers` lie on a plane, and the rest nowhere near."""
    rng = np.random.default_rng(5)
    x = rng.uniform(-10, 10, (n, dimensions))
    y = x @ np.arange(1.0, dimensions + 1.0) + 1.0
    y[inliers:] += rng.uniform(20.0, 200.0, n - inliers)
    return x, y


def trials(cls: type, n: int, inliers: int, size: float, **options: Any) -> int:
    dimensions = int(size * n if size < 1 else size) - 1
    x, y = points(n, inliers, max(1, round(dimensions)))
    settings = {"residual_threshold": 1e-6, "max_trials": 10**5, "random_state": 3} | options
    regressor = cls(min_samples=size, **settings).fit(x, y)
    assert np.count_nonzero(regressor.inlier_mask_) == inliers
    return int(regressor.n_trials_)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_trials_of_a_fit(problem: tuple[int, int, int]) -> None:
    n, inliers, size = problem
    exact = required_trials(inliers, n, size, 0.99)
    approximate = approximate_required_trials(inliers, n, size, 0.99)
    assert exact > approximate
    assert trials(RANSACRegressor, *problem) == approximate
    assert trials(Exact, *problem) == exact
    with ransac_fix.patched("scikit-learn"):
        assert trials(RANSACRegressor, *problem) == exact
    ransac_fix.patch("sklearn")
    assert trials(RANSACRegressor, *problem) == exact


def test_a_share_of_the_points_as_the_size_of_a_sample() -> None:
    """`min_samples` below 1 reaches the rule as a NumPy float."""
    seen = []

    class Spy(RANSACRegressor):  # type: ignore[misc]
        pass

    with ransac_fix.patched("scikit-learn"):
        rule = _ransac._dynamic_max_trials

        def spy(n_inliers: Any, n_samples: Any, min_samples: Any, probability: Any) -> Any:
            seen.append(type(min_samples))
            return rule(n_inliers, n_samples, min_samples, probability)

        _ransac._dynamic_max_trials = spy
        try:
            assert trials(Spy, 20, 6, 0.1) == required_trials(6, 20, 2, 0.99)
        finally:
            _ransac._dynamic_max_trials = rule
    assert set(seen) == {np.float64}
    assert trials(Exact, 20, 6, 0.1) == required_trials(6, 20, 2, 0.99)


def test_the_users_limit_stays() -> None:
    assert required_trials(6, 30, 3, 0.99) > 100
    assert trials(Exact, 30, 6, 3, max_trials=300) == 300
    assert trials(Exact, 20, 6, 2, max_trials=100) == 56


def test_certainty_is_taken_as_the_library_takes_it() -> None:
    with ransac_fix.patched("scikit-learn"):
        rule = _ransac._dynamic_max_trials
        assert rule(6, 20, 2, 1) == required_trials(6, 20, 2, 1 - 2**-52)
        assert rule(6, 20, 2, 0) == 0
        assert rule(0, 20, 2, 0.99) == math.inf
        assert isinstance(rule(6, 20, 2, 0.99), float)


def _no_model(cls: type, cap: float) -> int:
    """Fit samples of 8 to points that have no model: fewer inliers than a sample holds."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(size=(12, 1)), rng.uniform(size=12)
    settings = {"min_samples": 8, "max_trials": cap, "random_state": 1}
    regressor = cls(residual_threshold=0.25, **settings).fit(x, y)
    assert np.count_nonzero(regressor.inlier_mask_) < 8
    return int(regressor.n_trials_)


def test_fewer_inliers_than_a_sample_never_hangs() -> None:
    own = _no_model(RANSACRegressor, math.inf)
    assert _no_model(Exact, math.inf) == own
    # The user's finite cap decides where there is one: no number of trials is enough.
    assert _no_model(RANSACRegressor, own + 500) == own
    assert _no_model(Exact, own + 500) == own + 500


def test_the_drop_in_is_the_original_otherwise() -> None:
    assert issubclass(Exact, RANSACRegressor)
    assert Exact.__doc__ == RANSACRegressor.__doc__
    assert Exact.__name__ == Exact.__qualname__ == "RANSACRegressor"
    assert inspect.signature(Exact) == inspect.signature(RANSACRegressor)
    for name, method in inspect.getmembers(RANSACRegressor, inspect.isfunction):
        ours = getattr(Exact, name)
        # Generated methods are annotated with the class they belong to.
        parameters = inspect.signature(ours).parameters
        assert [str(p) for n, p in parameters.items() if n != "self"] == [
            str(p) for n, p in inspect.signature(method).parameters.items() if n != "self"
        ], name
        assert ours.__doc__ == method.__doc__, name
        assert ours.__name__ == method.__name__
    regressor, original = Exact(LinearRegression(), min_samples=2), RANSACRegressor(min_samples=2)
    assert is_regressor(regressor)
    assert regressor.get_params().keys() == RANSACRegressor(LinearRegression()).get_params().keys()
    assert Exact(min_samples=2).get_params() == original.get_params()
    assert repr(Exact(min_samples=2)) == repr(original)
    assert Exact()._repr_html_()
    returned = regressor.fit(*points(20, 6))
    assert returned is regressor


def test_clone_and_pickle_keep_the_drop_in() -> None:
    regressor = Exact(min_samples=2, residual_threshold=1e-6, max_trials=10**5, random_state=3)
    copy = clone(regressor)
    assert type(copy) is Exact
    x, y = points(20, 6)
    fitted = pickle.loads(pickle.dumps(copy.fit(x, y)))
    assert type(fitted) is Exact
    assert fitted.n_trials_ == 56
    np.testing.assert_array_equal(fitted.predict(x), copy.predict(x))


def test_a_pickled_drop_in_is_exact_in_a_fresh_process(tmp_path: Path) -> None:
    regressor = Exact(min_samples=2, residual_threshold=1e-6, max_trials=10**5, random_state=3)
    (tmp_path / "regressor.pickle").write_bytes(pickle.dumps((regressor, points(20, 6))))
    program = (
        "import pickle; r, data = pickle.load(open('regressor.pickle', 'rb'));"
        "print(r.fit(*data).n_trials_)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.strip() == "56", done.stderr


def test_patched_functions_keep_their_looks() -> None:
    ransac_fix.patch("scikit-learn")
    stand_in = _ransac._dynamic_max_trials
    assert inspect.signature(stand_in) == inspect.signature(ORIGINAL)
    assert stand_in.__doc__ == ORIGINAL.__doc__
    assert pickle.loads(pickle.dumps(stand_in)) is stand_in


def test_estimator_checks_come_out_as_for_the_original() -> None:
    def outcome(cls: type) -> dict[str, tuple[str, str]]:
        results = check_estimator(cls(LinearRegression()), on_skip=None, on_fail=None)
        return {
            f"{r['check_name']} {i}": (r["status"], type(r["exception"]).__name__)
            for i, r in enumerate(results)
        }

    assert outcome(Exact) == outcome(RANSACRegressor)


def _fit_trials(cls: type, _: int = 0) -> int:
    return trials(cls, 20, 6, 2)


def test_threads_and_workers_do_not_inherit_a_block_but_the_drop_in_works() -> None:
    with ransac_fix.patched("scikit-learn"), ThreadPoolExecutor(2) as pool:
        assert _fit_trials(RANSACRegressor) == 56
        assert set(pool.map(_fit_trials, [RANSACRegressor] * 4)) == {49}
        assert set(pool.map(_fit_trials, [Exact] * 4)) == {56}
    with ransac_fix.patched("scikit-learn", threads=True), ThreadPoolExecutor(2) as pool:
        assert set(pool.map(_fit_trials, [RANSACRegressor] * 4)) == {56}
    with ThreadPoolExecutor(4) as pool:  # at once, and not in each other's way
        classes = [Exact, RANSACRegressor] * 10
        assert list(pool.map(_fit_trials, classes)) == [56, 49] * 10


def test_grid_search_with_processes() -> None:
    """The drop-in travels to joblib's loky workers; a block does not."""
    x, y = points(40, 24)

    def bounds(cls: type) -> list[float]:
        search = GridSearchCV(
            cls(LinearRegression(), residual_threshold=1e-6, max_trials=2000, random_state=3),
            {"min_samples": [3, 4], "stop_probability": [0.99, 0.9999]},
            scoring=_n_trials,
            cv=KFold(2, shuffle=True, random_state=0),
            n_jobs=2,
            refit=False,
        )
        search.fit(x, y)
        return list(search.cv_results_["mean_test_score"])

    exact, original = bounds(Exact), bounds(RANSACRegressor)
    assert all(e > o for e, o in zip(exact, original, strict=True)), (exact, original)
    with ransac_fix.patched("scikit-learn"):
        assert bounds(RANSACRegressor) == original


def _n_trials(estimator: Any, _x: Any, _y: Any) -> float:
    return float(estimator.n_trials_)


@pytest.mark.parametrize("backend", ["loky", "threading", "multiprocessing"])
def test_joblib_backends(backend: str) -> None:
    with Parallel(2, backend=backend) as parallel:
        found = parallel(delayed(_fit_trials)(cls) for cls in (Exact, RANSACRegressor) * 2)
    assert found == [56, 49] * 2


# What scikit-learn's own tests assert of the approximate rule: (I, n, k, s), the number
# asserted, and the exact one. All else in them passes.
APPROXIMATE_ASSERTIONS = {
    "test_ransac_dynamic_max_trials": [
        ((70, 100, 8, 0.99), 78, 89),
        ((50, 100, 8, 0.99), 1177, 1594),
    ],
}


def test_scikit_learns_own_tests_under_the_patch(tmp_path: Path) -> None:
    done = subprocess.run(
        [
            *(sys.executable, "-m", "ransac_fix", "run", "-m", "pytest"),
            *("--pyargs", "sklearn.linear_model.tests.test_ransac"),
            *("-q", "-rA", "-p", "no:cacheprovider", "-W", "ignore"),
        ],
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if not k.startswith(("RANSAC_FIX", "PYTEST"))},
        capture_output=True,
        text=True,
    )
    lines = done.stdout.splitlines()
    passed = {line.split("::")[1] for line in lines if line.startswith("PASSED")}
    failed = {line.split("::")[1].split(" ")[0] for line in lines if line.startswith("FAILED")}
    assert failed == set(APPROXIMATE_ASSERTIONS), done.stdout[-3000:]
    assert len(passed) >= 25
    own_tests = Path(sklearn.__file__).parent / "linear_model" / "tests" / "test_ransac.py"
    source = own_tests.read_text(encoding="utf-8")
    for (n_inliers, n, size, confidence), asserted, exact in APPROXIMATE_ASSERTIONS[
        "test_ransac_dynamic_max_trials"
    ]:
        call = f"_dynamic_max_trials({n_inliers}, {n}, {size}, {confidence})"
        assert f"assert {call} == {asserted}" in source
        assert approximate_required_trials(n_inliers, n, size, confidence) == asserted
        assert required_trials(n_inliers, n, size, confidence) == exact
