"""The probe of the controls: the reference, with a known law put in."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ransac_fix.audit.controls import CONTROLS, KnownLaw
from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe, Settings, Unmeasured
from ransac_fix.audit.worker.planted import Planted
from ransac_fix.reference import DistinctSampler, Recording, ReplacementSampler
from ransac_fix.reference.interface import Sampler
from ransac_fix.reference.models import Affine, Homography, Line

_MODELS: dict[str, Any] = {"line": Line, "affine": Affine, "homography": Homography}


class _Filtered:
    """Draw again, without counting a trial, while two points of the sample all but coincide."""

    def __init__(self, sampler: Sampler, points: NDArray[np.float64]) -> None:
        self._sampler = sampler
        self._points = points

    def draw(self, rng: np.random.Generator) -> NDArray[np.intp]:
        while True:
            sample = self._sampler.draw(rng)
            points = self._points[sample]
            apart = np.linalg.norm(points[:, None] - points[None], axis=2)
            if apart[np.triu_indices(len(sample), 1)].min() > _APART:
                return sample


# Pixels; the planted points are farther apart.
_APART = 1.0


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
            kind = ReplacementSampler if law.drawn == "replacement" else DistinctSampler
            sampler: Sampler = kind(planted.n_samples, law.sample_size)
            if law.quirk == "filter":
                sampler = _Filtered(sampler, planted.x)
            recording: Recording[Any] = Recording(
                np.hstack([planted.x, planted.y]),
                _MODELS[law.problem](),
                residual_threshold=planted.threshold,
                sampler=sampler,
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
