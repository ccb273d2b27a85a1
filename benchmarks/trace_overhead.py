"""What `ransac_fix.trace` costs a call: ``python benchmarks/trace_overhead.py``.

Short calls, bare and traced in turn: the least processor time of each, so that a busy machine
disturbs little. What a trace adds does not depend on how long a call takes. *worker*: each call
is written to a file too, as in a process that a traced program has started.
"""

import sys
import tempfile
from collections.abc import Callable
from time import process_time
from typing import Any

import cv2
import numpy as np
import skimage.measure
from skimage.transform import AffineTransform

import ransac_fix
from ransac_fix.patching import tracing
from ransac_fix.patching.recorder import Recorder

_ROUNDS, _CALLS = 40, 50


def _planted(n_samples: int, n_inliers: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1000, (n_samples, 2))
    y = rng.uniform(0, 1000, (n_samples, 2))
    y[:n_inliers] = x[:n_inliers] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    return x, y


def _time(call: Callable[[], Any]) -> float:
    start = process_time()
    for _ in range(_CALLS):
        call()
    return (process_time() - start) / _CALLS


def main() -> int:
    """Print milliseconds a call, bare and traced, and the difference; 1 where it is 2 % or more."""
    x, y = _planted(20, 15)
    calls: dict[str, Callable[[], Any]] = {
        "cv2.findHomography": lambda: cv2.findHomography(x, y, cv2.RANSAC, 1.0),
        "cv2.estimateAffine2D": lambda: cv2.estimateAffine2D(x, y),
        "skimage.measure.ransac": lambda: skimage.measure.ransac(
            (x, y), AffineTransform, 3, 1.0, max_trials=1, rng=1
        ),
    }
    print("| call | ms | traced, µs more | of 1 ms | worker, µs more | of 1 ms |")
    print("| --- | --- | --- | --- | --- | --- |")
    worst = 0.0
    for name, call in calls.items():
        bare = traced = worker = float("inf")
        for _ in range(_ROUNDS):
            bare = min(bare, _time(call))
            with ransac_fix.trace(), tempfile.TemporaryDirectory() as folder:
                call()
                traced = min(traced, _time(call))
                here, there = tracing._recorder, Recorder(folder, write=True)
                tracing._recorder = there
                call()
                worker = min(worker, _time(call))
                tracing._recorder = here
        more = [1e6 * (seconds - bare) for seconds in (traced, worker)]
        worst = max(worst, *more)
        cells = [f"{us:.1f} | {us / 10:.1f} %" for us in more]
        print(f"| {name} | {1e3 * bare:.3f} | {' | '.join(cells)} |", flush=True)
    return int(worst >= 20)


if __name__ == "__main__":
    sys.exit(main())
