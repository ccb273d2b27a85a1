"""Known laws, run by the reference behind the interface that the libraries are measured through.

An audit that cannot name these cannot be trusted on a library, and gives no verdict.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from ransac_fix.audit.drawing import Strata
from ransac_fix.audit.laws import Candidate, formula
from ransac_fix.audit.measure import Measurement
from ransac_fix.audit.model import DEFECTS, Assumed, Drawn, StoppingLaw

_ROUNDINGS: dict[str, tuple[float, Callable[[float], int]]] = {
    "floor": (0.0, math.floor),
    "nearest": (0.5, round),
    "ceil": (1.0, math.ceil),
    "ceil + 0.5": (1.5, lambda x: math.ceil(x + 0.5)),
}

Quirk: TypeAlias = Literal[
    "first model",
    "first consensus",
    "confidence ignored",
    "no rule",
    "overflow",
    "filter",
    "score",
    "beyond counts",
]
# Controls that every measurement rests on, those of strata, and those by outcomes, with a number of
# trials to be set and without.
Kind: TypeAlias = Literal["any", "strata", "outcomes", "no budget"]
KINDS: tuple[Kind, ...] = ("any", "strata", "outcomes", "no budget")
# With these no law is to be found.
_NAMED_ALONE = (
    "first model",
    "first consensus",
    "confidence ignored",
    "no rule",
    "score",
    "beyond counts",
)
# P below which the control with the overflow ends at once, as single precision would.
_VANISHING = 1e-7


@dataclass(frozen=True, slots=True)
class KnownLaw:
    """A stopping rule and a sampler to be recognised.

    Parameters
    ----------
    name : str
        What it stands for.
    assumed : str
        P of the rule.
    problem : str
        Planted problem; decides the true k.
    sample_size : int
        k of the sampler.
    exponent : int or None
        k of the rule, where it is another.
    inlier_offset : int
        Added to I in the rule.
    multiplier : float
        Factor on its number.
    rounding : str
        Key of the table of roundings.
    offset : int
        Trials added.
    drawn : str
        The sampler.
    tested : str
        When the rule is consulted.
    truncated : bool
        I computed from a ratio and truncated.
    counted : bool
        Whether the run reports its trials.
    n_strata : int
        Strata of the measurements.
    quota : tuple of int
        Parts of the sample, of the sampler and of a rule that goes by strata; see `Drawing`.
    outcomes_only : bool
        Whether its runs can be neither repeated nor counted, so that only what many of them
        return shows the rule.
    budget : bool
        Whether it takes a number of trials; else only outcomes show the rule, too.
    quirk : str or None
        What the program does besides: a defect that must be named, ``"filter"`` for a sampler
        that redraws odd samples without counting a trial, ``"score"`` for a rule that takes a
        score for the number of inliers, ``"beyond counts"`` for one whose number the data change.
    """

    name: str
    assumed: Assumed
    problem: Literal["line", "affine", "homography"] = "line"
    sample_size: int = 2
    exponent: int | None = None
    inlier_offset: int = 0
    multiplier: float = 1.0
    rounding: str = "ceil"
    offset: int = 0
    drawn: Drawn = "distinct"
    tested: Literal["every trial", "on improvement"] = "every trial"
    truncated: bool = False
    counted: bool = False
    n_strata: int = 1
    quota: tuple[int, ...] = ()
    outcomes_only: bool = False
    budget: bool = True
    quirk: Quirk | None = None

    @property
    def candidate(self) -> Candidate:
        """The probability its rule assumes."""
        by_strata = self.assumed not in ("approximate", "distinct", "replacement")
        return Candidate(
            self.assumed,
            self.exponent or self.sample_size,
            self.inlier_offset,
            self.truncated,
            self.quota if by_strata else (),
        )

    @property
    def phi(self) -> float:
        """The shift of its class."""
        return _ROUNDINGS[self.rounding][0] + self.offset

    @property
    def formula(self) -> str:
        """Its rule, as a report writes it."""
        if self.quirk in _NAMED_ALONE:
            return self.quirk or ""
        return formula(self.candidate, self.multiplier, (self.phi, self.phi))

    def required_trials(
        self,
        n_inliers: int,
        n_samples: int,
        sample_size: int,
        confidence: float,
        strata: Strata = (),
    ) -> int | float:
        """Apply the rule: the `stopping_rule` of the reference."""
        probability = self.candidate.probability(n_inliers, n_samples, strata)
        match self.quirk:
            case "score":
                # As a truncated squared error would score inliers that are not perfect.
                probability **= 1.37
            case "no rule":
                return math.inf
            case "first model" if n_inliers <= sample_size:
                return 1
            case "first consensus":
                return 1 if n_inliers > sample_size else math.inf
            case "confidence ignored":
                confidence = 0.99
            case "overflow" if probability < _VANISHING:
                return 1
        if probability <= 0:
            return math.inf
        if probability >= 1:
            return 1
        x = self.multiplier * math.log1p(-confidence) / math.log1p(-probability)
        return _ROUNDINGS[self.rounding][1](x) + self.offset

    def recognised(self, measured: Measurement) -> bool:
        """Whether a measurement names this law, up to its class, and its quirk."""
        law, sampler = measured.fit.law, measured.sampler
        drawn = sampler.drawn, sampler.sample_size, sampler.quota
        if drawn != (self.drawn, self.sample_size, self.quota):
            return False
        quirk = self.quirk
        if quirk == "no rule" and self.outcomes_only:
            # That a run uses its budget does not show, only that it has no use for s.
            quirk = "confidence ignored"
        if quirk == "beyond counts" and not self.outcomes_only:
            # Points show that they follow no law, not why.
            quirk = None
        if measured.defects != ((quirk,) if quirk in DEFECTS else ()):
            return False
        if self.quirk in _NAMED_ALONE:
            return law is None and not measured.fit.rivals
        if self.outcomes_only:
            # Of laws that outcomes do not tell apart this must be one.
            found = (law, *measured.fit.rivals) if law is not None else ()
            return any(self._is(one) for one in found)
        return law is not None and self._is(law)

    def _is(self, law: StoppingLaw) -> bool:
        """Whether a law is this one, up to its class."""
        return (
            (law.assumed, law.sample_size) == (self.assumed, self.candidate.sample_size)
            and (law.inlier_offset, law.truncated) == (self.inlier_offset, self.truncated)
            and law.quota == self.candidate.quota
            and law.multiplier == self.multiplier
            and law.phi == (None if self.outcomes_only else (self.phi, self.phi))
            and law.tested == self.tested
        )


# The laws that an audit proves itself on, few enough to take no time: each way the laws of the
# libraries differ occurs once.
CONTROLS = (
    KnownLaw("approximate, nearest", "approximate", rounding="nearest"),
    KnownLaw("exact", "distinct", "affine", 3),
    KnownLaw("exact in I+1", "distinct", "affine", 3, inlier_offset=1),
    KnownLaw("approximate, three times", "approximate", "affine", 3, multiplier=3, offset=1),
    KnownLaw("replacement sampler", "replacement", "affine", 3, drawn="replacement"),
    KnownLaw("wrong exponent", "approximate", "affine", 3, exponent=2, rounding="floor"),
    KnownLaw("exact, counted", "distinct", counted=True),
    KnownLaw("tested on improvement", "approximate", tested="on improvement"),
    KnownLaw("stratified", "stratified", "affine", 3, drawn="stratified", n_strata=2, quota=(2, 1)),
    KnownLaw("by strata, pooled rule", "approximate", "affine", 3, drawn="weighted", n_strata=2),
)

# The law that an audit proves itself on where it has to go by outcomes, and one that fewer runs
# tell from those of other verdicts: it is to be told from the exact one, too. Then one for
# functions that take no number of trials.
OUTCOME_CONTROLS = (KnownLaw("exact, by outcomes", "distinct", "affine", 3, outcomes_only=True),)
QUICK_OUTCOME_CONTROLS = (
    KnownLaw(
        "exact in I+1, by outcomes",
        "distinct",
        "affine",
        3,
        inlier_offset=1,
        outcomes_only=True,
    ),
)
NO_BUDGET_CONTROLS = (
    KnownLaw(
        "wrong exponent, without a budget",
        "approximate",
        exponent=1,
        rounding="floor",
        outcomes_only=True,
        budget=False,
    ),
)


def controls_for(kind: Kind, *, quick: bool = False) -> tuple[KnownLaw, ...]:
    """Return the known laws that an audit proves itself on.

    Parameters
    ----------
    kind : {"any", "strata", "outcomes", "no budget"}
        What rests on them: every measurement, one of a function that knows of strata, one that
        goes by outcomes, or one that does so and takes no number of trials.
    quick : bool, default False
        Whether few runs matter.
    """
    if kind == "outcomes":
        return QUICK_OUTCOME_CONTROLS if quick else OUTCOME_CONTROLS
    if kind == "no budget":
        return NO_BUDGET_CONTROLS
    return tuple(law for law in CONTROLS if (law.n_strata > 1) == (kind == "strata"))


# All laws known, for the benchmark that measures how often one is mistaken.
ZOO = (
    *CONTROLS,
    KnownLaw("approximate, down", "approximate", "affine", 3, rounding="floor"),
    KnownLaw("approximate, up", "approximate", "affine", 3),
    KnownLaw("approximate, up from a half", "approximate", "affine", 3, rounding="ceil + 0.5"),
    KnownLaw("exact, down", "distinct", "affine", 3, rounding="floor"),
    KnownLaw("exact, nearest", "distinct", rounding="nearest"),
    KnownLaw("exact, homography", "distinct", "homography", 4),
    KnownLaw("approximate, homography", "approximate", "homography", 4),
    KnownLaw("exact in I-1", "distinct", "affine", 3, inlier_offset=-1),
    KnownLaw("I truncated", "distinct", "affine", 3, truncated=True),
    KnownLaw("exponent one too large", "approximate", "affine", 3, exponent=4),
    KnownLaw("one and a half times", "approximate", "affine", 3, multiplier=1.5),
    KnownLaw("twice", "distinct", "affine", 3, multiplier=2),
    KnownLaw("one trial short", "distinct", "affine", 3, offset=-1),
    KnownLaw("one trial more", "distinct", "affine", 3, offset=1),
    KnownLaw("two trials more", "approximate", "affine", 3, offset=2),
    KnownLaw("replacement sampler, approximate", "approximate", "affine", 3, drawn="replacement"),
    KnownLaw("replacement sampler, exact", "distinct", "affine", 3, drawn="replacement"),
    KnownLaw("filter that counts no trials", "distinct", "affine", 3, quirk="filter"),
    KnownLaw("score for a count", "distinct", "affine", 3, quirk="score"),
    KnownLaw("data for a count", "distinct", "affine", 3, quirk="beyond counts"),
    KnownLaw("exact, tested on improvement", "distinct", "affine", 3, tested="on improvement"),
    KnownLaw("stops for I <= k", "distinct", "affine", 3, quirk="first model"),
    KnownLaw("stops for I > k", "approximate", "affine", 3, quirk="first consensus"),
    KnownLaw(
        "stops for I > k, counted",
        "approximate",
        "homography",
        4,
        counted=True,
        quirk="first consensus",
    ),
    KnownLaw("confidence ignored", "approximate", "affine", 3, quirk="confidence ignored"),
    KnownLaw("no rule", "distinct", quirk="no rule"),
    KnownLaw("overflow to one trial", "approximate", "affine", 3, quirk="overflow"),
    KnownLaw("approximate, counted", "approximate", "affine", 3, counted=True),
    KnownLaw(
        "stratified, pooled rule",
        "approximate",
        "homography",
        4,
        rounding="nearest",
        drawn="stratified",
        n_strata=2,
        quota=(3, 1),
    ),
    KnownLaw(
        "stratified, approximate",
        "approximate stratified",
        "affine",
        3,
        drawn="stratified",
        n_strata=2,
        quota=(1, 2),
        counted=True,
    ),
    KnownLaw(
        "three strata", "stratified", "affine", 3, drawn="stratified", n_strata=3, quota=(1, 1, 1)
    ),
    KnownLaw("by strata, exact", "weighted", "affine", 3, drawn="weighted", n_strata=2),
    KnownLaw("by strata, exact for pooled", "distinct", "affine", 3, drawn="weighted", n_strata=3),
    KnownLaw(
        "strata at random",
        "weighted",
        "affine",
        3,
        drawn="weighted",
        n_strata=2,
        quota=(2, 1),
    ),
    KnownLaw(
        "strata at random, pooled rule",
        "approximate",
        "homography",
        4,
        drawn="weighted",
        n_strata=2,
        quota=(3, 1),
        counted=True,
    ),
    KnownLaw("strata that do not matter", "distinct", "affine", 3, n_strata=2),
    KnownLaw("sampler that prefers the first", "approximate", "affine", 3, drawn="not uniform"),
)

# Those that can be told by outcomes; a rule that is off by a trial or rounds otherwise is one of
# its class there, and the few of "overflow" and "first model" end before anything is in hand, or
# then.
_BY_OUTCOMES = tuple(
    replace(law, name=f"{law.name}, by outcomes", outcomes_only=True)
    for law in ZOO
    if not law.counted
    and not law.truncated
    and law.n_strata == 1
    and law.drawn != "not uniform"
    and law.quirk not in ("first model", "first consensus", "overflow")
)
# Without a budget too, those that end with one trial at the lowest confidence: duplicates do not
# show there, and where I-1 of k counts a run goes on.
OUTCOME_ZOO = (
    *_BY_OUTCOMES,
    *(
        replace(law, name=f"{law.name}, no budget", budget=False)
        for law in _BY_OUTCOMES
        if law.phi <= 1
        and law.drawn == "distinct"
        and law.inlier_offset >= 0
        and law.quirk not in ("filter", "confidence ignored", "no rule")
    ),
)
