"""pygcransac's wrapper keeps the promise, counted with a stand-in.

Its release needs NumPy 1, which the other libraries here do not run with:
``benchmarks/wrapper_proof.py gc-ransac`` tests the real one.
"""

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_views import CAMERA

from ransac_fix import required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patches import gc_ransac as patch_file
from ransac_fix.patching import docstrings, missing
from ransac_fix.patching.docstrings import documented_parameters

SHAPES = {"findRigidTransform": (4, 4)} | dict.fromkeys(
    ("findHomography", "findFundamentalMatrix", "findEssentialMatrix"), (3, 3)
)
DEFAULTS = {"sampler": 1, "threshold": 1.0, "conf": 0.99, "solver": 0}


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "_slack", 0.0)


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
    # A model of no more inliers than a sample has is not returned.
    n_inliers = data.draw(st.integers(k, n_samples))
    model = np.ones(SHAPES[name])
    runs: list[float] = []

    def counting(**settings: Any) -> Any:
        rule = patch_file._rule(n_inliers, n_samples, k, settings["conf"])
        runs.append(max(min(rule, settings["max_iters"]), settings["min_iters"], 1))
        mask = np.arange(n_samples) < n_inliers
        return (None, mask & False) if n_inliers == k else (model, mask)

    patch_file._wrap(counting, estimator, DEFAULTS)(
        **{estimator.points: np.ones((n_samples, 6 if k == 3 else 4))},
        K1=CAMERA,
        K2=CAMERA,
        sampler=0,
        conf=confidence,
        min_iters=least,
        max_iters=limit,
    )
    needed = min(required_trials(n_inliers, n_samples, k, confidence), limit)
    assert sum(runs) == max(runs[0], needed)


def test_samples_of_another_kind_are_left_alone() -> None:
    calls: list[dict[str, Any]] = []

    def counting(**settings: Any) -> Any:
        calls.append(settings)
        return np.eye(3), np.arange(50) < 10

    exact = patch_file._wrap(counting, patch_file._ESTIMATORS["findHomography"], DEFAULTS)
    given = {"correspondences": np.ones((50, 4)), "min_iters": 0, "max_iters": 10_000}
    exact(**given)  # PROSAC
    exact(**given, sampler=0, solver=2)  # samples of another size
    assert len(calls) == 2
    exact(**given, sampler=0)
    assert len(calls) == 4


def test_parameters_are_read_from_the_docstring() -> None:
    def find() -> None:
        """find(points: numpy.ndarray[numpy.float64, 2], conf: float = 0.99, m: str = 'a') -> tuple

        some text (with: a colon) -> more
        """

    assert documented_parameters(find) == {"points": ..., "conf": 0.99, "m": "a"}
    assert documented_parameters(len) == {}


def test_masks_that_say_nothing_and_unknown_releases_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module: Any = ModuleType("pygcransac")
    monkeypatch.setattr(docstrings, "version", lambda _: "9.9")
    with pytest.raises(PatchNotApplicable, match=r"release 9\.9 was not measured"):
        patch_file.plan(module)
    monkeypatch.setattr(docstrings, "version", lambda _: "0.1.1")
    with pytest.raises(PatchNotApplicable, match="has no findHomography"):
        patch_file.plan(module)

    mask = np.ones(20, bool)
    for name, estimator in patch_file._ESTIMATORS.items():

        def find(*args: Any, **kwargs: Any) -> Any:
            return np.ones(3), mask

        find.__doc__ = (
            f"{name}({estimator.points}: array, threshold: float = 1.0, conf: float = 0.99,"
            " max_iters: int = 1, min_iters: int = 50) -> tuple"
        )
        setattr(module, name, find)
    for value in (True, False):
        mask[:] = value
        with pytest.raises(PatchNotApplicable, match="masks do not show the inliers"):
            patch_file.plan(module)
    mask[:] = np.arange(20) % 4 > 0
    assert len(patch_file.plan(module)) == len(patch_file._ESTIMATORS)
