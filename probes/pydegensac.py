"""pydegensac: LO-RANSAC and DEGENSAC. Local optimisation cannot be switched off."""

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


def _outcome(mask: Any) -> Outcome:
    inliers = np.asarray(mask, dtype=bool).reshape(-1)
    return Outcome(inliers if inliers.any() else None)


def _entry_points(pydegensac: Any) -> list[EntryPoint | Unmeasured]:
    def bound(function: Any) -> Any:
        seeded = "seed" in inspect.signature(function).parameters

        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            options: dict[str, Any] = {"seed": seed % 2**31} if seeded else {}
            if settings is not None:
                options["conf"] = settings.confidence
                options["max_iters"] = settings.max_trials
            found = function(planted.x, planted.y, planted.threshold, **options)
            return _outcome(found[1])

        return run

    def defaults(function: Any) -> Defaults:
        parameters = inspect.signature(function).parameters
        return Defaults(
            float(parameters["conf"].default),
            max_trials=int(parameters["max_iters"].default),
            max_trials_name="max_iters",
        )

    if "seed" not in inspect.signature(pydegensac.findHomography).parameters:
        why = "its random stream is seeded from the clock and cannot be fixed before 0.3.0"
        return [Unmeasured(name, why) for name in ("findHomography", "findFundamentalMatrix")]
    return [
        EntryPoint(
            "findHomography",
            "homography",
            4,
            bound(pydegensac.findHomography),
            defaults(pydegensac.findHomography),
        ),
        EntryPoint(
            "findFundamentalMatrix",
            "fundamental",
            7,
            bound(pydegensac.findFundamentalMatrix),
            defaults(pydegensac.findFundamentalMatrix),
            spare=2,
        ),
    ]


PROBE = Probe("pydegensac", "pydegensac", ("pydegensac",), _entry_points)
