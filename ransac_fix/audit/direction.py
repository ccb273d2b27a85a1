"""Which way a stopping rule errs: whether it assumes too much of its sampler, or too little."""

from collections.abc import Iterator, Sequence

from ransac_fix.audit.defaults import standard_problems
from ransac_fix.audit.drawing import Strata, spread, totals
from ransac_fix.audit.laws import law_probability
from ransac_fix.audit.model import Point, SamplerLaw, StoppingLaw
from ransac_fix.audit.sampling import drawing_of

_EQUAL = 1e-9


def direction(law: StoppingLaw, sampler: SamplerLaw, points: Sequence[Point] = ()) -> int | None:
    """Compare the probability that a rule assumes with the one that its sampler has.

    Parameters
    ----------
    law : StoppingLaw
        The rule.
    sampler : SamplerLaw
        How samples are drawn.
    points : sequence of Point, optional
        Points measured: compared there, too.

    Returns
    -------
    int or None
        1 where too much is assumed, -1 where too little, 0 for never, None for both.
    """
    larger = smaller = False
    drawing = drawing_of(sampler)
    for strata in _problems(sampler.sample_size, points):
        n_inliers, n = totals(strata)
        if n_inliers <= sampler.sample_size:
            continue
        true = drawing.probability(strata)
        assumed = law_probability(law, n_inliers, n, strata)
        larger |= assumed > true * (1 + _EQUAL)
        smaller |= assumed < true * (1 - _EQUAL)
    if larger and smaller:
        return None
    return int(larger) - int(smaller)


def strata_of(points: Sequence[Point]) -> int:
    """Return how many strata the problems measured have."""
    return max([1, *(len(point.strata) for point in points)])


def _problems(sample_size: int, points: Sequence[Point]) -> Iterator[Strata]:
    """Yield the problems measured, the standard ones, and some where truncation of I bites."""
    for point in points:
        yield point.strata or ((point.n_inliers, point.n),)
    n_strata = strata_of(points)
    for n, n_inliers in (*standard_problems(sample_size), (22, 15), (44, 15), (49, 8), (98, 8)):
        yield spread(n_inliers, n, n_strata)
