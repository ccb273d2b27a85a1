"""How likely each stopping law makes what many runs returned.

The share f of the samples in a group from which the function finds it scales the chances of all
outcomes. It is not known beforehand, and is measured by runs that only their budget ends. The
same share is taken to hold in all problems within +-9 %, until those runs show that it does not.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ransac_fix.audit.outcome_laws import (
    PHI,
    Array,
    Hypothesis,
    Problem,
    chance_of_smaller,
    rounded,
    trials_of,
)

# Share of samples in a group from which it is found; local optimisation can raise it above 1.
_LOG_FOUND: Array = np.arange(-1.8, 0.61, 0.03)
FOUND: Array = np.exp(_LOG_FOUND)
# Most functions find it from all of them.
_PRIOR: Array = 1 / (1 + (_LOG_FOUND / 0.06) ** 2)
_LOG_PRIOR: Array = np.log(_PRIOR / _PRIOR.sum())
# By how many steps the share may differ between problems, +-9 %, and the log-likelihood ratio
# from which it is seen to differ more.
_NEIGHBOURS = 3
_ALIKE = 9.0
# Twice the log-likelihood below its maximum: chi-squared with one degree of freedom.
_INTERVAL_99 = 6.635
# Chance at most.
_ALL = 0.98
_FACTORS: Array = np.exp(np.arange(-1.2, 1.21, 0.02))


@dataclass
class Counts:
    """How many runs returned B, A and neither, and the chances of A that are possible.

    Parameters
    ----------
    p : ndarray
        Chance that a run that returned A or B returned A: by share found, shape (found,), or by
        law, share found and shift, shape (laws, found, phi). With `found` set, the chance that a
        run returned A or B at all.
    """

    p: Array
    larger: int = 0
    smaller: int = 0
    neither: int = 0
    found: bool = False

    @property
    def runs(self) -> int:
        """All of them."""
        return self.larger + self.smaller + self.neither

    def log_likelihood(self) -> Array:
        """Return that of the runs that returned A or B, or with `found` set of all, as `p` is."""
        one, other = self.smaller, self.larger
        if self.found:
            one, other = self.smaller + self.larger, self.neither
        return np.asarray(one * np.log(self.p) + other * np.log1p(-self.p))


class Evidence:
    """Everything seen so far, and what each law makes of it.

    Parameters
    ----------
    laws : sequence of Hypothesis
        Those that are tried.
    sample_size : int
        Inliers of a model that is no more than its sample.
    budget : bool, default True
        Whether runs can be given a number of trials. Otherwise runs of one trial show the share
        found, by how many find a group at all.
    """

    def __init__(
        self, laws: Sequence[Hypothesis], sample_size: int, *, budget: bool = True
    ) -> None:
        self.laws = laws
        self.sample_size = sample_size
        self.budget = budget
        # Runs that only their budget ended, and those that a rule ended, by u.
        self.calibrations: dict[Problem, Counts] = {}
        self.cells: dict[Problem, dict[float, Counts]] = {}

    def runs(self) -> int:
        """Return all runs so far."""
        cells = [one for of_one in self.cells.values() for one in of_one.values()]
        return sum(one.runs for one in (*self.calibrations.values(), *cells))

    def calibration(self, problem: Problem) -> Counts:
        """Return the runs with a fixed budget on this problem, or with one trial."""
        if problem not in self.calibrations and not self.budget:
            p = np.minimum((problem.smaller + problem.larger) * FOUND, _ALL)
            self.calibrations[problem] = Counts(p, found=True)
        if problem not in self.calibrations:
            budget = np.array([float(problem.fixed)])
            p = chance_of_smaller(problem, budget, budget, FOUND, "every trial")[:, 0]
            self.calibrations[problem] = Counts(p)
        return self.calibrations[problem]

    def cell(self, problem: Problem, u: float) -> Counts:
        """Return the runs at this confidence on this problem."""
        cells = self.cells.setdefault(problem, {})
        if u not in cells:
            cells[u] = Counts(np.stack([self.chances(law, problem, u) for law in self.laws]))
        return cells[u]

    def chances(self, law: Hypothesis, problem: Problem, u: float, found: Array = FOUND) -> Array:
        """Return a law's chance of A, shape (found, phi)."""
        in_hand, without = trials_of(law, problem, self.sample_size, np.array([u]))
        p = chance_of_smaller(problem, rounded(in_hand), rounded(without), found, law.tested)
        return np.asarray(p[0])

    def likelihoods(self) -> tuple[Array, Array, float]:
        """Return each law's mean and maximal log-likelihood, and that of no law at all."""
        each, shares, free = [], [], 0.0
        for problem, calibration in self.calibrations.items():
            share = calibration.log_likelihood()
            total = np.tile(share[:, None], (len(self.laws), 1, len(PHI)))
            for cell in self.cells[problem].values():
                total += cell.log_likelihood()
                free += _any_chance(cell.smaller, cell.larger)
            shares.append(share[None, :, None])
            each.append(total)
        alike = self.alike()
        mean, most = _over_found(each, alike)
        free += float(_over_found(shares, alike)[0][0, 0])
        return _log_sum(mean - math.log(len(PHI)), 1), most.max(axis=1), free

    def alike(self) -> bool:
        """Whether the share found is about the same in all problems, for all that was seen."""
        shares = [one.log_likelihood()[None, :, None] for one in self.calibrations.values()]
        if not shares:
            return True
        apart = sum(float(share.max()) for share in shares)
        together = np.sum([_window(share).max(axis=-1) for share in shares], axis=0)
        return apart - float(together.max()) < _ALIKE

    def found(self) -> float:
        """Return the likeliest share found, by the runs with a fixed budget."""
        shares = [one.log_likelihood() for one in self.calibrations.values()]
        return float(FOUND[int((np.sum(shares, axis=0) + _LOG_PRIOR).argmax())])

    def factor(self, law: Hypothesis) -> tuple[float, float, float]:
        """Return the likeliest factor on a law's trials, and its 99 % interval."""
        each = []
        for problem, calibration in self.calibrations.items():
            at = np.tile(calibration.log_likelihood()[:, None], (len(_FACTORS), 1, len(PHI)))
            for u, cell in self.cells[problem].items():
                in_hand, without = trials_of(law, problem, self.sample_size, np.array([u]))
                p = chance_of_smaller(
                    problem,
                    rounded(_FACTORS * in_hand),
                    rounded(_FACTORS * without),
                    FOUND,
                    law.tested,
                )
                at += Counts(p, cell.larger, cell.smaller).log_likelihood()
            each.append(at)
        total = _over_found(each, self.alike())[1].max(axis=1)
        inside = _FACTORS[2 * (total.max() - total) <= _INTERVAL_99]
        best = float(_FACTORS[total.argmax()])
        return round(best, 2), round(float(inside[0]), 2), round(float(inside[-1]), 2)


def _any_chance(smaller: int, larger: int) -> float:
    """Log-likelihood of these counts, averaged over every chance by Jeffreys' prior."""
    return (
        math.lgamma(smaller + 0.5)
        + math.lgamma(larger + 0.5)
        - math.lgamma(smaller + larger + 1)
        - math.log(math.pi)
    )


def _log_sum(values: Array, axis: int) -> Array:
    highest = values.max(axis=axis, keepdims=True)
    summed = np.log(np.exp(values - highest).sum(axis=axis, keepdims=True)) + highest
    return np.asarray(summed.squeeze(axis=axis))


def _window(values: Array) -> Array:
    """Return the neighbours of each share found, shape (laws, found, phi, neighbours)."""
    padded = np.pad(values, ((0, 0), (_NEIGHBOURS, _NEIGHBOURS), (0, 0)), constant_values=-1e9)
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1, axis=1)


def _over_found(each: Sequence[Array], alike: bool) -> tuple[Array, Array]:
    """Return the mean and the maximum of likelihoods over the shares found, (laws, phi).

    Parameters
    ----------
    each : sequence of ndarray, shape (laws, found, phi)
        Log-likelihood of what was seen in each problem.
    alike : bool
        Whether the shares are within a few percent of a common one, or free in each problem.
    """
    if not alike:
        mean = np.sum([_log_sum(one + _LOG_PRIOR[:, None], 1) for one in each], axis=0)
        return np.asarray(mean), np.asarray(np.sum([one.max(axis=1) for one in each], axis=0))
    near = math.log(2 * _NEIGHBOURS + 1)
    mean = np.sum([_log_sum(_window(one), 3) - near for one in each], axis=0)
    most = np.sum([_window(one).max(axis=3) for one in each], axis=0)
    return _log_sum(mean + _LOG_PRIOR[:, None], 1), np.asarray(most.max(axis=1))
