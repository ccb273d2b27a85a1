"""Wrapped functions: whether the library's own trials and the missing ones make the exact number.

A patched compiled library keeps its rule, and draws the missing trials afterwards on fresh samples,
so that no point of a rule lies on one random stream. Two things are tested.

Trials: what each run came to, counted where the missing trials are drawn, is the number that the
sampler needs at the inliers in hand, or the limit, or what the first run had done by itself.

Outcomes: each run meets a planted problem with smaller groups and a larger one. With N trials after
which a run ends once a smaller group is in hand, and L without any, and chances a and b that one
trial finds one of the smaller or the larger, it returns a smaller one with chance

    (1-b)^N - (1-a-b)^N + ((1-a-b)^N - (1-a-b)^L) a/(a+b).

Wald's sequential test decides between N as the library has it by itself and the exact N; a and b
are those of the sampler, or of runs with a fixed number of trials. The same function without its
missing trials is tested beside it, and must come out on the other side: a test that cannot tell
says nothing. A library that does not say what it ran may have run more than its rule asks for, and
gets as many again: its outcomes lie beyond those of the exact number, never short of them.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from ransac_fix.audit import plan
from ransac_fix.audit.asking import Asked
from ransac_fix.audit.measure import settings_for
from ransac_fix.audit.model import (
    Extension,
    Judgement,
    OutcomeTest,
    SamplerLaw,
    TrialCount,
)
from ransac_fix.audit.sampling import ERROR_RATE
from ransac_fix.audit.worker.streams import LARGEST_CONFIDENCE, confidence_of
from ransac_fix.criterion import (
    all_inlier_probability,
    approximate_required_trials,
    required_trials,
)

__all__ = ["count_trials", "decide_by_outcomes", "judge_extension"]

_U = (0.3, 0.7, 1.5)
_RUNS = 6
_BUDGET = 100_000
_SHOWN = 12
_BATCH = 25
# Runs with a fixed number of trials, to see how often one finds a group.
_CALIBRATING = 150
_MOST_RUNS = 3_000
# For what is not decided; what is takes a part of it, on a busy machine too.
_MOST_SECONDS = 60.0
_DECIDED = -math.log(ERROR_RATE)
# Nats that a run must say for the exact number against the library's own.
_TELLING = 4e-3
# Nothing is quite impossible: local optimisation and chance agreement disturb a run now and then.
_SURPRISE = 0.01


def count_trials(
    host: Asked, one: dict[str, Any], sampler: SamplerLaw, seed: int
) -> tuple[list[TrialCount], int]:
    """Count the trials of a wrapped function on planted problems.

    Parameters
    ----------
    host : Asked
        Runs the library.
    one : dict
        The entry point as described by the worker.
    sampler : SamplerLaw
        How samples are drawn.
    seed : int
        Fixes the planted problems.

    Returns
    -------
    tuple of (list of TrialCount, int)
        One for each run; none where calls are passed through. And how many runs there were.
    """
    return _counted(host, one, sampler, seed, exact=True)


def _counted(
    host: Asked, one: dict[str, Any], sampler: SamplerLaw, seed: int, *, exact: bool
) -> tuple[list[TrialCount], int]:
    cases = [
        _case(setting, u, _RUNS)
        for setting in settings_for(one, sampler, counted=False)
        for u in _U
    ]
    answer = _ask(host, one, cases, seed, exact=exact)
    return [TrialCount(**count) for count in answer["counts"]], answer["runs"]


def decide_by_outcomes(
    host: Asked,
    one: dict[str, Any],
    sampler: SamplerLaw,
    seed: int,
) -> tuple[OutcomeTest | None, int]:
    """Decide by outcomes between the library's own number of trials and the exact one.

    Parameters
    ----------
    host, one, sampler, seed
        As in `count_trials`.

    Returns
    -------
    tuple of (OutcomeTest or None, int)
        None where the two numbers are too near each other to be told apart so. And the runs.
    """
    # What the library asks for when nothing more is asked of it.
    own, runs = _counted(host, one, sampler, seed, exact=False)
    duels = list(_duels(sampler, own, one))
    found: OutcomeTest | None = None
    # With the share found that the sampler showed, and where that is not clear with that of runs
    # on these very problems.
    for calibrated in (False, True):
        if calibrated:
            duels, more = _calibrated(host, one, duels, seed + 20_000)
            runs += more
        elif one["verifying"]:
            continue
        chosen = max(duels, key=lambda duel: duel.information, default=None)
        if chosen is None or chosen.information < _TELLING:
            return None, runs
        alone, more = _sequential(host, one, chosen, seed + 50_000, exact=False)
        wrapped, again = _sequential(host, one, chosen, seed, exact=True)
        runs += more + again
        found = OutcomeTest(
            n_samples=chosen.setting.n,
            n_inliers=chosen.setting.group_size,
            sample_size=sampler.sample_size,
            confidence=confidence_of(chosen.u),
            own=chosen.own[0],
            exact=chosen.exact[0],
            chance_own=round(1 - chosen.smaller_own, 4),
            chance_exact=round(1 - chosen.smaller_exact, 4),
            larger=wrapped.larger,
            smaller=wrapped.smaller,
            log_ratio=round(wrapped.log_ratio, 1),
            larger_alone=alone.larger,
            smaller_alone=alone.smaller,
            log_ratio_alone=round(alone.log_ratio, 1),
        )
        if found.log_ratio > _DECIDED and found.log_ratio_alone < -_DECIDED:
            break
    return found, runs


def judge_extension(
    counts: list[TrialCount], sampler: SamplerLaw, outcomes: OutcomeTest | None, *, counted: bool
) -> tuple[Judgement, str, Extension]:
    """Return the verdict on a wrapped function, its reason and the evidence.

    Parameters
    ----------
    counts : list of TrialCount
        From `count_trials`.
    sampler : SamplerLaw
        How samples are drawn.
    outcomes : OutcomeTest or None
        From `decide_by_outcomes`.
    counted : bool
        The library says itself how many trials it ran.
    """
    kept = sum(map(keeps, counts))
    extended = sum(count.trials != count.own for count in counts)
    # The wrong ones first, then those that show most: the same model in hand, and trials missing.
    shown: dict[tuple[int, int, float], TrialCount] = {}
    for count in sorted(counts, key=_interest):
        shown.setdefault((count.n_samples, count.n_inliers, count.confidence), count)
    evidence = Extension(
        len(counts),
        extended,
        kept,
        counted,
        tuple(shown.values())[:_SHOWN],
        outcomes,
    )
    verdict, reason = _judge(counts, evidence, sampler)
    return verdict, reason, evidence


def _judge(
    counts: list[TrialCount], evidence: Extension, sampler: SamplerLaw
) -> tuple[Judgement, str]:
    """Judge the trials first, and where these are right the outcomes."""
    other = next((count for count in counts if not _follows(count, sampler)), None)
    if other is not None:
        return "other rule", (
            f"draws {sampler.sample_size} measurements ({sampler.drawn}), for which"
            f" {other.required} trials are not the number with {other.n_inliers} of"
            f" {other.n_samples} in hand"
        )
    if evidence.kept < len(counts):
        wrong = evidence.counts[0]
        return "other rule", (
            f"{len(counts) - evidence.kept} of {len(counts)} runs did not come to the exact number:"
            f" with {wrong.n_inliers} of {wrong.n_samples} in hand and s={wrong.confidence:.4g} one"
            f" ran {wrong.trials} trials where {wrong.required} are needed"
        )
    sums = f"draws what its rule leaves out: all of {len(counts)} runs came to the exact number"
    beyond = sum(
        count.own is not None and count.required is not None and count.own > count.required
        for count in counts
    )
    if beyond:
        sums += f" ({beyond} ran more than that at once)"
    outcomes = evidence.outcomes
    if outcomes is None:
        apart = "its own number is too near the exact one for outcomes to tell them apart"
        if evidence.counted:
            return "exact", f"{sums}, by the library's own count; {apart}"
        return "not measured", f"{sums}, as far as its wrapper knows; {apart}"
    if outcomes.log_ratio_alone > -_DECIDED:
        return "not measured", (
            f"{sums}, but outcomes without these trials could not be told from the exact number's"
        )
    if outcomes.log_ratio < -_DECIDED:
        return "undersamples", (
            f"{sums} by its wrapper's count, but its outcomes are those of the own number"
        )
    if outcomes.log_ratio <= _DECIDED:
        return "not measured", f"{sums}, but its outcomes are undecided"
    return "exact", (
        f"{sums}, and its outcomes are not those of the own number (error {ERROR_RATE:g})"
    )


def keeps(count: TrialCount) -> bool:
    """Return whether a run came to the exact number, or to its limit.

    With the model of the first run still in hand at the end the number is exact, unless the
    library ran more by itself; a better one found meanwhile may have needed fewer.
    """
    if count.own is None or count.trials is None:
        return count.own == count.trials
    bounds = [bound for bound in (count.required, count.limit) if bound is not None]
    if not bounds:
        return True
    target = max(count.own, min(bounds))
    if count.n_inliers == count.first_inliers:
        return count.trials == target
    return count.trials >= target


def _interest(count: TrialCount) -> tuple[bool, bool, bool]:
    changed = count.n_inliers != count.first_inliers
    return keeps(count), changed, count.trials == count.own


def _follows(count: TrialCount, sampler: SamplerLaw) -> bool:
    """Return whether the required number is that of the sampler as it was measured."""
    if sampler.drawn not in ("distinct", "replacement"):
        return True  # by strata: the counts do not say how the inliers fall into them
    counts = count.n_inliers, count.n_samples, sampler.sample_size
    needed = required_trials(*counts, count.confidence, sampling=sampler.drawn)
    return count.required == (int(needed) if math.isfinite(needed) else None)


def _shape(setting: plan.Setting) -> list[Any]:
    return [setting.n, setting.group_size, setting.n_groups, setting.strata]


def _case(setting: plan.Setting, u: float, runs: int) -> list[Any]:
    return [*_shape(setting), _BUDGET, confidence_of(u), runs]


def _ask(
    host: Asked, one: dict[str, Any], cases: list[list[Any]], seed: int, *, exact: bool
) -> dict[str, Any]:
    return host.ask("extended", entry_point=one["name"], cases=cases, seed=seed, exact=exact)


@dataclass(frozen=True, slots=True)
class _Duel:
    """One problem and confidence, with what either number of trials makes of it.

    Parameters
    ----------
    setting : Setting
        The problem.
    u : float
        -ln(1 - s).
    a, b : float
        Chances that one trial finds a smaller group, and the larger one.
    own, exact : (int, float)
        Trials with a smaller group in hand, and with a minimal sample only.
    """

    setting: plan.Setting
    u: float
    a: float
    b: float
    own: tuple[int, float]
    exact: tuple[int, float]

    @property
    def smaller_own(self) -> float:
        """Chance that a run which returns a group returns a smaller one, by the own number."""
        return _chance_of_smaller(self.a, self.b, *self.own)

    @property
    def smaller_exact(self) -> float:
        """The same by the exact number."""
        return _chance_of_smaller(self.a, self.b, *self.exact)

    @property
    def information(self) -> float:
        """Nats a run says for the exact number, where that is true."""
        p, q = self.smaller_exact, self.smaller_own
        return p * math.log(p / q) + (1 - p) * math.log((1 - p) / (1 - q))


def _duels(sampler: SamplerLaw, counts: list[TrialCount], one: dict[str, Any]) -> Iterator[_Duel]:
    k, sampling = sampler.sample_size, sampler.drawn
    if sampling not in ("distinct", "replacement"):
        return
    # Some of a sample may only choose among the models that the others give.
    draws = k - one["verifying"]
    found = 1.0 if one["verifying"] else sampler.found
    for setting in settings_for(one, sampler, counted=False):
        size, n = setting.group_size, setting.n
        a, b = (
            min(groups * found * all_inlier_probability(inliers, n, draws, sampling=sampling), 0.49)
            for groups, inliers in ((setting.n_groups, size), (1, size + 1))
        )
        for u in _U:
            confidence = confidence_of(u)
            # A library that counts may have gone on before the smaller group was found.
            own = min(
                (
                    count.own
                    for count in counts
                    if (count.n_samples, count.first_inliers) == (n, size)
                    and math.isclose(count.confidence, confidence)
                    and count.own is not None
                ),
                default=None,
            )
            needed, most = (
                required_trials(inliers, n, k, confidence, sampling=sampling)
                for inliers in (size, k)
            )
            if own is None or own >= needed or needed == math.inf:
                continue
            without = approximate_required_trials(k, n, k, confidence)
            yield _Duel(setting, u, a, b, (own, without), (int(needed), most))


def _calibrated(
    host: Asked, one: dict[str, Any], duels: list[_Duel], seed: int
) -> tuple[list[_Duel], int]:
    """Return the duels with the chances that runs of a fixed number of trials show."""
    settings = {duel.setting: duel.b for duel in duels}
    trials = {setting: max(1, round(1.3 / b)) for setting, b in settings.items()}
    cases = [
        [*_shape(setting), trials[setting], LARGEST_CONFIDENCE, _CALIBRATING]
        for setting in settings
    ]
    answer = _ask(host, one, cases, seed, exact=False)
    found = {}
    for (setting, b), (_, larger) in zip(settings.items(), answer["returned"], strict=True):
        share = min(max(larger, 1), _CALIBRATING - 1) / _CALIBRATING
        found[setting] = -math.expm1(math.log1p(-share) / trials[setting]) / b
    return [
        replace(
            duel,
            a=min(duel.a * found[duel.setting], 0.49),
            b=min(duel.b * found[duel.setting], 0.49),
        )
        for duel in duels
    ], answer["runs"]


def _chance_of_smaller(a: float, b: float, in_hand: float, without: float) -> float:
    """Return the chance that a run which returns one of the groups returns a smaller one."""
    none, most = (1 - a - b) ** in_hand, (1 - a - b) ** min(without, _BUDGET)
    smaller = (1 - b) ** in_hand - none + max(none - most, 0.0) * a / (a + b)
    share = smaller / (1 - most) if most < 1 else a / (a + b)
    return min(max(share, _SURPRISE), 1 - _SURPRISE)


@dataclass(slots=True)
class _Score:
    smaller: int = 0
    larger: int = 0
    log_ratio: float = 0.0


def _sequential(
    host: Asked, one: dict[str, Any], duel: _Duel, seed: int, *, exact: bool
) -> tuple[_Score, int]:
    """Run until the likelihoods of the two numbers of trials are far enough apart."""
    score, runs, started = _Score(), 0, time.monotonic()
    for_smaller = math.log(duel.smaller_exact / duel.smaller_own)
    for_larger = math.log((1 - duel.smaller_exact) / (1 - duel.smaller_own))
    case = _case(duel.setting, duel.u, _BATCH)
    while (
        abs(score.log_ratio) <= _DECIDED
        and runs < _MOST_RUNS
        and time.monotonic() - started < _MOST_SECONDS
    ):
        answer = _ask(host, one, [case], seed + runs, exact=exact)
        ((smaller, larger),) = answer["returned"]
        score.smaller += smaller
        score.larger += larger
        score.log_ratio += smaller * for_smaller + larger * for_larger
        runs += answer["runs"]
    return score, runs
