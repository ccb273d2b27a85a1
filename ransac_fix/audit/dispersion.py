"""Whether a rule goes by more than the numbers of inliers and measurements.

A rule that is a function of n, I, k and s keeps the smaller of two planted models equally often on
all problems of the same numbers. Runs that cannot be repeated are made many times on each of
several such problems: if their shares differ by far more than chance would have it, and those of
runs that only their budget ends do not, something else about the data decides when a run ends.
"""

import math
from typing import Any

from ransac_fix.audit.asking import Asked, Looks
from ransac_fix.audit.model import SamplerLaw
from ransac_fix.audit.sampling import drawing_of
from ransac_fix.audit.worker.streams import (
    LARGEST_CONFIDENCE,
    SMALLEST_CONFIDENCE,
    confidence_of,
)

# Problems of the same numbers, and runs on each: few, and where these differ many.
_PROBLEMS, _FEW, _MANY = 16, 25, 75
# Chi-squared with 15 degrees of freedom exceeds the one once in 20 times, the other in 10^9.
_NEAR, _FAR = 25.0, 73.6
# How much farther apart the ends by the rule must be than those by the budget.
_TIMES = 2.0
# -ln(1-s) at which rules end about every second run in time.
_U = 1.0
# Samples of more than these find the groups too seldom for two of the smaller, or for one.
_TWO_GROUPS, _ONE_GROUP = 4, 5
# A group is to be found from nearly all samples in it, or the solver tells problems apart.
_FOUND = 0.9
# A budget that the larger model outlasts once in so many runs.
_LAST = math.log(2000)


def goes_by_the_data(
    host: Asked, one: dict[str, Any], sampler: SamplerLaw, seed: int
) -> tuple[bool, int]:
    """Whether problems of the same numbers are told apart by when runs end; and the runs made.

    Parameters
    ----------
    host : Asked
        Runs the library.
    one : dict
        The entry point as described by the worker.
    sampler : SamplerLaw
        How it draws its samples: distinct or with replacement.
    seed : int
        Fixes the planted problems.
    """
    k = sampler.sample_size
    if k > _ONE_GROUP or sampler.found < _FOUND:
        return False, 0
    groups, size = 2 if k <= _TWO_GROUPS else 1, k + one["spare"]
    n = max(one["fewest_samples"], (groups + 1) * size + 1)
    chance = drawing_of(sampler).probability(((size + 1, n),))
    case = [n, size, groups]
    by_rule = [*case, math.ceil(_LAST / chance), confidence_of(_U)]
    by_budget = [*case, max(1, round(1.3 / chance)), LARGEST_CONFIDENCE]
    if not one["budget"]:
        by_budget = [*case, 1, SMALLEST_CONFIDENCE]
    looks = _Looks(host, one["name"], seed)
    if looks.apart(by_rule, _FEW) < _NEAR:
        return False, looks.runs
    far = looks.apart(by_rule, _MANY)
    return far > _FAR and far > _TIMES * looks.apart(by_budget, _MANY), looks.runs


class _Looks(Looks):
    """Runs on the same problems."""

    def apart(self, case: list[Any], runs: int) -> float:
        """Return how far apart problems are in the share of runs that keep the smaller model.

        As chi-squared against one share for all; 0 where there is none.
        """
        request = {"case": case, "problems": _PROBLEMS, "runs": runs, "seed": self._seed}
        counts: list[list[int]] = self._ask("dispersion", **request)["counts"]
        totals = [sum(pair) for pair in counts]
        share = sum(smaller for smaller, _ in counts) / max(1, sum(totals))
        if not 0 < share < 1:
            return 0.0
        return sum(
            (smaller - total * share) ** 2 / (total * share * (1 - share))
            for (smaller, _), total in zip(counts, totals, strict=True)
            if total
        )
