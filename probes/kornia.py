"""kornia: ``RANSAC``. It draws in batches, so batches of one are asked for and counted."""

import inspect
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


def _entry_points(ransac: Any) -> list[EntryPoint | Unmeasured]:
    import torch

    torch.set_num_threads(1)
    parameters = inspect.signature(ransac.RANSAC.__init__).parameters

    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        options: dict[str, Any] = {"seed": seed} if "seed" in parameters else {}
        if settings is not None:
            options["batch_size"] = 1
            options["max_iter"] = settings.max_trials
            options["confidence"] = settings.confidence
        torch.manual_seed(seed)
        estimator = ransac.RANSAC("homography", inl_th=planted.threshold, **options)
        sample = estimator.sample
        trials = 0

        def counted(*args: Any, **kwargs: Any) -> Any:
            nonlocal trials
            indices = sample(*args, **kwargs)
            trials += len(indices)
            return indices

        estimator.sample = counted
        _, inliers = estimator(torch.from_numpy(planted.x), torch.from_numpy(planted.y))
        return Outcome(np.asarray(inliers.reshape(-1).numpy(), dtype=bool), trials)

    untouched = ransac.RANSAC("homography")
    batch = untouched.batch_size if isinstance(untouched.batch_size, int) else 2048
    return [
        EntryPoint(
            "RANSAC(homography)",
            "homography",
            4,
            run,
            Defaults(
                float(untouched.confidence),
                max_trials=int(untouched.max_iter) * batch,
                max_trials_name="max_iter",
            ),
            counted=True,
            typical_trials=12,
        )
    ]


PROBE = Probe("kornia", "kornia.geometry.ransac", ("kornia",), _entry_points)
