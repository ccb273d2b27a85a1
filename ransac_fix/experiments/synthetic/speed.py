"""How fast the synthetic experiment is: beside the machine's peak, and beside scikit-image.

All in processor time of one thread, which is the wall-clock time of an idle machine and does not
count what a busy one spends on other programs.
"""

import time
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from ransac_fix.experiments.synthetic.instances import Instance, make_instance
from ransac_fix.experiments.synthetic.runs import fit_both
from ransac_fix.experiments.synthetic.setup import WHITENED_LIMIT, Setup, Shape

# Floating-point operations of one test of a point in the compiled loops: for a line two
# products, two sums, an absolute value and a comparison; for an ellipse what `count_geometric`
# does for each point in its vector loop.
FLOPS_A_TEST: dict[Shape, int] = {"line": 6, "ellipse": 25}

_MATRIX = 1000


@dataclass(frozen=True, slots=True)
class Speed:
    """One row's speed on one core.

    Parameters
    ----------
    setup : Setup
        The row.
    tests_a_second : float
        Tests of a point against a model, with everything else the run does.
    peak_flops : float
        Arithmetic peak of one core, double-precision operations a second.
    seconds : float
        Mean time of one instance, both rules together.
    n_instances : int
        Instances timed.
    ratios : tuple of float
        scikit-image's time divided by ours, for each instance it ran.
    peer_seconds : float or None
        Mean time of those instances in scikit-image; None where it ran none.
    """

    setup: Setup
    tests_a_second: float
    peak_flops: float
    seconds: float
    n_instances: int
    ratios: tuple[float, ...]
    peer_seconds: float | None

    @property
    def share_of_peak(self) -> float:
        """Arithmetic of the point tests alone, relative to the peak."""
        return self.tests_a_second * FLOPS_A_TEST[self.setup.shape] / self.peak_flops

    @property
    def ratio(self) -> float | None:
        """Median over instances of scikit-image's time divided by ours."""
        return median(self.ratios) if self.ratios else None


def speed_rows() -> list[tuple[Setup, int, int]]:
    """Return what is timed: setups, instances, and how many of them scikit-image runs too.

    The hardest and the easiest row of each table. Of the hardest ellipses scikit-image would take
    minutes an instance.
    """
    return [
        (Setup("line", 50, 10), 5000, 20),
        (Setup("line", 50, 25), 5000, 20),
        (Setup("ellipse", 100, 20), 500, 0),
        (Setup("ellipse", 100, 50), 2000, 5),
    ]


def measure_speed(setup: Setup, n_instances: int, n_peer: int) -> Speed:
    """Time instances of a setup, and some of them with scikit-image too.

    Parameters
    ----------
    setup : Setup
        The row.
    n_instances : int
        Instances to time here.
    n_peer : int
        How many of the first of them scikit-image runs, with the same measurements, sample
        size, inlier distance and confidence, under its own (approximate) rule.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        return _measure(setup, n_instances, n_peer)


def _measure(setup: Setup, n_instances: int, n_peer: int) -> Speed:
    trials = np.empty(2, np.int64)
    models = np.empty((2, 3 if setup.shape == "line" else 5))
    instances = [make_instance(setup, 0, i) for i in range(n_instances)]
    fit_both(setup, instances[0], trials, models)  # compiles
    seconds, tests = [], 0
    for instance in instances:
        start = time.process_time()
        tests += fit_both(setup, instance, trials, models)
        seconds.append(time.process_time() - start)
    peer = [_peer_seconds(setup, instance) for instance in instances[:n_peer]]
    return Speed(
        setup=setup,
        tests_a_second=tests / sum(seconds),
        peak_flops=peak_flops(),
        seconds=sum(seconds) / len(seconds),
        n_instances=n_instances,
        ratios=tuple(theirs / ours for theirs, ours in zip(peer, seconds, strict=False)),
        peer_seconds=sum(peer) / len(peer) if peer else None,
    )


def peak_flops() -> float:
    """Measure the double-precision operations a second of one core.

    The fastest of a few products of large matrices, which linear algebra libraries run close to
    what the processor can do at all.
    """
    matrix = np.random.default_rng(0).normal(size=(_MATRIX, _MATRIX))
    best = float("inf")
    for _ in range(5):
        start = time.process_time()
        matrix @ matrix
        best = min(best, time.process_time() - start)
    return 2 * _MATRIX**3 / best


def _peer_seconds(setup: Setup, instance: Instance) -> float:
    from skimage.measure import EllipseModel, LineModelND, ransac

    model: Any = LineModelND if setup.shape == "line" else EllipseModel
    start = time.process_time()
    ransac(
        instance.points,
        model,
        min_samples=setup.sample_size,
        residual_threshold=WHITENED_LIMIT[setup.limit] * float(instance.deviations[0]),
        max_trials=10**7,
        stop_probability=float(setup.confidence),
        rng=0,
    )
    return time.process_time() - start
