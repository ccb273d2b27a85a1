"""What `ransac_fix.trace` costs a call: ``python benchmarks/trace_overhead.py``.

Calls of about a millisecond, bare and traced in turn, so that a busy machine disturbs both alike.
"""

import statistics
from collections.abc import Callable
from time import perf_counter
from typing import Any

import cv2
import numpy as np
import skimage.measure
from skimage.transform import AffineTransform

import ransac_fix

_ROUNDS, _CALLS = 12, 20


def _planted(n_samples: int, n_inliers: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1000, (n_samples, 2))
    y = rng.uniform(0, 1000, (n_samples, 2))
    y[:n_inliers] = x[:n_inliers] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    return x, y


def _time(call: Callable[[], Any]) -> float:
    start = perf_counter()
    for _ in range(_CALLS):
        call()
    return (perf_counter() - start) / _CALLS


def main() -> None:
    """Print milliseconds a call, bare and traced, and the difference."""
    x, y = _planted(300, 90)
    few_x, few_y = _planted(40, 30)
    calls: dict[str, Callable[[], Any]] = {
        "opencv findHomography": lambda: cv2.findHomography(x, y, cv2.RANSAC, 1.0),
        "opencv estimateAffine2D": lambda: cv2.estimateAffine2D(x, y),
        "scikit-image ransac": lambda: skimage.measure.ransac(
            (few_x, few_y), AffineTransform, 3, 1.0, max_trials=5, rng=1
        ),
    }
    for name, call in calls.items():
        call()
        bare, traced = [], []
        for _ in range(_ROUNDS):
            bare.append(_time(call))
            with ransac_fix.trace():
                call()
                traced.append(_time(call))
        differences = [b - a for a, b in zip(bare, traced, strict=True)]
        print(
            f"{name}: bare {1e3 * statistics.median(bare):.3f} ms, fastest"
            f" {1e3 * min(bare):.3f}; traced {1e3 * statistics.median(traced):.3f} ms, fastest"
            f" {1e3 * min(traced):.3f}; median difference"
            f" {1e6 * statistics.median(differences):.1f} microseconds"
        )


if __name__ == "__main__":
    main()
