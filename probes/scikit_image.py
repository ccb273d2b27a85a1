"""scikit-image: ``skimage.measure.ransac``, whose ``is_data_valid`` is called once a trial."""

import inspect
import warnings
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


class _Line:
    """The line through two points, in both forms of scikit-image's model protocol."""

    def __init__(self, slope: float = 0.0, offset: float = 0.0) -> None:
        self.slope = slope
        self.offset = offset

    def estimate(self, data: Any) -> bool:
        x, y = data[:, 0], data[:, 1]
        x0, y0 = x.mean(), y.mean()
        dx = x - x0
        self.slope = (dx * (y - y0)).sum() / (dx * dx).sum()
        self.offset = y0 - self.slope * x0
        return True

    @classmethod
    def from_estimate(cls, data: Any) -> "_Line":
        model = cls()
        model.estimate(data)
        return model

    def residuals(self, data: Any) -> Any:
        return self.slope * data[:, 0] + self.offset - data[:, 1]


def _entry_points(measure: Any) -> list[EntryPoint | Unmeasured]:
    parameters = inspect.signature(measure.ransac).parameters
    # `random_state` became `rng` in 0.21.
    seed_name = "rng" if "rng" in parameters else "random_state"

    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options: dict[str, Any] = {seed_name: seed}
        if settings is not None:
            options["max_trials"] = settings.max_trials
            options["stop_probability"] = settings.confidence
        trials = 0

        def count(_sample: Any) -> bool:
            nonlocal trials
            trials += 1
            return True

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _, inliers = measure.ransac(
                np.hstack([planted.x, planted.y]),
                _Line,
                min_samples=2,
                residual_threshold=planted.threshold,
                is_data_valid=count,
                **options,
            )
        return Outcome(None if inliers is None else np.asarray(inliers, dtype=bool), trials)

    return [
        EntryPoint(
            "measure.ransac",
            "line",
            2,
            run,
            Defaults(
                float(parameters["stop_probability"].default),
                max_trials=int(parameters["max_trials"].default),
            ),
            counted=True,
            typical_trials=40,
        )
    ]


PROBE = Probe("scikit-image", "skimage.measure", ("scikit-image",), _entry_points)
