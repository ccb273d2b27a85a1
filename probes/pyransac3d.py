"""pyRANSAC-3D: loops over ``maxIteration`` trials; there is no confidence to give it.

It draws with the ``random`` module of Python. Its callback sees every trial.
"""

import random
from collections.abc import Callable
from typing import Any

import numpy as np

from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import Planted


def _space(planted: Planted) -> Any:
    return planted.x


def _flat(planted: Planted) -> Any:
    """Put a line of the plane into space."""
    return np.column_stack([planted.x, planted.y, np.zeros(planted.n_samples)])


def _entry_points(pyransac3d: Any) -> list[EntryPoint | Unmeasured]:
    def bound(shape: Any, points: Callable[[Planted], Any]) -> Any:
        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            random.seed(seed)
            trials = 0

            def count(_state: Any) -> None:
                nonlocal trials
                trials += 1

            options = {} if settings is None else {"maxIteration": settings.max_trials}
            found = shape()
            found.fit(points(planted), thresh=planted.threshold, callback=count, **options)
            inliers = np.zeros(planted.n_samples, dtype=bool)
            inliers[np.asarray(found.inliers, dtype=int)] = True
            return Outcome(inliers if inliers.any() else None, trials)

        return run

    return [
        EntryPoint(
            "Plane.fit",
            "plane",
            3,
            bound(pyransac3d.Plane, _space),
            Defaults(1.0, max_trials=1000, max_trials_name="maxIteration"),
            typical_trials=20,
            counted=True,
        ),
        EntryPoint(
            "Line.fit",
            "line",
            2,
            bound(pyransac3d.Line, _flat),
            Defaults(1.0, max_trials=1000, max_trials_name="maxIteration"),
            typical_trials=20,
            counted=True,
        ),
    ]


PROBE = Probe("pyransac3d", "pyransac3d", ("pyransac3d",), _entry_points)
