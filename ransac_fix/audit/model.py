"""What the audit reports: plain data, the model behind every output format."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

SCHEMA_VERSION: Literal[1] = 1

Judgement: TypeAlias = Literal["exact", "undersamples", "oversamples", "other rule", "not measured"]
JUDGEMENTS: tuple[Judgement, ...] = get_args(Judgement)

Assumed: TypeAlias = Literal[
    "approximate",
    "distinct",
    "replacement",
    "stratified",
    "weighted",
    "approximate stratified",
    "approximate weighted",
    "unknown",
]
"""The probability a stopping rule assumes: that of a way of drawing, or what it would be with
independent draws, such as (I/n)^k."""

Drawn: TypeAlias = Literal[
    "distinct", "replacement", "stratified", "weighted", "not uniform", "undecided"
]

Defect: TypeAlias = Literal[
    "first model",
    "first consensus",
    "confidence ignored",
    "no rule",
    "overflow",
    "beyond counts",
]
"""What a program does besides its law, or in place of one; see `DEFECTS`."""

DEFECTS: dict[Defect, str] = {
    "first model": "ends with its first model, whatever the confidence",
    "first consensus": (
        "ends with the first model that has more inliers than its sample, whatever the confidence"
    ),
    "confidence ignored": "takes a confidence that has no effect",
    "no rule": "has no stopping rule: it always uses its budget",
    "overflow": "ends with its first sample on many measurements, where P is tiny",
    "beyond counts": (
        "stops by more than n, I, k and s: on other data of the same numbers it ends runs at other "
        "times"
    ),
}

Binding: TypeAlias = Literal["rule", "minimum", "maximum"]


@dataclass(frozen=True, slots=True)
class Point:
    """One exact point of a stopping rule.

    Parameters
    ----------
    n : int
        Measurements.
    n_inliers : int
        Inliers of the model that governed the rule, counted in the result of the run.
    sample_size : int
        k of the law found, or as documented where none was.
    trials : int
        The trial that the rule lets happen from `u` on.
    u : float
        -ln(1 - s) at which it does.
    u_low : float
        The highest -ln(1 - s) at which it was seen not to.
    in_hand : int
        The trial since which the model was in hand; 0 where it was not measured.
    kind : str
        ``"flip"``: read off outcomes. ``"count"``: the library reported its trials, or they were
        counted.
    strata : tuple of (inliers, measurements)
        How the I and n fall into strata, such as the cameras of a rig; empty for one.
    """

    n: int
    n_inliers: int
    sample_size: int
    trials: int
    u: float
    u_low: float
    in_hand: int
    kind: Literal["flip", "count"]
    strata: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class StoppingLaw:
    """The stopping law that every point follows, up to its class.

    Trial t happens while ``x > t - phi``, with ``x = multiplier * ln(1-s) / ln(1-P)``. So phi is
    0 for rounding down, 1/2 for the nearest, 1 for rounding up, and one more for a test after
    the trial in place of before it.

    Parameters
    ----------
    assumed : str
        The probability P assumed.
    sample_size : int
        k in P.
    inlier_offset : int
        Added to the number of inliers in P.
    multiplier : float
        Factor on the number of trials, with the library's own multiplier set to 1 where it has
        one.
    phi : tuple of float or None
        Smallest and largest seen; they differ where one sample gives several models. None where
        only outcomes were seen, which do not show it.
    tested : str
        ``"every trial"``, or ``"on improvement"`` for a rule that is consulted only when the
        model in hand improves.
    truncated : bool
        Whether I is computed as ``int(I / n * n)`` and now and then comes out one too small.
    formula : str
        One representative of the class.
    quota : tuple of int
        Sizes of the parts of a sample in P, where it goes by strata; as in `SamplerLaw`.
    """

    assumed: Assumed
    sample_size: int
    inlier_offset: int
    multiplier: float
    phi: tuple[float, float] | None
    tested: Literal["every trial", "on improvement"]
    truncated: bool
    formula: str
    quota: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class SamplerLaw:
    """How minimal samples are drawn, from how often a planted group was hit.

    Parameters
    ----------
    drawn : str
        The law. ``"distinct"`` and ``"replacement"``: from all measurements alike.
        ``"stratified"``: fixed numbers from each stratum (camera, pair of images).
        ``"weighted"``: a stratum first, each as likely as any other, then its measurements.
    sample_size : int
        Measurements in one sample.
    hits, expected : int, float
        Runs in which the planted group was found within the trials given to them, and how many
        the law expects.
    runs : int
        How many runs there were.
    interval : tuple of float
        99 % interval of the chance to hit, relative to that of distinct uniform draws, or to that
        of the law where it goes by strata.
    found : float
        Share of the samples that lie in the group from which the library finds it, as fitted:
        below 1 where checks reject samples and count them, or solvers fail.
    quota : tuple of int
        Stratified: how many come from each stratum. Weighted: how many from the first, the
        second, ... of different strata drawn at random; empty where every measurement has its
        stratum drawn anew.
    error : float
        Chance that another law would have been taken for this one: the ratio of their
        likelihoods.
    strayed : str
        What was seen where samples are not drawn uniformly.
    accepted : tuple of float or None
        Share of the samples that a filter accepts on scattered matches, as a 99 % interval; those
        rejected are drawn again and count as no trial. It depends on the data, and is no part of
        the law. None where it was not tried.
    """

    drawn: Drawn
    sample_size: int
    hits: int
    expected: float
    runs: int
    interval: tuple[float, float]
    found: float = 1.0
    quota: tuple[int, ...] = ()
    error: float = 0.0
    strayed: str = ""
    accepted: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class OutcomeCount:
    """What runs that cannot be repeated returned, on one size of problem at one confidence.

    Parameters
    ----------
    n : int
        Measurements.
    n_inliers : int
        Size of each smaller group; the larger one holds one more.
    n_groups : int
        Smaller groups.
    confidence : float or None
        s; None for runs that only their budget ended, which show how often the groups are found.
    max_trials : int
        Budget.
    smaller, larger, neither : int
        Runs that returned a smaller model, the larger one, or neither.
    approximate, exact, expected : float or None
        Chance that a run with one of the two models returned the smaller: by (I/n)^k, by the
        exact probability, and by the law found; None where there is none.
    """

    n: int
    n_inliers: int
    n_groups: int
    confidence: float | None
    max_trials: int
    smaller: int
    larger: int
    neither: int
    approximate: float | None
    exact: float | None
    expected: float | None


@dataclass(frozen=True, slots=True)
class LikelihoodRatio:
    """How much likelier the law found makes the outcomes than another does.

    Parameters
    ----------
    law : str
        The other law, without its rounding.
    log_ratio : float
        Natural logarithm of the ratio, a lower bound: the law found averaged over what is not
        known of the function, the other at its best.
    """

    law: str
    log_ratio: float


@dataclass(frozen=True, slots=True)
class OutcomeEvidence:
    """What was seen of a function whose runs can be neither repeated nor counted.

    Parameters
    ----------
    runs : int
        Runs, those with a fixed budget included.
    error_rate : float
        Bound on the chance that any one other law is true and was rejected.
    counts : tuple of OutcomeCount
        What they returned.
    likeliest : str
        The law under which this is likeliest, without its rounding.
    ratios : tuple of LikelihoodRatio
        Of it against the laws that came closest, and the approximate and the exact one.
    factor : tuple of float or None
        Trials relative to those by the law found: the likeliest factor and its 99 % interval.
    no_law : float
        The log-ratio in favour of no law at all; above ``-ln(error_rate)`` all are rejected.
    """

    runs: int
    error_rate: float
    counts: tuple[OutcomeCount, ...]
    likeliest: str
    ratios: tuple[LikelihoodRatio, ...]
    factor: tuple[float, float, float] | None
    no_law: float


@dataclass(frozen=True, slots=True)
class Guarantee:
    """What a library's defaults promise for one (n, I, k, s).

    Parameters
    ----------
    n, n_inliers, sample_size : int
        The problem.
    confidence : float
        s, the library's default or the user's.
    trials : int
        Trials run once a model with `n_inliers` is in hand.
    exact_trials : int or None
        Trials that the exact rule asks for; None where it asks for infinitely many.
    binds : str
        What sets `trials`.
    probability : float
        With a model of I inliers in hand, the probability that one sample lay wholly within any
        other set of I inliers.
    """

    n: int
    n_inliers: int
    sample_size: int
    confidence: float
    trials: int
    exact_trials: int | None
    binds: Binding
    probability: float


@dataclass(frozen=True, slots=True)
class AtDefaults:
    """What binds at the library's own defaults.

    Parameters
    ----------
    confidence : float
        Default s.
    min_trials : int
        Floor on the number of trials.
    max_trials : int or None
        Cap on it; None for none.
    multiplier : float
        Factor on the rule's number.
    checked : bool or None
        Whether runs with nothing set behaved as these values say; None where that was not
        tried.
    guarantees : tuple of Guarantee
        At standard problems, then at the user's own.
    n_strata : int
        Strata that measurements and inliers of these problems are spread over evenly.
    """

    confidence: float
    min_trials: int
    max_trials: int | None
    multiplier: float
    checked: bool | None
    guarantees: tuple[Guarantee, ...]
    n_strata: int = 1


@dataclass(frozen=True, slots=True)
class TrialCount:
    """What one run of a wrapped function came to.

    Parameters
    ----------
    n_samples, n_inliers, sample_size : int
        The problem, with the inliers in hand at the end.
    confidence : float
        s of the call.
    own : int or None
        Trials of the library's first run; None for infinity, here and below.
    first_inliers : int
        Inliers in hand then.
    trials : int or None
        These and the missing ones that were drawn.
    required : int or None
        What the sampler needs.
    limit : int or None
        The limit on trials.
    """

    n_samples: int
    n_inliers: int
    sample_size: int
    confidence: float
    own: int | None
    first_inliers: int
    trials: int | None
    required: int | None
    limit: int | None


@dataclass(frozen=True, slots=True)
class OutcomeTest:
    """Wald's test between a library's own number of trials and the exact one, by outcomes.

    Parameters
    ----------
    n_samples, n_inliers, sample_size : int
        The planted problem: groups of `n_inliers`, and one of one more that is to be found.
    confidence : float
        s.
    own, exact : int
        Trials with a smaller group in hand, by the library's rule and as needed.
    chance_own, chance_exact : float
        Chance that a run which returns a group returns the larger one, with either.
    larger, smaller : int
        Runs of the wrapped function that returned the larger group, and a smaller one.
    log_ratio : float
        Natural logarithm of how much likelier the exact number makes them.
    larger_alone, smaller_alone, log_ratio_alone
        The same without the missing trials.
    """

    n_samples: int
    n_inliers: int
    sample_size: int
    confidence: float
    own: int
    exact: int
    chance_own: float
    chance_exact: float
    larger: int
    smaller: int
    log_ratio: float
    larger_alone: int
    smaller_alone: int
    log_ratio_alone: float


@dataclass(frozen=True, slots=True)
class Extension:
    """Whether a wrapped function draws the trials that its library leaves out.

    Parameters
    ----------
    runs : int
        Runs counted.
    extended : int
        Those in which trials were missing, and were drawn.
    kept : int
        Those that came to the exact number, or to their limit.
    counted : bool
        The library says how many trials it ran; otherwise its wrapper works out what its rule
        asks for.
    counts : tuple of TrialCount
        One run for each problem and confidence.
    outcomes : OutcomeTest or None
        None where the two numbers are too near each other to be told apart by outcomes.
    """

    runs: int
    extended: int
    kept: int
    counted: bool
    counts: tuple[TrialCount, ...]
    outcomes: OutcomeTest | None


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the audit found of one entry point.

    Parameters
    ----------
    system, entry_point, version : str
        What was measured.
    verdict : str
        Whether the probability that the stopping rule assumes is the probability that the
        sampler has.
    reason : str
        Why, in one or two sentences.
    advice : str
        What a user can do; empty where nothing need be done.
    sampler_law, stopping_law, at_defaults
        The measurement; None where there is none.
    points : tuple of Point
        The evidence.
    defects : tuple of str
        What was seen besides the law.
    outcomes : OutcomeEvidence or None
        The evidence in place of points, where runs can be neither repeated nor counted.
    runs : int
        Library runs spent.
    seconds : float
        Time spent.
    extension : Extension or None
        The evidence on a function wrapped by a patch, in place of points.
    """

    system: str
    entry_point: str
    version: str | None
    verdict: Judgement
    reason: str
    advice: str = ""
    sampler_law: SamplerLaw | None = None
    stopping_law: StoppingLaw | None = None
    at_defaults: AtDefaults | None = None
    points: tuple[Point, ...] = ()
    defects: tuple[Defect, ...] = ()
    outcomes: OutcomeEvidence | None = None
    runs: int = 0
    seconds: float = 0.0
    extension: Extension | None = None


@dataclass(frozen=True, slots=True)
class Control:
    """A known law that the audit measured in the same run, to prove that it can.

    Parameters
    ----------
    name : str
        The law put in.
    expected, identified : str
        The law put in and the law found, in the words of `StoppingLaw.formula`.
    passed : bool
        Whether they are of one class.
    runs : int
        Runs spent.
    """

    name: str
    expected: str
    identified: str
    passed: bool
    runs: int


@dataclass(frozen=True, slots=True)
class Report:
    """One audit.

    Parameters
    ----------
    verdicts : tuple of Verdict
        By system and entry point.
    controls : tuple of Control
        The known laws measured alongside.
    not_installed : tuple of str
        Systems with a probe that are not installed here.
    runs : int
        Library runs spent, controls included.
    seconds : float
        Time from start to end.
    """

    schema_version: Literal[1]
    verdicts: tuple[Verdict, ...]
    controls: tuple[Control, ...]
    not_installed: tuple[str, ...]
    runs: int
    seconds: float
