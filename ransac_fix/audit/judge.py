"""From laws to a verdict: whether the probability assumed is the probability drawn."""

import math
from collections.abc import Sequence

from ransac_fix.audit.defaults import rule_trials, standard_problems
from ransac_fix.audit.direction import direction, strata_of
from ransac_fix.audit.drawing import spread
from ransac_fix.audit.laws import Fit, assumption
from ransac_fix.audit.measure import Measurement
from ransac_fix.audit.model import (
    DEFECTS,
    AtDefaults,
    Defect,
    Judgement,
    OutcomeEvidence,
    Point,
    SamplerLaw,
    StoppingLaw,
)
from ransac_fix.audit.sampling import drawing_of

# Defects that assume P = 1, as it were.
_ENDS_AT_ONCE: tuple[Defect, ...] = ("first model", "first consensus")


def judge(measured: Measurement) -> tuple[Judgement, str]:
    """Return the verdict on one entry point and its reason.

    Parameters
    ----------
    measured : Measurement
        The evidence.
    """
    if measured.unmeasured:
        return "not measured", measured.unmeasured
    defects = "; ".join(f"it {DEFECTS[defect]}" for defect in measured.defects)
    if defects and measured.fit.law is None:
        if any(defect in _ENDS_AT_ONCE for defect in measured.defects):
            return "undersamples", f"{defects}{_at_once(measured.sampler)}"
        return "other rule", defects
    if measured.outcomes is not None:
        return _judge_outcomes(measured.fit, measured.sampler, measured.outcomes)
    if not measured.points:
        seen = "; ".join(f"{why} ({times} streams)" for why, times in measured.discarded.items())
        also = (
            "; samples are not drawn uniformly" if measured.sampler.drawn == "not uniform" else ""
        )
        return "not measured", f"no stream showed the rule: {seen}{also}"
    verdict, reason = _judge_laws(measured.fit, measured.sampler, measured.points)
    accepted = measured.sampler.accepted
    if accepted is not None and accepted[1] < 1:
        reason = (
            f"{reason}; a filter lets {accepted[0]:.0%} to {accepted[1]:.0%} of the samples of "
            "scattered matches pass, and draws again for the others without counting a trial"
        )
    if defects:
        reason = f"{reason}; {defects}"
        verdict = "other rule" if verdict == "exact" else verdict
    return verdict, reason


def _judge_outcomes(
    found: Fit, sampler: SamplerLaw, seen: OutcomeEvidence
) -> tuple[Judgement, str]:
    """Judge what many runs returned: one law, or several that they cannot tell apart."""
    if found.law is None and found.rivals:
        laws = " and ".join(rival.formula for rival in found.rivals[:3])
        return "not measured", (
            f"undecided after {seen.runs:,} runs: {laws}, or a rule in which the confidence has no "
            "effect, may be true"
        )
    if found.law is None:
        if sampler.drawn == "undecided":
            return _judge_laws(found, sampler, ())
        if seen.no_law <= -math.log(seen.error_rate):
            return "not measured", (
                f"undecided after {seen.runs:,} runs: {seen.likeliest} is the likeliest law, but "
                "not a hundred times as likely as none"
            )
        return "other rule", (
            f"no known law explains what {seen.runs:,} runs returned; the likeliest is "
            f"{seen.likeliest}"
        )
    verdict, reason = _judge_laws(Fit(found.law), sampler, ())
    for rival in found.rivals:
        other, _ = _judge_laws(Fit(rival), sampler, ())
        if other != verdict:
            return "not measured", (
                f"undecided after {seen.runs:,} runs: {found.law.formula} and {rival.formula} "
                "may both be true"
            )
    if found.rivals:
        laws = " or ".join(_beside(rival, found.law) for rival in found.rivals[:3])
        reason += f"; or it assumes {laws}, which {seen.runs:,} runs did not tell from that"
    return verdict, reason


def _beside(rival: StoppingLaw, law: StoppingLaw) -> str:
    """Name a law that stands beside another, by what is different."""
    if rival.multiplier == law.multiplier:
        return assumption(rival)
    return f"{assumption(rival)} with a factor of {rival.multiplier:g} on its trials"


def _judge_laws(found: Fit, sampler: SamplerLaw, points: Sequence[Point]) -> tuple[Judgement, str]:
    """Compare the law of the rule with the law of the sampler."""
    if sampler.drawn == "undecided":
        return "not measured", (
            f"the sampler could not be told from {sampler.runs} runs "
            f"({sampler.hits} hits, {sampler.expected:g} expected)"
        )
    law = found.law
    if law is None:
        if found.rivals:
            laws = " and ".join(rival.formula for rival in found.rivals[:3])
            return "not measured", f"several laws fit the points: {laws}"
        implied = ""
        if found.implied_probability is not None:
            first = points[0]
            implied = (
                f"; for {first.n_inliers} of {first.n} they imply "
                f"P = {found.implied_probability:.4g}"
            )
        odd = f"; {_odd(sampler)}" if sampler.drawn == "not uniform" else ""
        return "other rule", f"no known law passes through the points{implied}{odd}"
    if sampler.drawn == "not uniform":
        return "other rule", f"assumes P = {assumption(law)}, but {_odd(sampler)}"
    way = direction(law, sampler, points)
    drawn = drawing_of(sampler).describe()
    if way == 0:
        reason = f"assumes P = {assumption(law)}, and draws {drawn}"
        verdict: Judgement = "exact"
    elif way is None:
        reason = (
            f"assumes P = {assumption(law)}, but draws {drawn}: now too few trials, now too many"
        )
        if strata_of(points) > 1:
            reason += (
                ", as the inliers fall into the strata: for instance "
                f"{_consequence(law, sampler, points)}"
            )
        verdict = "other rule"
    else:
        verdict = "undersamples" if way > 0 else "oversamples"
        consequence = _consequence(law, sampler, points)
        reason = f"assumes P = {assumption(law)}, but draws {drawn}: {consequence}"
    if law.inlier_offset == 1 and law.assumed == sampler.drawn:
        reason += (
            f" (for sets of {law.inlier_offset} more it is exact: with I in hand only a larger set "
            "is of interest)"
        )
    if law.tested == "on improvement":
        reason += "; it consults the rule only when the model in hand improves"
        if verdict == "exact":
            verdict = "oversamples"
    return verdict, reason


def _odd(sampler: SamplerLaw) -> str:
    """Say that no law known of a sampler fits."""
    return f"samples are not drawn uniformly: {sampler.strayed}"


def advise(
    verdict: Judgement, at_defaults: AtDefaults | None, max_trials_name: str, fixed_in: str | None
) -> str:
    """Return what a user can do, or an empty string.

    Parameters
    ----------
    verdict : str
        The verdict.
    at_defaults : AtDefaults or None
        What binds.
    max_trials_name : str
        How the library spells its cap; empty where it cannot be set.
    fixed_in : str or None
        First newer release that does not undersample.
    """
    parts = []
    if verdict == "undersamples" and fixed_in:
        parts.append(f"Fixed in {fixed_in}: upgrade.")
    if at_defaults is not None:
        parts += _limits(at_defaults, max_trials_name)
    return " ".join(parts)


def _limits(at_defaults: AtDefaults, max_trials_name: str) -> list[str]:
    """Say where a default cap or floor matters more than the rule."""
    parts = []
    capped = [row for row in at_defaults.guarantees if row.binds == "maximum"]
    short = [
        row for row in capped if row.exact_trials is not None and row.exact_trials > row.trials
    ]
    if at_defaults.confidence >= 1 and capped:
        parts.append(
            f"With the default confidence of 1 the rule never ends a run, the cap of "
            f"{at_defaults.max_trials:,} trials does: choose {max_trials_name} for your data."
        )
    elif short:
        worst = max(short, key=lambda row: row.exact_trials or 0)
        needed = f"{max_trials_name}={worst.exact_trials}"
        if not max_trials_name:
            needed = f"{worst.exact_trials:,}, and it cannot be set,"
        parts.append(
            f"The default cap of {at_defaults.max_trials:,} trials matters more than the rule on "
            f"hard problems: {worst.n_inliers} of {worst.n} need {needed} for "
            f"s={worst.confidence:g}."
        )
    if any(row.binds == "minimum" for row in at_defaults.guarantees):
        parts.append(
            f"On easy problems the default minimum of {at_defaults.min_trials:,} trials matters "
            "more than the rule."
        )
    return parts


def _at_once(sampler: SamplerLaw) -> str:
    """Say what it means to end with a model in hand on the first standard problem."""
    if sampler.drawn not in ("distinct", "replacement"):
        return ""
    n, n_inliers = standard_problems(sampler.sample_size)[0]
    needed = drawing_of(sampler).required_trials(((n_inliers, n),), 0.99)
    return f": with {n_inliers} of {n} in hand it stops at once, and s=0.99 needs {needed} trials"


def _consequence(law: StoppingLaw, sampler: SamplerLaw, points: Sequence[Point]) -> str:
    """Say what the difference comes to on the first standard problem."""
    n, n_inliers = standard_problems(sampler.sample_size)[0]
    confidence = 0.99
    n_strata = strata_of(points)
    strata = spread(n_inliers, n, n_strata)
    drawing = drawing_of(sampler)
    trials = rule_trials(law, strata, confidence)
    needed = drawing.required_trials(strata, confidence)
    guarantee = drawing.success_probability(trials, strata)
    where = "" if n_strata == 1 else f", spread evenly over {n_strata} strata,"
    return (
        f"with {n_inliers} of {n}{where} in hand and s={confidence:g} it stops after {trials} "
        f"trials, {needed} are needed, and another set of {n_inliers} is missed "
        f"with probability {1 - guarantee:.2g}"
    )
