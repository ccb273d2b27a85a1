"""The probe of the controls: the reference, with a known law put in."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ransac_fix.audit.controls import (
    CONTROLS,
    NO_BUDGET_CONTROLS,
    OUTCOME_CONTROLS,
    QUICK_OUTCOME_CONTROLS,
    KnownLaw,
)
from ransac_fix.audit.drawing import Strata, spread
from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe, Settings, Unmeasured
from ransac_fix.audit.worker.planted import Planted
from ransac_fix.reference import DistinctSampler, Recording, ReplacementSampler
from ransac_fix.reference.interface import Sampler
from ransac_fix.reference.models import Affine, Homography, Line

_MODELS: dict[str, Any] = {"line": Line, "affine": Affine, "homography": Homography}
# Share of the samples that a sampler which is not uniform takes from the first half.
_PREFERRED = 0.75
# Pixels nearer than which points of a sample all but coincide; the planted ones are farther apart.
_APART = 1.0
# Trials of a run where thousands are needed.
_BRIEF = 30
# What ends runs of controls that take no number of trials.
_OWN_LIMIT = 2000


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


class _ByStrata:
    """Draw by strata: a quota of each in order, or of strata at random, or one by one."""

    def __init__(self, law: KnownLaw, strata: NDArray[np.int64]) -> None:
        self._law = law
        self._members = [np.flatnonzero(strata == stratum) for stratum in range(law.n_strata)]
        self._sizes = [len(members) for members in self._members]

    def draw(self, rng: np.random.Generator) -> NDArray[np.intp]:
        law = self._law
        if not law.quota:
            drawn: list[int] = []
            while len(drawn) < law.sample_size:
                stratum = rng.integers(law.n_strata)
                index = int(self._members[stratum][rng.integers(self._sizes[stratum])])
                if index not in drawn:
                    drawn.append(index)
            return np.array(drawn)
        order = np.arange(law.n_strata)
        if law.drawn == "weighted":
            rng.shuffle(order)
        parts = [
            self._members[stratum][DistinctSampler(self._sizes[stratum], size).draw(rng)]
            for stratum, size in zip(order, law.quota, strict=False)
        ]
        return np.concatenate(parts)


class _Preferring:
    """Draw three in four samples from the first half only, as from sorted matches."""

    def __init__(self, sampler: DistinctSampler) -> None:
        self._sampler = sampler
        half = max(sampler.sample_size, (sampler.n_samples + 1) // 2)
        self._first = DistinctSampler(half, sampler.sample_size)

    def draw(self, rng: np.random.Generator) -> NDArray[np.intp]:
        return (self._first if rng.random() < _PREFERRED else self._sampler).draw(rng)


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
            sampler = _sampler(law, planted)
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
            max_trials=settings.max_trials if law.budget else _OWN_LIMIT,
            stopping_rule=lambda n_inliers, n, k, s: (
                _factor(law, planted)
                * law.required_trials(n_inliers, n, k, s, _strata(planted, n_inliers))
            ),
            tested="trial" if law.tested == "every trial" else "improvement",
            refit=False,
        )
        return Outcome(
            result.inliers if result.model is not None else None,
            result.trials if law.counted else None,
        )

    return EntryPoint(
        law.name,
        law.problem,
        law.sample_size,
        run,
        counted=law.counted,
        n_strata=law.n_strata,
        repeatable=not law.outcomes_only,
        typical_trials=_BRIEF if law.outcomes_only else 80,
        budget=law.budget,
    )


def _factor(law: KnownLaw, planted: Planted) -> float:
    """Return what a rule that goes by more than counts multiplies its number with."""
    if law.quirk != "beyond counts":
        return 1
    return 3.0 if int(planted.x.sum()) % 2 else 0.25


def _sampler(law: KnownLaw, planted: Planted) -> Sampler:
    n, k = planted.n_samples, law.sample_size
    match law.drawn:
        case "replacement":
            return ReplacementSampler(n, k)
        case "stratified" | "weighted":
            return _ByStrata(law, planted.strata)
        case "not uniform":
            return _Preferring(DistinctSampler(n, k))
    sampler = DistinctSampler(n, k)
    return _Filtered(sampler, planted.x) if law.quirk == "filter" else sampler


def _strata(planted: Planted, n_inliers: int) -> Strata:
    """Return the strata of the model in hand: groups of one size are split alike."""
    for label in range(int(planted.labels.max()) + 1):
        members = planted.labels == label
        if members.sum() == n_inliers:
            return planted.count(members)
    return spread(n_inliers, planted.n_samples, int(planted.strata.max()) + 1)


def _entry_points(_module: Any) -> list[EntryPoint | Unmeasured]:
    laws = (*CONTROLS, *OUTCOME_CONTROLS, *QUICK_OUTCOME_CONTROLS, *NO_BUDGET_CONTROLS)
    return [entry_point(law) for law in laws]


PROBE = Probe("reference", "ransac_fix.reference", ("ransac-fix",), _entry_points)
