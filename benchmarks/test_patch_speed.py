"""What patches cost: a passed-on call, a block, a drop-in call, a worker's start.

Run with ``python -m pytest benchmarks/test_patch_speed.py``.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from sklearn.linear_model import RANSACRegressor, _ransac

import ransac_fix
from ransac_fix.patches.scikit_learn import RANSACRegressor as Exact
from ransac_fix.patching import startup
from ransac_fix.patching.switch import Switch, stand_in

COUNTS = (6, 20, 2, 0.99)


def bare(n_inliers: int, n_samples: int, sample_size: int, confidence: float) -> None:
    del n_inliers, n_samples, sample_size, confidence


@pytest.mark.parametrize("state", ["bare", "passed on", "in a block", "everywhere"])
def test_dispatch(benchmark: BenchmarkFixture, state: str) -> None:
    benchmark.group = "a call of a function that does nothing"
    switch = Switch("benchmark")
    function = bare if state == "bare" else stand_in(bare, bare, switch)
    if state == "in a block":
        switch.enter_here()
    switch.ask(state == "everywhere")

    def calls() -> None:
        for _ in range(1000):
            function(*COUNTS)

    benchmark(calls)


@pytest.mark.parametrize("state", ["bare", "patched"])
def test_rule(benchmark: BenchmarkFixture, state: str) -> None:
    benchmark.group = "1000 calls of scikit-learn's rule"
    if state == "patched":
        ransac_fix.patch("scikit-learn")
    rule = _ransac._dynamic_max_trials

    def calls() -> None:
        for _ in range(1000):
            rule(*COUNTS)

    try:
        benchmark(calls)
    finally:
        ransac_fix.unpatch()


def test_block(benchmark: BenchmarkFixture) -> None:
    benchmark.group = "entering and leaving a block"

    def block() -> None:
        with ransac_fix.patched("scikit-learn"):
            pass

    benchmark(block)


@pytest.mark.parametrize("cls", [RANSACRegressor, Exact], ids=["original", "drop-in"])
def test_fit(benchmark: BenchmarkFixture, cls: type) -> None:
    """All points are inliers, so both make one trial: the difference is the drop-in's."""
    benchmark.group = "a fit of one trial"
    x = np.arange(20.0)[:, None]
    regressor = cls(min_samples=2, residual_threshold=1e-6, random_state=0)
    benchmark(regressor.fit, x, x[:, 0])
    assert regressor.n_trials_ == 1


@pytest.mark.parametrize("state", ["bare", "patched"])
def test_worker_start(benchmark: BenchmarkFixture, state: str) -> None:
    """A Python that imports nothing of what is waited for."""
    benchmark.group = "the start of a Python process"
    environ = {k: v for k, v in os.environ.items() if not k.startswith("RANSAC_FIX")}
    if state == "patched":
        startup.environment(environ, {"scikit-learn": ("sklearn.linear_model._ransac",)})
    line = [sys.executable, "-c", "pass"]
    benchmark.pedantic(
        subprocess.run, (line,), {"env": environ, "check": True}, rounds=40, warmup_rounds=3
    )
