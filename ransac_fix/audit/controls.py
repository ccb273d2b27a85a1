"""Known laws, run by the reference behind the interface that the libraries are measured through.

An audit that cannot name these cannot be trusted on a library, and gives no verdict.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ransac_fix.audit.laws import Candidate, Fit, formula
from ransac_fix.audit.model import Assumed, Drawn, SamplerLaw

_ROUNDINGS: dict[str, tuple[float, Callable[[float], int]]] = {
    "floor": (0.0, math.floor),
    "nearest": (0.5, round),
    "ceil": (1.0, math.ceil),
    "ceil + 0.5": (1.5, lambda x: math.ceil(x + 0.5)),
}


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

    @property
    def candidate(self) -> Candidate:
        """The probability its rule assumes."""
        return Candidate(
            self.assumed, self.exponent or self.sample_size, self.inlier_offset, self.truncated
        )

    @property
    def phi(self) -> float:
        """The shift of its class."""
        return _ROUNDINGS[self.rounding][0] + self.offset

    @property
    def formula(self) -> str:
        """Its rule, as a report writes it."""
        return formula(self.candidate, self.multiplier, (self.phi, self.phi))

    def required_trials(
        self, n_inliers: int, n_samples: int, sample_size: int, confidence: float
    ) -> int | float:
        """Apply the rule: the `stopping_rule` of the reference."""
        del sample_size
        probability = self.candidate.probability(n_inliers, n_samples)
        if probability <= 0:
            return math.inf
        if probability >= 1:
            return 1
        x = self.multiplier * math.log1p(-confidence) / math.log1p(-probability)
        return _ROUNDINGS[self.rounding][1](x) + self.offset

    def recognised(self, found: Fit, sampler: SamplerLaw) -> bool:
        """Whether a measurement names this law, up to its class."""
        law = found.law
        return (
            law is not None
            and (law.assumed, law.sample_size) == (self.assumed, self.candidate.sample_size)
            and (law.inlier_offset, law.truncated) == (self.inlier_offset, self.truncated)
            and law.multiplier == self.multiplier
            and law.phi == (self.phi, self.phi)
            and law.tested == self.tested
            and (sampler.drawn, sampler.sample_size) == (self.drawn, self.sample_size)
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
)
