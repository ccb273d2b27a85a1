"""kornia: ``RANSAC``. It draws in batches, so batches of one are asked for and counted.

Its sampler is a method, so the samples that one large batch draws are looked at as they are.
"""

import inspect
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import CENTRE, FOCAL, Planted, plant

# Model type, planted problem, k, spare, typical trials.
_MODELS = (
    ("homography", "homography", 4, 1, 12),
    ("affine", "affine", 3, 1, 12),
    ("fundamental", "fundamental", 7, 2, 10),
    ("fundamental_8pt", "fundamental", 8, 2, 10),
    ("essential", "essential", 5, 2, 8),
    ("homography_from_linesegments", "segments", 4, 1, 12),
)


class _Model:
    """One model type."""

    def __init__(self, ransac: Any, torch: Any, model: str, problem: str) -> None:
        self._ransac, self._torch = ransac, torch
        self._model, self._problem = model, problem
        self._seeds = "seed" in inspect.signature(ransac.RANSAC.__init__).parameters

    def untouched(self) -> Any:
        """Return the estimator at its defaults."""
        return self._ransac.RANSAC(self._model)

    def run(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options: dict[str, Any] = {}
        if settings is not None:
            options["batch_size"] = 1
            options["max_iter"] = settings.max_trials
            options["confidence"] = settings.confidence
        inliers, samples = self._estimate(planted, seed, options)
        return Outcome(inliers, len(samples))

    def draws(self, n: int, count: int, seed: int) -> NDArray[np.int64]:
        planted = plant(self._problem, n, 0, 0, 0, seed)
        _, samples = self._estimate(planted, seed, {"batch_size": count, "max_iter": 1})
        return samples

    def _estimate(
        self, planted: Planted, seed: int, options: dict[str, Any]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        x, y, threshold = planted.x, planted.y, planted.threshold
        if self._model == "essential":
            x, y, threshold = (x - CENTRE) / FOCAL, (y - CENTRE) / FOCAL, threshold / FOCAL
        if self._problem == "segments":
            x, y = x.reshape(-1, 2, 2), y.reshape(-1, 2, 2)
        if self._seeds:
            options["seed"] = seed
        self._torch.manual_seed(seed)
        estimator = self._ransac.RANSAC(self._model, inl_th=threshold, **options)
        sample = estimator.sample
        drawn: list[Any] = []

        def watched(*args: Any, **kwargs: Any) -> Any:
            indices = sample(*args, **kwargs)
            drawn.append(indices.numpy())
            return indices

        estimator.sample = watched
        _, inliers = estimator(self._torch.from_numpy(x), self._torch.from_numpy(y))
        mask = np.asarray(inliers.reshape(-1).numpy(), dtype=bool)
        return mask, np.concatenate(drawn)


def _entry_points(ransac: Any) -> list[EntryPoint | Unmeasured]:
    import torch

    torch.set_num_threads(1)
    torch.set_grad_enabled(False)
    supported = ransac.RANSAC("homography").supported_models
    found: list[EntryPoint | Unmeasured] = []

    def add(name: str, problem: str, k: int, spare: int, typical: int, model: _Model) -> None:
        untouched = model.untouched()
        batch = untouched.batch_size if isinstance(untouched.batch_size, int) else 2048
        found.append(
            EntryPoint(
                f"RANSAC({name})",
                problem,
                k,
                model.run,
                Defaults(
                    float(untouched.confidence),
                    max_trials=int(untouched.max_iter) * batch,
                    max_trials_name="max_iter",
                ),
                counted=True,
                typical_trials=typical,
                spare=spare,
                draws=model.draws,
            )
        )

    for name, problem, k, spare, typical in _MODELS:
        if name in supported:
            add(name, problem, k, spare, typical, _Model(ransac, torch, name, problem))
    if "prosac_sampling" in inspect.signature(ransac.RANSAC.__init__).parameters:
        why = (
            "by its documentation it stops by PROSAC's test on the best-ranked measurements, which "
            "is no rule in the counts of inliers and measurements"
        )
        found.append(Unmeasured("RANSAC(homography, prosac_sampling)", why))
    return found


PROBE = Probe("kornia", "kornia.geometry.ransac", ("kornia",), _entry_points)
