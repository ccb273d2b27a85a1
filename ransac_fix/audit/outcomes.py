"""The stopping law of a function whose runs cannot be repeated, from what many of them return.

Every law gives each outcome a chance (`outcome_laws`), up to the share f of the samples in a group
from which the function finds it, and up to its rounding. f is measured beside it, by runs that
only their budget ends (`outcome_evidence`).

The test is sequential. Law i is preferred to law j once the likelihood of everything seen,
averaged over f and the rounding under law i, exceeds its maximum over both under law j by a
factor of 10^6. Where j is true, whatever f and the rounding are, that factor is a martingale with
mean at most 1 (the maximum is at least the likelihood at the true f), so it ever exceeds 10^6
with probability below 10^-6 (Ville's inequality; Wald's for the likelihood ratio), however the
problems are chosen and whenever one stops. All laws known are rejected together in the same way,
by a law in which every confidence and problem has a chance of its own.

Runs that return neither are set aside: chances are conditional on A or B.
"""

import math
import time
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ransac_fix.audit.asking import Asked
from ransac_fix.audit.direction import direction
from ransac_fix.audit.laws import Candidate, Fit
from ransac_fix.audit.model import (
    Defect,
    LikelihoodRatio,
    OutcomeCount,
    OutcomeEvidence,
    SamplerLaw,
)
from ransac_fix.audit.outcome_evidence import Counts, Evidence
from ransac_fix.audit.outcome_laws import (
    PHI,
    Array,
    Hypothesis,
    Problem,
    chance_of_smaller,
    hypotheses,
    problems,
    rounded,
    trials_of,
)
from ransac_fix.audit.sampling import ERROR_RATE
from ransac_fix.audit.worker.streams import (
    LARGEST_CONFIDENCE,
    SMALLEST_CONFIDENCE,
    confidence_of,
)

_DECIDED = -math.log(ERROR_RATE)
_U: Array = np.array([0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0])
# Runs asked for at once, at least and as a share of those made, and in all.
_BATCH = 24
_BATCH_SHARE = 20
_MOST_RUNS = 12_000
_MOST_SECONDS = 45.0
_ENOUGH_RUNS = 1_000
_AGAIN = 1.5
# Trials that take as long as starting a run does.
_START = 400
# What a problem that was not run before must make good, in nats.
_NEW = 4.0
# Information, in nats a run, below which two laws cannot be told apart.
_NO_INFORMATION = 0.012
_FEWEST_TRIALS = 6
# Runs at the highest confidence, and how many of them may miss the larger model; each misses it
# once in 2000 times within the budget.
_LIMIT_RUNS, _LIMIT_MISSES = 200, 3
# Nats by which a law must be likelier than chances that follow none, to be named.
_LIKELIER = math.log(100)


def _information(p: Array, q: Array) -> Array:
    """Nats that a run says for chance p, shape (...), against q, (..., phi), at its best."""
    p = p[..., None]
    each = p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q))
    return np.asarray(each.min(axis=-1))


class _Planner:
    """Chooses the problem and the confidence that tell laws apart at least cost.

    Parameters
    ----------
    choices : sequence of Problem
        The problems there are.
    sample_size : int
        Inliers of a model that is no more than its sample.
    """

    def __init__(self, choices: Sequence[Problem], sample_size: int) -> None:
        self._choices = choices
        self._sample_size = sample_size
        self._rates: dict[tuple[Hypothesis, Hypothesis], Array] = {}

    def _rate(self, law: Hypothesis, rival: Hypothesis) -> Array:
        """Return nats for each trial's worth of time, by problem and u; 0 where too few a run."""
        key = law, rival
        if key not in self._rates:
            self._rates[key] = np.stack(
                [self._rate_on(problem, law, rival) for problem in self._choices]
            )
        return self._rates[key]

    def _rate_on(self, problem: Problem, law: Hypothesis, rival: Hypothesis) -> Array:
        chances, fewest, length = [], np.full(len(_U), math.inf), np.zeros(len(_U))
        shortest = np.full(len(_U), math.inf)
        for one in (law, rival):
            in_hand, without = trials_of(one, problem, self._sample_size, _U)
            p = chance_of_smaller(
                problem, rounded(in_hand), rounded(without), np.array([1.0]), one.tested
            )
            chances.append(p[:, 0, :])
            fewest, shortest = np.minimum(fewest, without), np.minimum(shortest, in_hand)
            length = np.maximum(length, np.minimum(in_hand, problem.budget))
        # Runs that return neither say nothing.
        seen = -np.expm1(-np.minimum(fewest, 1e9) * (problem.smaller + problem.larger))
        information = seen * _information(chances[0][:, len(PHI) // 2], chances[1])
        information[information < _NO_INFORMATION] = 0.0
        # Rounding hides the laws of runs of a few trials.
        information[shortest < _FEWEST_TRIALS] = 0.0
        return np.asarray(information / (length + problem.fixed + 2 * _START))

    def best(
        self, law: Hypothesis, rivals: Sequence[tuple[Hypothesis, float]], known: Container[Problem]
    ) -> tuple[Problem, float] | None:
        """Return the problem and the u of the confidence to run next: for the rival next to fall.

        Parameters
        ----------
        law : Hypothesis
            The likeliest law.
        rivals : sequence of (Hypothesis, float)
            Other laws, and how many nats are wanted against each.
        known : container of Problem
            Those that were run before.

        Returns
        -------
        (Problem, float) or None
            None where no runs can tell the rivals from the law.
        """
        # The share found is not known on a new problem, which takes a few nats.
        extra = np.array([0.0 if problem in known else _NEW for problem in self._choices])
        least, chosen = math.inf, None
        for rival, wanted in rivals:
            rate = self._rate(law, rival)
            if rate.max() > 0:
                cost = (wanted + extra[:, None]) / np.maximum(rate, 1e-300)
                if cost.min() < least:
                    at = np.unravel_index(int(cost.argmin()), cost.shape)
                    least, chosen = float(cost.min()), (self._choices[int(at[0])], float(_U[at[1]]))
        return chosen


@dataclass(frozen=True, slots=True)
class Decision:
    """What the outcomes say.

    Parameters
    ----------
    fit : Fit
        The law and, as its rivals, those that these runs cannot tell from it; no law where all
        are rejected, or where some are no laws but defects.
    evidence : OutcomeEvidence
        The counts and the likelihood ratios.
    defect : str or None
        A defect named in place of a law.
    runs : int
        Library runs spent.
    """

    fit: Fit
    evidence: OutcomeEvidence
    defect: Defect | None
    runs: int


def decide(
    host: Asked,
    one: dict[str, Any],
    sampler: SamplerLaw,
    seed: int,
    clock: Callable[[], float] = time.monotonic,
    *,
    verdict_only: bool = False,
) -> Decision:
    """Find the stopping law by runs whose outcomes alone can be seen.

    Parameters
    ----------
    host : Asked
        Runs the library.
    one : dict
        The entry point as described by the worker.
    sampler : SamplerLaw
        How it draws its samples.
    seed : int
        Fixes the planted problems.
    clock : callable, optional
        Seconds, for the limit on time.
    verdict_only : bool, default False
        End once all laws left mean the same verdict and are 10^6 times as likely as none, without
        telling them apart.

    Returns
    -------
    Decision
    """
    started = clock()
    laws = hypotheses(one["sample_size"], sampler.drawn)
    evidence = Evidence(laws, sampler.sample_size, budget=one["budget"])
    choices = problems(sampler, one["typical_trials"], one["spare"], one["fewest_samples"])
    planner = _Planner(choices, sampler.sample_size)
    runs, best, settled = 0, 0, math.inf
    verdicts = [_verdict(law, sampler) for law in laws]
    # The first runs tell the exact law from the approximate one.
    wanted = [(laws[1], _DECIDED)]
    # Once all laws left mean the same verdict, half as many runs again, and some at any rate, go
    # into telling them apart.
    while (
        runs < min(_MOST_RUNS, max(_ENOUGH_RUNS, _AGAIN * settled))
        and clock() - started < _MOST_SECONDS
    ):
        chosen = planner.best(laws[best], wanted, evidence.calibrations)
        if chosen is None and runs:
            # None of them can be told from the likeliest, but perhaps from each other.
            pairs = combinations(wanted, 2)
            each = (
                planner.best(a, [(b, more)], evidence.calibrations) for (a, _), (b, more) in pairs
            )
            chosen = next((one for one in each if one is not None), None)
        if chosen is None and runs:
            break
        chosen = chosen or (choices[0], 1.0)
        runs += _ask(host, one["name"], evidence, *chosen, seed + runs)
        mean, most, free = evidence.likelihoods()
        best = int(most.argmax())
        missing = _DECIDED - (mean[best] - most)
        missing[best] = 0.0
        alive = np.flatnonzero(missing > 0)
        # Until then it is the others that must fall.
        others = [index for index in alive if verdicts[index] != verdicts[best]]
        unlawful = free - most[best] > -_LIKELIER
        # That a confidence has no effect is said only once no law is left.
        early = bool(others) or unlawful or laws[best].defect is not None
        settled = math.inf if early else min(settled, runs)
        # Further runs also show a rule that is none of the laws, but close to one: to go without
        # them takes as much against that as against another law.
        told = not len(alive) or (verdict_only and not early)
        if free - most[best] > _DECIDED or (told and most[best] - free > _DECIDED):
            break
        wanted = [(laws[index], float(missing[index])) for index in others or alive]
        # Where one is left that explains it no better than none does, all others are of use.
        wanted = wanted or [(law, _DECIDED) for law in laws if law is not laws[best]]
    return _decision(evidence, runs)


def is_limited(
    host: Asked, one: dict[str, Any], sampler: SamplerLaw, seed: int
) -> tuple[bool, int]:
    """Whether a function that takes no number of trials has a limit that ends runs here.

    Parameters
    ----------
    host, one, sampler, seed
        As in `decide`.

    Returns
    -------
    tuple of (bool, int)
        And the runs made.
    """
    choices = problems(sampler, one["typical_trials"], one["spare"], one["fewest_samples"])
    longest = max(choices, key=lambda problem: problem.budget)
    shape = [longest.n, longest.group_size, longest.n_groups, longest.budget]
    case = [*shape, LARGEST_CONFIDENCE, _LIMIT_RUNS]
    answer = host.ask("outcomes", entry_point=one["name"], cases=[case], seed=seed)
    ((larger, _, _),) = answer["counts"]
    return _LIMIT_RUNS - larger > _LIMIT_MISSES, answer["runs"]


def _verdict(one: Hypothesis, sampler: SamplerLaw) -> tuple[object, ...]:
    """Return what the verdict, and the words for it, depend on."""
    law = one.law
    return (one.defect,) if law is None else (direction(law, sampler), law.tested)


def _ask(host: Asked, name: str, evidence: Evidence, problem: Problem, u: float, seed: int) -> int:
    """Have a batch run, with as many runs of a fixed budget where they are due."""
    calibration, cell = evidence.calibration(problem), evidence.cell(problem, u)
    batch = max(_BATCH, evidence.runs() // _BATCH_SHARE)
    wanted = batch + sum(other.runs for other in evidence.cells[problem].values())
    # Where the share found is the same in all problems, all of these runs measure it.
    share = 0.5 if evidence.alike() else 1.0
    limit, highest = problem.fixed, LARGEST_CONFIDENCE
    if not evidence.budget:
        # Runs of one trial seldom find a group, and take no time.
        share, limit, highest = 4 * share, 1, SMALLEST_CONFIDENCE
    due = max(0, round(share * wanted) - calibration.runs)
    shape = [problem.n, problem.group_size, problem.n_groups]
    answer = host.ask(
        "outcomes",
        entry_point=name,
        cases=[
            [*shape, problem.budget, confidence_of(u), batch],
            [*shape, limit, highest, due],
        ],
        seed=seed,
    )
    for counts, (larger, smaller, neither) in zip(
        (cell, calibration), answer["counts"], strict=True
    ):
        counts.larger += larger
        counts.smaller += smaller
        counts.neither += neither
    return int(answer["runs"])


def _decision(evidence: Evidence, runs: int) -> Decision:
    mean, most, free = evidence.likelihoods()
    best = int(most.argmax())
    ahead = mean[best] - most
    ahead[best] = math.inf
    rejected = bool(free - most[best] > -_LIKELIER)
    standing = [best, *np.flatnonzero(ahead < _DECIDED).tolist()]
    laws = [] if rejected else [evidence.laws[index] for index in sorted(standing)]
    # Of laws that such runs cannot tell apart the likelier beforehand stands for all.
    fit, defect, factor = Fit(None), None, None
    reported = [one.law for one in laws if one.law is not None]
    defects = {one.defect for one in laws if one.defect is not None}
    if reported and not defects:
        fit = Fit(reported[0], tuple(reported[1:]))
        factor = evidence.factor(laws[0])
    elif len(defects) == 1 and not reported:
        (defect,) = defects
    elif laws:
        fit = Fit(None, tuple(reported))
    named = _named(evidence)
    order = np.argsort(ahead, kind="stable")[:-1].tolist()
    shown = [i for at, i in enumerate(order) if at < 3 or evidence.laws[i] in named]
    found = OutcomeEvidence(
        runs=runs,
        error_rate=ERROR_RATE,
        counts=tuple(_counts(evidence, laws[0] if fit.law is not None else None)),
        likeliest=evidence.laws[best].formula,
        ratios=tuple(
            LikelihoodRatio(evidence.laws[index].formula, round(float(ahead[index]), 1))
            for index in shown
        ),
        factor=factor,
        no_law=round(float(free - most[best]), 1),
    )
    return Decision(fit, found, defect, runs)


def _named(evidence: Evidence) -> tuple[Hypothesis, Hypothesis]:
    """Return the laws that every report names: the approximate and the exact one."""
    k = evidence.sample_size
    return Hypothesis(Candidate("approximate", k)), Hypothesis(Candidate("distinct", k))


def _counts(evidence: Evidence, law: Hypothesis | None) -> Iterator[OutcomeCount]:
    found = np.array([evidence.found()])
    usual, exact = _named(evidence)

    def share(one: Hypothesis, problem: Problem, u: float) -> float:
        return round(float(evidence.chances(one, problem, u, found)[0, 1]), 4)

    def count(problem: Problem, u: float | None, counts: Counts) -> OutcomeCount:
        limit = problem.fixed if evidence.budget else 1
        fixed = np.array([float(limit)])
        return OutcomeCount(
            n=problem.n,
            n_inliers=problem.group_size,
            n_groups=problem.n_groups,
            confidence=None if u is None else confidence_of(u),
            max_trials=limit if u is None else problem.budget,
            smaller=counts.smaller,
            larger=counts.larger,
            neither=counts.neither,
            approximate=None if u is None else share(usual, problem, u),
            exact=None if u is None else share(exact, problem, u),
            expected=round(
                float(chance_of_smaller(problem, fixed, fixed, found, "every trial")[0, 0]), 4
            )
            if u is None
            else (None if law is None else share(law, problem, u)),
        )

    for problem, calibration in evidence.calibrations.items():
        for u, cell in evidence.cells[problem].items():
            yield count(problem, u, cell)
        yield count(problem, None, calibration)
