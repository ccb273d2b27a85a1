"""What a library's own defaults promise."""

import math
from collections.abc import Sequence
from typing import Any

from ransac_fix.audit.laws import law_probability
from ransac_fix.audit.model import AtDefaults, Binding, Guarantee, SamplerLaw, StoppingLaw
from ransac_fix.criterion import required_trials, success_probability


def standard_problems(sample_size: int) -> tuple[tuple[int, int], ...]:
    """Return the (n, I) at which rules are compared: few matches, an easy, a usual, a hard one.

    Parameters
    ----------
    sample_size : int
        k.
    """
    return (20, sample_size + 3), (100, 60), (200, 50), (100, 20)


# More trials than anybody waits for.
_ENDLESS = 2**62


def at_defaults(
    declared: dict[str, Any],
    law: StoppingLaw | None,
    sampler: SamplerLaw,
    problems: Sequence[tuple[int, int, float | None]],
    checked: bool | None,
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

    Returns
    -------
    AtDefaults
    """
    rows = []
    for n, n_inliers, confidence in problems:
        if law is None or n_inliers < sampler.sample_size:
            continue
        s = declared["confidence"] if confidence is None else confidence
        rows.append(_guarantee(n, n_inliers, s, declared, law, sampler))
    return AtDefaults(
        confidence=declared["confidence"],
        min_trials=declared["min_trials"],
        max_trials=declared["max_trials"],
        multiplier=declared["multiplier"],
        checked=checked,
        guarantees=tuple(rows),
    )


def rule_trials(law: StoppingLaw, n_inliers: int, n: int, confidence: float) -> int:
    """Trials that a law lets happen, with whatever multiplier it was measured with."""
    probability = law_probability(law, n_inliers, n)
    if probability >= 1 or confidence <= 0:
        return 1
    if probability <= 0 or confidence >= 1:
        return _ENDLESS
    x = law.multiplier * math.log1p(-confidence) / math.log1p(-probability)
    return min(_ENDLESS, max(1, math.floor(x + law.phi[0])))


def _guarantee(
    n: int,
    n_inliers: int,
    confidence: float,
    declared: dict[str, Any],
    law: StoppingLaw,
    sampler: SamplerLaw,
) -> Guarantee:
    trials = rule_trials(law, n_inliers, n, confidence)
    if trials < _ENDLESS:
        trials = math.ceil(trials * declared["multiplier"])
    binds: Binding = "rule"
    if trials < declared["min_trials"]:
        trials, binds = declared["min_trials"], "minimum"
    if declared["max_trials"] is not None and trials > declared["max_trials"]:
        trials, binds = declared["max_trials"], "maximum"
    sampling = "replacement" if sampler.drawn == "replacement" else "distinct"
    k = sampler.sample_size
    exact = required_trials(n_inliers, n, k, confidence, sampling=sampling)  # type: ignore[arg-type]
    probability = success_probability(trials, n_inliers, n, k, sampling=sampling)  # type: ignore[arg-type]
    return Guarantee(
        n=n,
        n_inliers=n_inliers,
        sample_size=k,
        confidence=confidence,
        trials=trials,
        exact_trials=None if math.isinf(exact) else int(exact),
        binds=binds,
        probability=probability,
    )
