"""What `ransac_fix.trace` costs a call: ``python benchmarks/trace_overhead.py``.

Short calls, bare and traced in turn, call by call: the median over rounds of the difference in
processor time, so that a busy machine disturbs little. What a trace adds does not depend on how
long a call takes. *worker*: each call
is written to a file too, as in a process that a traced program has started.
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
from ransac_fix.patching.recorder import Recorder

Call: TypeAlias = Callable[[Callable[..., Any]], Any]

# As many calls a round as are summed up together, so that every round holds its share of that.
_ROUNDS, _CALLS = 20, 256


def _planted(n_samples: int, n_inliers: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1000, (n_samples, 2))
    y = rng.uniform(0, 1000, (n_samples, 2))
    y[:n_inliers] = x[:n_inliers] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    return x, y


def _measure(holder: ModuleType, name: str, call: Call) -> tuple[float, float, float]:
    """Return seconds a call: bare, and what a trace and a trace in a worker add."""
    bare = getattr(holder, name)
    rounds = []
    with ransac_fix.trace(), tempfile.TemporaryDirectory() as folder:
        traced = getattr(holder, name)
        here = tracing._recorder
        kinds = (bare, here), (traced, here), (traced, Recorder(folder, write=True))
        for _ in range(_ROUNDS):
            seconds = [0.0] * len(kinds)
            for _ in range(_CALLS):
                # In another order every time: else the garbage collector comes to one kind only.
                for kind in random.sample(range(len(kinds)), len(kinds)):
                    function, tracing._recorder = kinds[kind]
                    start = process_time()
                    call(function)
                    seconds[kind] += process_time() - start
            rounds.append([total / _CALLS for total in seconds])
        tracing._recorder = here
    more = [statistics.median(r[kind] - r[0] for r in rounds) for kind in (1, 2)]
    return min(r[0] for r in rounds), *more


def main() -> int:
    """Print milliseconds a call, bare and traced, and the difference; 1 where it is 2 % or more."""
    x, y = _planted(20, 15)
    calls: tuple[tuple[ModuleType, str, Call], ...] = (
        (cv2, "findHomography", lambda f: f(x, y, cv2.RANSAC, 1.0)),
        (cv2, "estimateAffine2D", lambda f: f(x, y)),
        (
            skimage.measure,
            "ransac",
            lambda f: f((x, y), AffineTransform, 3, 1.0, max_trials=1, rng=1),
        ),
    )
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
    return int(worst >= 20)


if __name__ == "__main__":
    sys.exit(main())
