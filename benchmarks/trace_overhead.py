"""What `ransac_fix.trace` costs a call: ``python benchmarks/trace_overhead.py``.

Short calls, bare and traced in turn, each problem after another: the median of the differences in
processor time, so that a busy machine disturbs little. What a trace adds does not depend on how
long a call takes. *worker*: each call is written to a file, as by the program of `ransac-fix trace`
and by processes that a traced program has started. *summing up* comes on top: in a ``with`` block
for 256 calls together, in a worker for some five thousand once its file is full, and for what is
left when the program has ended.
"""

import random
import statistics
import sys
import tempfile
from collections.abc import Callable
from time import process_time
from types import ModuleType
from typing import Any, TypeAlias

import cv2
import numpy as np
import skimage.measure
from skimage.transform import AffineTransform

import ransac_fix
from ransac_fix.patching import tracing
from ransac_fix.patching.recorder import Recorder, merge

Points: TypeAlias = tuple[np.ndarray, np.ndarray]
Call: TypeAlias = Callable[[Callable[..., Any], Points], Any]

_ROUNDS, _CALLS = 20, 256


def _planted(n_samples: int, n_inliers: int) -> Points:
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1000, (n_samples, 2))
    y = rng.uniform(0, 1000, (n_samples, 2))
    y[:n_inliers] = x[:n_inliers] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    return x, y


def _measure(holder: ModuleType, name: str, call: Call) -> tuple[float, float, float]:
    """Return seconds a call: bare, and what a trace and a trace in a worker add."""
    bare = getattr(holder, name)
    problems = [_planted(20 + i // 4, 15 + i // 5) for i in range(_CALLS)]
    taken: list[tuple[float, ...]] = []
    with ransac_fix.trace(), tempfile.TemporaryDirectory() as folder:
        traced = getattr(holder, name)
        here = tracing._recorder
        kinds = (bare, here), (traced, here), (traced, Recorder(folder, write=True))
        for points in problems * _ROUNDS:
            seconds = [0.0] * len(kinds)
            # In another order every time: else the garbage collector comes to one kind only.
            for kind in random.sample(range(len(kinds)), len(kinds)):
                function, tracing._recorder = kinds[kind]
                start = process_time()
                call(function, points)
                seconds[kind] = process_time() - start
            taken.append(tuple(seconds))
        tracing._recorder = here
    more = [statistics.median(t[kind] - t[0] for t in taken) for kind in (1, 2)]
    return statistics.median(t[0] for t in taken), *more


def _summing_up() -> float:
    """Return seconds a call to sum up calls that all differ, written to a file before."""
    with tempfile.TemporaryDirectory() as folder:
        writer = Recorder(folder, write=True)
        key = ("opencv", "findHomography", __file__, 1, "main")
        for i in range(4_000):
            facts = (900 + i % 97, 2000 + i, 4, 0.99, 50 + i % 89, 2000, "distinct", None)
            writer.add(key, (facts, 1e-3 + 1e-6 * i, False, False, 0.0))
        start = process_time()
        merge(Recorder(folder, write=False))
        return (process_time() - start) / 4_000


def main() -> int:
    """Print what calls cost; 1 where a trace adds 2 % or more to a call of a millisecond."""
    calls: tuple[tuple[ModuleType, str, Call], ...] = (
        (cv2, "findHomography", lambda f, points: f(*points, cv2.RANSAC, 1.0)),
        (cv2, "estimateAffine2D", lambda f, points: f(*points)),
        (
            skimage.measure,
            "ransac",
            lambda f, points: f(points, AffineTransform, 3, 1.0, max_trials=1, rng=1),
        ),
    )
    summing_up = 1e6 * _summing_up()
    print(f"summing up: {summing_up:.1f} µs a call\n")
    print("| call | ms | traced, µs more | of 1 ms | worker, µs more | of 1 ms |")
    print("| --- | --- | --- | --- | --- | --- |")
    worst = 0.0
    for holder, name, call in calls:
        bare, *seconds = _measure(holder, name, call)
        more = [1e6 * value for value in seconds]
        worst = max(worst, *more)
        cells = [f"{us:.1f} | {us / 10:.1f} %" for us in more]
        label = f"{holder.__name__}.{name}"
        print(f"| {label} | {1e3 * bare:.3f} | {' | '.join(cells)} |", flush=True)
    return int(worst + summing_up >= 20)


if __name__ == "__main__":
    sys.exit(main())
