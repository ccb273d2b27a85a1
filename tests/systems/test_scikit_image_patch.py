"""scikit-image's `ransac` made exact, in the shape it has up to 0.26 and in that of 0.27."""

import asyncio
import inspect
import math
import pickle
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib import Parallel, delayed
from skimage.measure import LineModelND, fit, ransac
from skimage.transform import ProjectiveTransform

import ransac_fix
from ransac_fix import approximate_required_trials, required_trials
from ransac_fix.patches.scikit_image import ransac as exact_ransac

RULE = ransac.__globals__["_dynamic_max_trials"]


@pytest.fixture(autouse=True)
def undo() -> Iterator[None]:
    yield
    ransac_fix.unpatch()
    assert ransac.__globals__["_dynamic_max_trials"] is RULE


def line(n: int, inliers: int) -> Any:
    """Return n points of which `inliers` lie on a line, and no other three on any."""
    rng = np.random.default_rng(5)
    x = np.arange(n, dtype=float)
    points = np.column_stack([x, 0.5 * x + 1.0])
    points[inliers:, 1] += 10.0 + rng.uniform(0.0, 100.0, n - inliers)
    return points


def trials(function: Any = ransac, n: int = 20, inliers: int = 6, **options: Any) -> int:
    """Run, and count the trials: each begins with a look at its sample."""
    count = 0

    def counted(*_: Any) -> bool:
        nonlocal count
        count += 1
        return True

    settings = {"max_trials": 10**5, "stop_probability": 0.99, "rng": 3} | options
    _, mask = function(line(n, inliers), LineModelND, 2, 1e-6, is_data_valid=counted, **settings)
    assert np.count_nonzero(mask) == inliers
    return count


@pytest.mark.parametrize(("n", "inliers"), [(20, 6), (30, 9), (40, 7)])
def test_trials_of_a_run(n: int, inliers: int) -> None:
    exact = required_trials(inliers, n, 2, 0.99)
    approximate = approximate_required_trials(inliers, n, 2, 0.99)
    assert exact > approximate
    assert trials(ransac, n, inliers) == approximate
    assert trials(exact_ransac, n, inliers) == exact
    with ransac_fix.patched("skimage"):
        assert trials(ransac, n, inliers) == exact
    ransac_fix.patch("scikit-image")
    assert trials(ransac, n, inliers) == exact


def test_a_homography() -> None:
    """k = 4, and data in two arrays."""
    rng = np.random.default_rng(0)
    source = rng.uniform(0, 100, (14, 2))
    matrix = np.array([[1.1, 0.02, 5.0], [-0.03, 0.95, -3.0], [1e-4, -2e-4, 1.0]])
    target = ProjectiveTransform(matrix)(source)
    target[7:] = rng.uniform(300, 400, (7, 2))

    def run(function: Any) -> int:
        count = 0

        def counted(*_: Any) -> bool:
            nonlocal count
            count += 1
            return True

        settings = {"max_trials": 10**4, "stop_probability": 0.99, "rng": 1}
        _, mask = function(
            (source, target), ProjectiveTransform, 4, 1e-3, is_data_valid=counted, **settings
        )
        assert np.count_nonzero(mask) == 7
        return count

    assert run(ransac) == approximate_required_trials(7, 14, 4, 0.99)
    assert run(exact_ransac) == required_trials(7, 14, 4, 0.99)


def test_the_users_limit_stays() -> None:
    assert required_trials(7, 40, 2, 0.99) > 100
    assert trials(exact_ransac, 40, 7, max_trials=150) == 150


def test_conventions_of_the_rule() -> None:
    with ransac_fix.patched("scikit-image"):
        rule = ransac.__globals__["_dynamic_max_trials"]
        assert type(rule(6, 20, 2, 0.99)) is type(RULE(6, 20, 2, 0.99)) is np.float64
        assert rule(6, 20, 2, 0) == 0
        assert rule(0, 20, 2, 0.99) == math.inf
        assert rule(20, 20, 2, 0.99) == 1
        # The default stop_probability=1 is taken for 1 - 2**-52.
        assert rule(6, 20, 2, 1) == required_trials(6, 20, 2, 1 - 2**-52)
        # No cap is known here, and fewer inliers than a sample: the library's own value.
        assert rule(7, 12, 8, 0.99) == RULE(7, 12, 8, 0.99)
        assert inspect.signature(rule) == inspect.signature(RULE)
        assert rule.__doc__ == RULE.__doc__
        assert fit._dynamic_max_trials is rule  # the name that user code knows


def _no_model(function: Any, cap: float) -> int:
    rng = np.random.default_rng(0)
    data, count = rng.uniform(size=(12, 2)), 0

    def counted(*_: Any) -> bool:
        nonlocal count
        count += 1
        return True

    settings = {"stop_probability": 0.9, "max_trials": cap, "rng": 1}
    _, mask = function(data, LineModelND, 8, 0.1, is_data_valid=counted, **settings)
    assert np.count_nonzero(mask) < 8
    return count


def test_fewer_inliers_than_a_sample_never_hangs() -> None:
    own = _no_model(ransac, math.inf)
    assert _no_model(exact_ransac, math.inf) == own
    assert _no_model(exact_ransac, own + 300) == own + 300  # the user's own limit


def test_the_drop_in_is_the_original_otherwise() -> None:
    assert inspect.signature(exact_ransac) == inspect.signature(ransac)
    assert exact_ransac.__doc__ == ransac.__doc__
    assert exact_ransac.__name__ == "ransac"
    assert pickle.loads(pickle.dumps(exact_ransac)) is exact_ransac
    options = {"min_samples": 2, "residual_threshold": 1e-6, "rng": 7, "max_trials": 500}
    model, mask = exact_ransac(line(20, 6), LineModelND, **options)
    own_model, own_mask = ransac(line(20, 6), LineModelND, **options)
    assert type(model) is type(own_model)
    assert type(mask) is type(own_mask)
    np.testing.assert_array_equal(mask, own_mask)
    with pytest.raises(ValueError, match="min_samples"):
        exact_ransac(line(20, 6), LineModelND, 0, 1.0)


def test_async_tasks() -> None:
    async def plain() -> list[int]:
        found = []
        for _ in range(3):
            found.append(trials(ransac))
            await asyncio.sleep(0)
        return found

    async def exact() -> list[int]:
        with ransac_fix.patched("scikit-image"):
            return await plain()

    async def main() -> list[list[int]]:
        return await asyncio.gather(plain(), exact(), plain())

    assert asyncio.run(main()) == [[49] * 3, [56] * 3, [49] * 3]


def test_threads_and_joblib() -> None:
    functions = [exact_ransac, ransac] * 4
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(trials, functions)) == [56, 49] * 4
    with ransac_fix.patched("scikit-image"), ThreadPoolExecutor(2) as pool:
        assert list(pool.map(trials, functions)) == [56, 49] * 4
    found = Parallel(2, backend="loky")(delayed(trials)(function) for function in functions)
    assert found == [56, 49] * 4


def test_spawned_and_forked_processes() -> None:
    """The drop-in works in workers of any kind; `patch` reaches those that are forked."""
    program = (
        "import multiprocessing as mp, ransac_fix\n"
        "from test_scikit_image_patch import exact_ransac, ransac, trials\n"
        "if __name__ == '__main__':\n"
        "    ransac_fix.patch('scikit-image')\n"
        "    for method in ('fork', 'spawn'):\n"
        "        with mp.get_context(method).Pool(1) as pool:\n"
        "            print(method, *pool.map(trials, [exact_ransac, ransac]))\n"
    )
    folder = Path(__file__).parent
    script = folder / "no_such_script.py"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True
    )
    assert not script.exists()
    assert done.stdout.split("\n")[:2] == ["fork 56 56", "spawn 56 49"], done.stderr


# A stand-in, and it says so: scikit-image 0.27 needs Python 3.12, so on older ones its shape is
# played by two modules of ours. The rule and the loop live in `_skimage2.measure.fit`;
# `skimage.measure.fit` re-exports them. The release itself is tried in the patch matrix.
STAND_IN = {
    "_skimage2/__init__.py": "",
    "_skimage2/measure/__init__.py": "",
    "_skimage2/measure/fit.py": '''
"""A stand-in for scikit-image 0.27, not scikit-image."""
import numpy as np

_EPSILON = np.spacing(1)

def _dynamic_max_trials(n_inliers, n_samples, min_samples, probability):
    """Say how many trials are enough."""
    if probability == 0:
        return 0
    if n_inliers == 0:
        return np.inf
    missed, miss = 1 - probability, 1 - (n_inliers / n_samples) ** min_samples
    bounds = {"a_min": _EPSILON, "a_max": 1 - _EPSILON}
    return np.ceil(np.log(np.clip(missed, **bounds)) / np.log(np.clip(miss, **bounds)))

def ransac(data, model_class, min_samples, residual_threshold, max_trials=100, stop_probability=1):
    """Return the bound of a run in which a fifth plus two of the measurements agree."""
    best = len(data) // 5 + 2
    max_trials = min(
        max_trials, _dynamic_max_trials(best, len(data), min_samples, stop_probability)
    )
    return max_trials
''',
    "skimage/__init__.py": "__version__ = '0.27.0rc1+standin'\n",
    "skimage/measure/__init__.py": "from .fit import ransac\n",
    "skimage/measure/fit.py": (
        "from _skimage2.measure.fit import ransac as ransac\n"
        "from _skimage2.measure.fit import _dynamic_max_trials\n"
    ),
}

STAND_IN_PROGRAM = """
import ransac_fix
{before}
import skimage.measure
from skimage.measure import fit
import _skimage2.measure.fit as home
original = home._dynamic_max_trials
{after}
def bound():
    return skimage.measure.ransac(range(20), None, 2, 1.0, stop_probability=0.99)
status = next(s for s in ransac_fix.status().systems if s.system == "scikit-image")
print(bound(), fit._dynamic_max_trials(6, 20, 2, 0.99), status.state, status.version, *status.sites)
from ransac_fix.patches.scikit_image import ransac
ransac_fix.unpatch()
print(bound(), home._dynamic_max_trials(6, 20, 2, 0.99), fit._dynamic_max_trials(6, 20, 2, 0.99))
print(fit._dynamic_max_trials is home._dynamic_max_trials)
print(ransac(range(20), None, 2, 1.0, stop_probability=0.99), bound())
"""


@pytest.mark.parametrize("when", ["before", "after"])
def test_the_shape_of_0_27_with_a_stand_in(tmp_path: Path, when: str) -> None:
    for name, source in STAND_IN.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    words = {"before": "", "after": ""} | {when: "ransac_fix.patch('scikit-image')"}
    done = subprocess.run(
        [sys.executable, "-c", STAND_IN_PROGRAM.format(**words)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.stdout.splitlines() == [
        "56.0 56.0 patched 0.27.0rc1+standin _skimage2.measure.fit._dynamic_max_trials",
        "49.0 49.0 49.0",
        "True",
        "56.0 49.0",
    ], done.stderr
