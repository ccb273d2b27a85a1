"""What a library's own defaults promise."""

import math
from collections.abc import Sequence
from typing import Any

from ransac_fix.audit.drawing import Drawing, Strata, spread, totals
from ransac_fix.audit.laws import law_probability
from ransac_fix.audit.model import AtDefaults, Binding, Guarantee, SamplerLaw, StoppingLaw
from ransac_fix.audit.sampling import drawing_of


def standard_problems(sample_size: int) -> tuple[tuple[int, int], ...]:
    """Return the (n, I) at which rules are compared: few matches, an easy, a usual, a hard one.

    Parameters
    ----------
    sample_size : int
        k. The few are 20, or more where a sample is so large that 20 would hold little else.
    """
    return (max(20, sample_size + 6), sample_size + 3), (100, 60), (200, 50), (100, 20)


# More trials than anybody waits for.
_ENDLESS = 2**62


def at_defaults(
    declared: dict[str, Any],
    law: StoppingLaw | None,
    sampler: SamplerLaw,
    problems: Sequence[tuple[int, int, float | None]],
    checked: bool | None,
    n_strata: int = 1,
) -> AtDefaults:
    """Work out what binds and what it guarantees.

    Parameters
    ----------
    declared : dict
        The probe's `Defaults`, as read from the library.
    law : StoppingLaw or None
        The law measured; None where none was found: then only floor and cap are known.
    sampler : SamplerLaw
        How samples are drawn.
    problems : sequence of (n, I, s)
        Where to evaluate; s None for the library's default.
    checked : bool or None
        Whether runs at the defaults behaved so.
    n_strata : int
        Strata to spread the problems over, evenly.

    Returns
    -------
    AtDefaults
    """
    rows = []
    for n, n_inliers, confidence in problems:
        if law is None or n_inliers < sampler.sample_size:
            continue
        s = declared["confidence"] if confidence is None else confidence
        strata = spread(n_inliers, n, n_strata)
        rows.append(_guarantee(strata, s, declared, law, drawing_of(sampler)))
    return AtDefaults(
        confidence=declared["confidence"],
        min_trials=declared["min_trials"],
        max_trials=declared["max_trials"],
        multiplier=declared["multiplier"],
        checked=checked,
        guarantees=tuple(rows),
        n_strata=n_strata,
    )


def rule_trials(law: StoppingLaw, strata: Strata, confidence: float) -> int:
    """Return the trials that a law lets happen, with the multiplier it was measured with.

    Parameters
    ----------
    law : StoppingLaw
        The law; of a range of shifts the smallest counts.
    strata : tuple of (inliers, measurements)
        The problem.
    confidence : float
        s.

    Returns
    -------
    int
        At least 1, and at most 2^62, which stands for a run without end.
    """
    probability = law_probability(law, *totals(strata), strata)
    if probability >= 1 or confidence <= 0:
        return 1
    if probability <= 0 or confidence >= 1:
        return _ENDLESS
    x = law.multiplier * math.log1p(-confidence) / math.log1p(-probability)
    if x >= _ENDLESS:
        return _ENDLESS
    shift = 1.0 if law.phi is None else law.phi[0]
    return max(1, math.floor(x + shift))


def _guarantee(
    strata: Strata,
    confidence: float,
    declared: dict[str, Any],
    law: StoppingLaw,
    drawing: Drawing,
) -> Guarantee:
    trials = rule_trials(law, strata, confidence)
    if trials < _ENDLESS:
        trials = math.ceil(trials * declared["multiplier"])
    binds: Binding = "rule"
    if trials < declared["min_trials"]:
        trials, binds = declared["min_trials"], "minimum"
    if declared["max_trials"] is not None and trials > declared["max_trials"]:
        trials, binds = declared["max_trials"], "maximum"
    n_inliers, n = totals(strata)
    exact = drawing.required_trials(strata, confidence)
    return Guarantee(
        n=n,
        n_inliers=n_inliers,
        sample_size=drawing.sample_size,
        confidence=confidence,
        trials=trials,
        exact_trials=None if math.isinf(exact) else int(exact),
        binds=binds,
        probability=drawing.success_probability(trials, strata),
    )
