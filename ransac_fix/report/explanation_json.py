"""An explanation as JSON. The schema is `schemas/explanation.json` beside this file."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

from ransac_fix.criterion import Stratum
from ransac_fix.experiments.explanation import Explanation, LawOutcome, Problem

SCHEMA_VERSION: Literal[1] = 1


@dataclass(frozen=True, slots=True)
class ExplanationRecord:
    """One explanation; probabilities are floats, and null stands for infinite."""

    n_samples: int
    n_inliers: int
    sample_size: int
    confidence: float
    strata: tuple[Stratum, ...]
    min_trials: int
    max_trials: int | None
    approximate_probability: float
    approximate_trials: int | None
    laws: tuple[LawOutcome, ...]


@dataclass(frozen=True, slots=True)
class ExplanationDocument:
    """What ``ransac-fix explain --output-format json`` prints."""

    schema_version: Literal[1]
    explanation: ExplanationRecord
    sweep: tuple[ExplanationRecord, ...] | None


def explanation_json(explanation: Explanation, sweep: Sequence[Explanation] | None) -> str:
    """Return the explanation, and the sweep where one was asked for, as a JSON document."""
    document = ExplanationDocument(
        SCHEMA_VERSION,
        _record(explanation),
        None if sweep is None else tuple(_record(row) for row in sweep),
    )
    # Not msgspec: subsets can be counted by integers beyond its 64 bits.
    return json.dumps(asdict(document), indent=2)


def _record(explanation: Explanation) -> ExplanationRecord:
    problem: Problem = explanation.problem
    return ExplanationRecord(
        n_samples=problem.n_samples,
        n_inliers=problem.n_inliers,
        sample_size=problem.sample_size,
        confidence=float(problem.confidence),
        strata=problem.strata,
        min_trials=problem.min_trials,
        max_trials=problem.max_trials,
        approximate_probability=explanation.approximate_probability,
        approximate_trials=explanation.approximate_trials,
        laws=explanation.laws,
    )
