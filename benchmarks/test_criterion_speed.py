"""The cost of a call of the criterion beside the rules of scikit-image and scikit-learn.

Run with ``python -m pytest benchmarks/test_criterion_speed.py``; the groups are magnitudes of N.
The settings (n, k, s) of a group recur, as they do within a RANSAC run; ``cold`` forgets them
before every call.
"""

import random
from collections.abc import Callable

import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from skimage.measure import fit
from sklearn.linear_model import _ransac

from ransac_fix import criterion
from ransac_fix.criterion import required_trials

Problem = tuple[int, int, int, float]


def problems(low: float, high: float, count: int = 200) -> list[Problem]:
    """Problems with n <= 10**4 and k <= 7 that need from `low` to `high` trials."""
    generator = random.Random(0)
    found: list[Problem] = []
    while len(found) < count:
        n_samples = generator.randint(10, 10**4)
        sample_size = generator.randint(2, 7)
        n_inliers = generator.randint(sample_size, n_samples - 1)
        confidence = generator.choice([0.9, 0.95, 0.99, 0.999, 0.9999])
        if low <= required_trials(n_inliers, n_samples, sample_size, confidence) < high:
            found.append((n_inliers, n_samples, sample_size, confidence))
    return found


def cold(*problem: Problem) -> float:
    criterion._SETTINGS.clear()
    return required_trials(*problem)  # type: ignore[arg-type]


@pytest.mark.parametrize("exponent", [0, 3, 6, 9, 12, 18], ids=lambda e: f"N>=1e{e}")
@pytest.mark.parametrize(
    "rule",
    [
        pytest.param(required_trials, id="ransac_fix"),
        pytest.param(cold, id="ransac_fix-cold"),
        pytest.param(_ransac._dynamic_max_trials, id="scikit-learn"),
        pytest.param(fit._dynamic_max_trials, id="scikit-image"),
    ],
)
def test_call(benchmark: BenchmarkFixture, rule: Callable[..., float], exponent: int) -> None:
    benchmark.group = f"200 calls, N from 1e{exponent}"
    batch = problems(10.0**exponent, 10.0 ** (exponent + 3 if exponent < 12 else exponent + 6))

    def calls() -> None:
        for problem in batch:
            rule(*problem)

    benchmark(calls)


def test_hardest(benchmark: BenchmarkFixture) -> None:
    """The largest problem promised: one call must stay under a millisecond."""
    benchmark(required_trials, 20, 10**9, 20, 1.0 - 2.0**-53)
