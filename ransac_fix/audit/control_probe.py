"""The probe of the controls: the reference, with a known law put in."""

from typing import Any

import numpy as np

from ransac_fix.audit.controls import CONTROLS, KnownLaw
from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe, Settings, Unmeasured
from ransac_fix.audit.worker.planted import Planted
from ransac_fix.reference import DistinctSampler, Recording, ReplacementSampler
from ransac_fix.reference.models import Affine, Homography, Line

_MODELS: dict[str, Any] = {"line": Line, "affine": Affine, "homography": Homography}


def entry_point(law: KnownLaw) -> EntryPoint:
    """Return the reference under this law.

    Parameters
    ----------
    law : KnownLaw
        The law.
    """
    # One stream is run dozens of times: its trials are evaluated once.
    kept: tuple[Planted, int, Recording[Any]] | None = None

    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        nonlocal kept
        assert settings is not None
        if kept is None or kept[0] is not planted or kept[1] != seed:
            sampler = ReplacementSampler if law.drawn == "replacement" else DistinctSampler
            recording: Recording[Any] = Recording(
                np.hstack([planted.x, planted.y]),
                _MODELS[law.problem](),
                residual_threshold=planted.threshold,
                sampler=sampler(planted.n_samples, law.sample_size),
                rng=seed,
            )
            kept = planted, seed, recording
        result = kept[2].run(
            confidence=settings.confidence,
            max_trials=settings.max_trials,
            stopping_rule=law.required_trials,
            tested="trial" if law.tested == "every trial" else "improvement",
            refit=False,
        )
        return Outcome(
            result.inliers if result.model is not None else None,
            result.trials if law.counted else None,
        )

    return EntryPoint(law.name, law.problem, law.sample_size, run, counted=law.counted)


def _entry_points(_module: Any) -> list[EntryPoint | Unmeasured]:
    return [entry_point(law) for law in CONTROLS]


PROBE = Probe("reference", "ransac_fix.reference", ("ransac-fix",), _entry_points)
