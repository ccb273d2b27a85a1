"""What the two stopping rules do on given numbers. Standard library only."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from ransac_fix.criterion import (
    Sampling,
    Stratum,
    all_inlier_probability,
    approximate_all_inlier_probability,
    approximate_required_trials,
    required_trials,
    success_probability,
    true_success_probability,
    undersampling,
)

Bound = Literal["rule", "minimum", "maximum"]

NEAR_AN_INTEGER = Fraction(1, 20)
"""How far ratio x n may lie from the number of inliers it stands for."""

# A default sweep has about this many rows.
_DEFAULT_ROWS = 16


@dataclass(frozen=True, slots=True)
class Problem:
    """The numbers a stopping rule is asked about.

    Parameters
    ----------
    n_samples, n_inliers, sample_size : int
        Measurements, inliers of the model in hand, measurements in a minimal sample.
    confidence : Fraction
        Wanted probability of at least one all-inlier sample, exactly as it was written.
    strata : tuple of Stratum, optional
        How a stratified sampler divides the three counts; empty when there is none.
    min_trials : int, default 0
        Trials that are run whatever the rule says.
    max_trials : int or None, default None
        Trials after which the run ends whatever the rule says; None for no such limit. Where
        the two contradict each other the maximum wins.
    """

    n_samples: int
    n_inliers: int
    sample_size: int
    confidence: Fraction
    strata: tuple[Stratum, ...] = ()
    min_trials: int = 0
    max_trials: int | None = None

    @property
    def has_limits(self) -> bool:
        """Whether a floor or a cap on the trials was given."""
        return self.min_trials > 0 or self.max_trials is not None


@dataclass(frozen=True, slots=True)
class LimitedRun:
    """What a rule's trials become under a floor and a cap, and what they then guarantee.

    Parameters
    ----------
    trials : int or None
        Trials run; None where the run would never end.
    bound_by : "rule", "minimum" or "maximum"
        What decided them.
    guarantee : float
        Probability that these trials hold at least one all-inlier sample.
    """

    trials: int | None
    bound_by: Bound
    guarantee: float


@dataclass(frozen=True, slots=True)
class LawOutcome:
    """Both rules seen under one sampling law.

    Parameters
    ----------
    sampling : str
        ``"distinct"``, ``"replacement"`` or ``"stratified"``.
    all_inlier_probability : float
        True chance that one sample holds inliers only.
    required_trials : int or None
        Trials the exact rule runs; None where no number of trials is enough.
    true_success : float
        s_true of the paper: the probability the approximate rule really reaches, with the
        real-valued number of trials it computes.
    success_of_approximate_trials : float
        The same with the whole number of trials it runs.
    undersampling : float or None
        (N_e - N_a) / N_a with real-valued trials, as in the paper; None where N_e is infinite.
    n_subsets, n_all_inlier_subsets : int
        Samples that exist as sets, and those of them that hold inliers only.
    enumeration_is_cheaper : bool
        Whether trying every subset once takes no more trials than the exact rule.
    approximate_within_limits, exact_within_limits : LimitedRun or None
        The two rules under the floor and the cap; None where neither was given.
    """

    sampling: str
    all_inlier_probability: float
    required_trials: int | None
    true_success: float
    success_of_approximate_trials: float
    undersampling: float | None
    n_subsets: int
    n_all_inlier_subsets: int
    enumeration_is_cheaper: bool
    approximate_within_limits: LimitedRun | None
    exact_within_limits: LimitedRun | None


@dataclass(frozen=True, slots=True)
class Explanation:
    """Everything `explain` has to say about one problem.

    Parameters
    ----------
    problem : Problem
        What was asked.
    approximate_probability : float
        p**k, the probability the approximate rule assumes.
    approximate_trials : int or None
        Trials the approximate rule runs; None where it never stops.
    laws : tuple of LawOutcome
        One entry for each sampling law: distinct, replacement, and stratified where strata
        were given.
    """

    problem: Problem
    approximate_probability: float
    approximate_trials: int | None
    laws: tuple[LawOutcome, ...]

    def law(self, sampling: str) -> LawOutcome:
        """Return the outcome under the sampling law of that name."""
        return next(law for law in self.laws if law.sampling == sampling)


def inliers_from_ratio(ratio: Fraction, n_samples: int) -> int:
    """Return the number of inliers that a ratio stands for.

    Parameters
    ----------
    ratio : Fraction
        Inliers divided by measurements, 0 to 1.
    n_samples : int
        Measurements.

    Raises
    ------
    ValueError
        When ``ratio * n_samples`` is more than `NEAR_AN_INTEGER` away from an integer.
    """
    product = ratio * n_samples
    n_inliers = round(product)
    if abs(product - n_inliers) > NEAR_AN_INTEGER:
        raise ValueError(
            f"{float(ratio):g} of {n_samples} measurements is {float(product):g}, "
            "not a whole number of inliers"
        )
    return n_inliers


def explain(problem: Problem) -> Explanation:
    """Compute what both rules do on the given numbers, under each sampling law.

    Raises
    ------
    ValueError
        When the counts contradict each other; the message names the argument.
    """
    n_inliers, n_samples, k = problem.n_inliers, problem.n_samples, problem.sample_size
    approximate = _finite(approximate_required_trials(n_inliers, n_samples, k, problem.confidence))
    laws: dict[str, Sampling] = {"distinct": "distinct", "replacement": "replacement"}
    if problem.strata:
        laws["stratified"] = problem.strata
    return Explanation(
        problem,
        approximate_all_inlier_probability(n_inliers, n_samples, k),
        approximate,
        tuple(_outcome(problem, name, law, approximate) for name, law in laws.items()),
    )


def sweep_measurements(problem: Problem, values: Sequence[int] | None = None) -> list[Explanation]:
    """Explain the problem at other numbers of measurements, at the same inlier ratio.

    Parameters
    ----------
    problem : Problem
        Its strata are left out: they do not scale.
    values : sequence of int, optional
        Numbers of measurements. By default about sixteen of them, from the smallest that has
        an all-inlier sample to 50 times the problem's own or more.

    Raises
    ------
    ValueError
        When one of `values` times the ratio is not near an integer.
    """
    ratio = Fraction(problem.n_inliers, problem.n_samples)
    if values is None:
        values = _default_measurements(problem, ratio)
    return [
        explain(_replaced(problem, n, inliers_from_ratio(ratio, n), problem.sample_size))
        for n in values
    ]


def sweep_inliers(problem: Problem, values: Sequence[int] | None = None) -> list[Explanation]:
    """Explain the problem at other numbers of inliers among the same measurements.

    Parameters
    ----------
    problem : Problem
        Its strata are left out: they do not scale.
    values : sequence of int, optional
        Numbers of inliers. By default about sixteen of them between the sample size and all.
    """
    if values is None:
        step = max(1, (problem.n_samples - problem.sample_size) // (_DEFAULT_ROWS - 1))
        chosen = {*range(problem.sample_size, problem.n_samples + 1, step)}
        values = sorted(chosen | {problem.n_inliers, problem.n_samples})
    return [explain(_replaced(problem, problem.n_samples, i, problem.sample_size)) for i in values]


def _replaced(problem: Problem, n_samples: int, n_inliers: int, sample_size: int) -> Problem:
    return Problem(
        n_samples,
        n_inliers,
        sample_size,
        problem.confidence,
        min_trials=problem.min_trials,
        max_trials=problem.max_trials,
    )


def _default_measurements(problem: Problem, ratio: Fraction) -> list[int]:
    if ratio == 0:
        return [problem.n_samples]
    # Only multiples of the ratio's denominator have a whole number of inliers.
    step = ratio.denominator
    first = -(-problem.sample_size // ratio.numerator)
    last = max(50 * problem.n_samples // step, 2 * first)
    growth = (last / first) ** (1 / (_DEFAULT_ROWS - 1))
    multiples = {round(first * growth**i) for i in range(_DEFAULT_ROWS)}
    return sorted({step * m for m in multiples} | {problem.n_samples})


def _outcome(problem: Problem, name: str, law: Sampling, approximate: int | None) -> LawOutcome:
    counts = (problem.n_inliers, problem.n_samples, problem.sample_size)
    exact = _finite(required_trials(*counts, problem.confidence, sampling=law))
    missing = undersampling(*counts, problem.confidence, sampling=law)
    strata = problem.strata if name == "stratified" else (Stratum(*counts),)
    n_subsets = math.prod(math.comb(s.n_samples, s.sample_size) for s in strata)
    limited = problem.has_limits
    return LawOutcome(
        sampling=name,
        all_inlier_probability=all_inlier_probability(*counts, sampling=law),
        required_trials=exact,
        true_success=true_success_probability(*counts, problem.confidence, sampling=law),
        success_of_approximate_trials=_success(problem, law, approximate),
        undersampling=missing if math.isfinite(missing) else None,
        n_subsets=n_subsets,
        n_all_inlier_subsets=math.prod(math.comb(s.n_inliers, s.sample_size) for s in strata),
        enumeration_is_cheaper=exact is None or n_subsets <= exact,
        approximate_within_limits=_within_limits(problem, law, approximate) if limited else None,
        exact_within_limits=_within_limits(problem, law, exact) if limited else None,
    )


def _within_limits(problem: Problem, law: Sampling, trials: int | None) -> LimitedRun:
    bound_by: Bound = "rule"
    wanted = trials
    if trials is not None and trials < problem.min_trials:
        trials, bound_by = problem.min_trials, "minimum"
    if problem.max_trials is not None and (trials is None or trials > problem.max_trials):
        trials, bound_by = problem.max_trials, "maximum"
    if trials == wanted:  # a floor above the cap may have raised it and the cap lowered it again
        bound_by = "rule"
    return LimitedRun(trials, bound_by, _success(problem, law, trials))


def _success(problem: Problem, law: Sampling, trials: int | None) -> float:
    counts = (problem.n_inliers, problem.n_samples, problem.sample_size)
    return success_probability(math.inf if trials is None else trials, *counts, sampling=law)


def _finite(trials: float) -> int | None:
    # Compared, not tested by math.isinf: the integer may be beyond the floats.
    return None if trials == math.inf else int(trials)
