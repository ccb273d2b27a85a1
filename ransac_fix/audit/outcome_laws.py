"""What a stopping law predicts of runs of which only the model returned is seen.

Each run meets a planted problem with some smaller groups (A) of m measurements and one larger (B)
of m + 1. A trial hits A with chance a and B with chance b. A rule that lets N trials happen with
an A in hand, and L with no more than the minimal sample, returns an A with chance

    (1-b)^N - (1-a-b)^N + ((1-a-b)^N - (1-a-b)^L) a/(a+b),

neither with chance (1-a-b)^L, and B else.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ransac_fix.audit.laws import Candidate, formula
from ransac_fix.audit.model import Defect, Drawn, SamplerLaw, StoppingLaw
from ransac_fix.criterion import all_inlier_probability

Array: TypeAlias = NDArray[np.float64]

# Shifts by rounding and off-by-ones; see StoppingLaw.
PHI: Array = np.array([0.0, 1.0, 2.0, 3.0])
_MULTIPLIERS = (3.0, 2.0, 1.5)
# Confidences that a rule with one of its own may have.
_FIXED = (0.99, 0.95)
# Expected trials until B, relative to the typical ones.
_LENGTHS = (0.25, 1.0, 3.0)
# A budget that the larger model outlasts once in so many runs.
_LAST = math.log(2000)
# No outcome is quite impossible.
_SURPRISE = 1e-3


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A law that may be true.

    Parameters
    ----------
    candidate : Candidate or None
        The probability assumed; None for a program without a rule.
    multiplier : float
        Factor on the number of trials.
    tested : str
        As in `StoppingLaw`.
    fixed : float or None
        The confidence of a rule that does not listen to its user's.
    """

    candidate: Candidate | None
    multiplier: float = 1.0
    tested: Literal["every trial", "on improvement"] = "every trial"
    fixed: float | None = None

    def x(self, n_inliers: int, n: int, u: float) -> float:
        """Trials asked for, before rounding."""
        if self.candidate is None:
            return math.inf
        probability = self.candidate.probability(n_inliers, n)
        if probability <= 0:
            return math.inf
        if probability >= 1:
            return 0.0
        if self.fixed is not None:
            u = -math.log1p(-self.fixed)
        return self.multiplier * u / -math.log1p(-probability)

    @property
    def formula(self) -> str:
        """The law in words, without its rounding."""
        if self.candidate is None:
            return "no rule"
        text = formula(self.candidate, self.multiplier, None)
        if self.fixed is not None:
            text = text.replace("1-s", f"1-{self.fixed:g}")
        return f"{text}, on improvement" if self.tested == "on improvement" else text

    @property
    def law(self) -> StoppingLaw | None:
        """The law as reported; None where there is none."""
        if self.candidate is None or self.fixed is not None:
            return None
        return StoppingLaw(
            assumed=self.candidate.assumed,
            sample_size=self.candidate.sample_size,
            inlier_offset=self.candidate.inlier_offset,
            multiplier=self.multiplier,
            phi=None,
            tested=self.tested,
            truncated=False,
            formula=formula(self.candidate, self.multiplier, None),
        )

    @property
    def defect(self) -> Defect | None:
        """What is wrong with a program that has no law."""
        return "confidence ignored" if self.candidate is None or self.fixed is not None else None


@lru_cache
def hypotheses(sample_size: int, drawn: Drawn) -> tuple[Hypothesis, ...]:
    """Return the laws that are tried, the likelier first.

    Parameters
    ----------
    sample_size : int
        k as documented; programs use others too.
    drawn : str
        How samples are drawn. Only a program that draws with replacement is taken to have
        thought of a rule for it.
    """
    k = sample_size
    exact, usual = Candidate("distinct", k), Candidate("approximate", k)
    others = [Candidate("distinct", k, 1), Candidate("distinct", k, -1)]
    others += [Candidate("distinct", k + 1), Candidate("approximate", k + 1)]
    if drawn == "replacement":
        others.append(Candidate("replacement", k))
    if k > 1:
        others.append(Candidate("approximate", k - 1))
    if k > 2:
        # With one measurement in a sample all are the same.
        others.append(Candidate("distinct", k - 1))
    # So they are for k = 1.
    main = (exact, usual) if k > 1 else (exact,)
    return (
        *(Hypothesis(one) for one in (*main, *others)),
        *(Hypothesis(one, factor) for factor in _MULTIPLIERS for one in main),
        *(Hypothesis(one, tested="on improvement") for one in (*main, others[0])),
        *(Hypothesis(one, fixed=fixed) for fixed in _FIXED for one in main),
        Hypothesis(None),
    )


@dataclass(frozen=True, slots=True)
class Problem:
    """One size of planted problem.

    Parameters
    ----------
    n, group_size, n_groups : int
        Measurements, size of an A group, and how many of these there are.
    smaller, larger : float
        Chance that one sample lies in an A group, and in B.
    budget : int
        Trials after which B was all but surely found.
    """

    n: int
    group_size: int
    n_groups: int
    smaller: float
    larger: float
    budget: int

    @property
    def fixed(self) -> int:
        """The budget whose outcomes say most about the share found."""
        return max(1, round(1.3 / self.larger))


def problems(sampler: SamplerLaw, typical_trials: float, spare: int, fewest: int) -> list[Problem]:
    """Return the problems that are small enough.

    Parameters
    ----------
    sampler : SamplerLaw
        How samples are drawn.
    typical_trials : float
        How long a run may be.
    spare, fewest : int
        As in `ransac_fix.audit.plan.settings`.
    """
    k = sampler.sample_size
    sampling: Literal["distinct", "replacement"] = (
        "replacement" if sampler.drawn == "replacement" else "distinct"
    )
    found = []
    for size in _spread(k + spare):
        least = max(fewest, 2 * size + 1)
        for share in _LENGTHS:
            n = min(
                range(least, 6 * size + least),
                key=lambda n: abs(
                    math.log(
                        share
                        * typical_trials
                        * all_inlier_probability(size + 1, n, k, sampling=sampling)
                    )
                ),
            )
            larger = all_inlier_probability(size + 1, n, k, sampling=sampling)
            n_groups = min(8, (n - size - 1) // size)
            smaller = n_groups * all_inlier_probability(size, n, k, sampling=sampling)
            problem = Problem(n, size, n_groups, smaller, larger, math.ceil(_LAST / larger))
            if problem not in found:
                found.append(problem)
    return found


def _spread(smallest: int) -> tuple[int, ...]:
    """Return sizes of groups: inlier ratios must differ to tell an exponent from a factor."""
    return smallest, smallest + 1, smallest + 2, smallest + 4, smallest + 8


def chance_of_smaller(
    problem: Problem, in_hand: Array, without: Array, found: Array, tested: str
) -> Array:
    """Return the chance that a run that returns A or B returns A.

    Parameters
    ----------
    problem : Problem
        The planted problem.
    in_hand, without : ndarray, shape (..., phi)
        Trials that the rule lets happen with an A in hand, and with a minimal sample only; at
        most ``problem.budget`` happen.
    found : ndarray, shape (found,)
        Share of samples in a group from which it is found.
    tested : str
        As in `StoppingLaw`.

    Returns
    -------
    ndarray, shape (..., found, phi)
    """
    a = np.minimum(problem.smaller * found, 0.49)[:, None]
    b = np.minimum(problem.larger * found, 0.49)[:, None]
    first = a / (a + b)
    log_none, log_no_b = np.log1p(-a - b), np.log1p(-b)
    budget = float(problem.budget)
    n = np.clip(in_hand, 1, budget)[..., None, :]
    if tested == "on improvement":
        # An A that comes at trial n or later ends the run; after an earlier one it goes on.
        late = np.exp((n - 1) * log_none) - np.exp(budget * log_none)
        early = (np.exp((n - 1) * log_no_b) - np.exp((n - 1) * log_none)) * np.exp(
            (budget - n + 1) * log_no_b
        )
        smaller = late * first + early
        neither = np.exp(budget * log_none)
    else:
        last = np.maximum(np.clip(without, 1, budget)[..., None, :], n)
        neither = np.exp(last * log_none)
        none = np.exp(n * log_none)
        smaller = np.exp(n * log_no_b) - none + (none - neither) * first
    return np.asarray(np.clip(smaller / (1 - neither), _SURPRISE, 1 - _SURPRISE))


def rounded(x: Array) -> Array:
    """Return the trials for each shift phi, shape (..., phi)."""
    return np.floor(x[..., None] + PHI)


def trials_of(law: Hypothesis, problem: Problem, sample_size: int, u: Array) -> tuple[Array, Array]:
    """Return the trials that a law asks for with an A in hand, and with a minimal sample only.

    Parameters
    ----------
    law : Hypothesis
        The law.
    problem : Problem
        The planted problem.
    sample_size : int
        Inliers of a model that is no more than its sample.
    u : ndarray
        -ln(1 - s).

    Returns
    -------
    tuple of ndarray, shape of `u`
        Before rounding.
    """
    in_hand, without = (law.x(size, problem.n, 1.0) for size in (problem.group_size, sample_size))
    # A rule with a confidence of its own has no use for u.
    scale = u if law.fixed is None else np.ones_like(u)
    return in_hand * scale, without * scale
