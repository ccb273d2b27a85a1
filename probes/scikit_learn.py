"""scikit-learn: ``RANSACRegressor``, whose ``n_trials_`` reports the trials run."""

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


def _entry_points(_sklearn: Any) -> list[EntryPoint | Unmeasured]:
    from sklearn.base import BaseEstimator, RegressorMixin
    from sklearn.linear_model import RANSACRegressor

    class Line(RegressorMixin, BaseEstimator):  # type: ignore[misc]
        """A line through points: the least squares of LinearRegression without its overhead."""

        def fit(self, x: Any, y: Any) -> "Line":
            x, y = x[:, 0], y.ravel()
            x0, y0 = x.mean(), y.mean()
            dx = x - x0
            self.slope_ = (dx * (y - y0)).sum() / (dx * dx).sum()
            self.offset_ = y0 - self.slope_ * x0
            return self

        def predict(self, x: Any) -> Any:
            return self.slope_ * x[:, 0] + self.offset_

        def score(self, x: Any, y: Any, sample_weight: Any = None) -> float:  # noqa: ARG002 -- scikit-learn passes it
            return -float(np.abs(y.ravel() - self.predict(x)).sum())

    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options: dict[str, Any] = {}
        if settings is not None:
            options = {
                "max_trials": settings.max_trials,
                "stop_probability": settings.confidence,
            }
        regressor = RANSACRegressor(
            Line(),
            min_samples=2,
            residual_threshold=planted.threshold,
            random_state=seed,
            **options,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            regressor.fit(planted.x, planted.y.ravel())
        return Outcome(np.asarray(regressor.inlier_mask_, dtype=bool), int(regressor.n_trials_))

    defaults = RANSACRegressor(Line()).get_params()
    return [
        EntryPoint(
            "RANSACRegressor",
            "line",
            2,
            run,
            Defaults(
                float(defaults["stop_probability"]),
                max_trials=int(defaults["max_trials"]),
            ),
            counted=True,
            typical_trials=40,
        )
    ]


PROBE = Probe("scikit-learn", "sklearn", ("scikit-learn",), _entry_points)
