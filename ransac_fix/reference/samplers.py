"""Samplers: how the indices of a minimal sample are drawn.

Every draw is exactly uniform over its possibilities: bounded integers come from
`numpy.random.Generator.integers`, which rejects rather than scales.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ransac_fix.criterion import Sampling, Stratum
from ransac_fix.reference.interface import BoolArray, IndexArray

# numpy draws bounded integers up to this.
_LARGEST_BOUND = 2**63 - 1


@dataclass(frozen=True, slots=True)
class DistinctSampler:
    """Draw `sample_size` distinct indices, uniformly: what nearly every library does.

    Parameters
    ----------
    n_samples : int
        Number of measurements, n.
    sample_size : int
        Indices in one draw, k, 1 to `n_samples`.

    Raises
    ------
    ValueError
        If `sample_size` is not from 1 to `n_samples`.

    Notes
    -----
    One draw costs one bounded random integer as long as ``n (n-1) ... (n-k+1) < 2**63``: its
    digits in the bases n, n-1, ... are the steps of a partial shuffle. All k! orders of a subset
    are equally likely. `numpy.random.Generator.choice` draws from the same law at five to ten
    times the cost for small n.
    """

    n_samples: int
    sample_size: int
    _steps: tuple[tuple[int, tuple[int, ...]], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _check_size(self.n_samples, self.sample_size)
        bases = range(self.n_samples, self.n_samples - self.sample_size, -1)
        object.__setattr__(self, "_steps", _steps(bases))

    def draw(self, rng: np.random.Generator) -> IndexArray:
        """Return `sample_size` distinct indices below `n_samples`, in random order.

        Parameters
        ----------
        rng : numpy.random.Generator
            The source of randomness; consumed by the same amount whatever came before.

        Returns
        -------
        ndarray of shape (sample_size,)
        """
        drawn: list[int] = []
        taken: list[int] = []  # drawn, in ascending order
        for bound, bases in self._steps:
            digits = int(rng.integers(bound))
            for base in bases:
                digits, index = divmod(digits, base)
                # The index-th of those not yet taken.
                position = 0
                for other in taken:
                    if index < other:
                        break
                    index += 1
                    position += 1
                taken.insert(position, index)
                drawn.append(index)
        return np.array(drawn, dtype=np.intp)

    def sampling(self, inliers: BoolArray) -> Sampling:  # noqa: ARG002 -- the same for any inliers
        """Return the law of the draws, ``"distinct"``."""
        return "distinct"

    @property
    def n_subsets(self) -> int:
        """Different subsets, C(n, k)."""
        return math.comb(self.n_samples, self.sample_size)

    def subset(self, rank: int) -> IndexArray:
        """Return the subset with this number in lexicographic order.

        Parameters
        ----------
        rank : int
            0 to ``n_subsets - 1``.

        Returns
        -------
        ndarray of shape (sample_size,)
            The indices in ascending order.

        Raises
        ------
        ValueError
            If `rank` is out of range.
        """
        if not 0 <= rank < self.n_subsets:
            raise ValueError(f"rank must be from 0 to {self.n_subsets - 1}, not {rank}")
        return np.array(_unrank(rank, self.n_samples, self.sample_size), dtype=np.intp)

    def subsets(self) -> Iterator[IndexArray]:
        """Yield all C(n, k) subsets in lexicographic order."""
        for indices in itertools.combinations(range(self.n_samples), self.sample_size):
            yield np.array(indices, dtype=np.intp)


@dataclass(frozen=True, slots=True)
class ReplacementSampler:
    """Draw `sample_size` independent indices, so that one may come twice.

    A sample with a repeated index is a degenerate one; the trial is spent all the same.

    Parameters
    ----------
    n_samples : int
        Number of measurements, n.
    sample_size : int
        Indices in one draw, k, 1 to `n_samples`.

    Raises
    ------
    ValueError
        If `sample_size` is not from 1 to `n_samples`.
    """

    n_samples: int
    sample_size: int
    _steps: tuple[tuple[int, tuple[int, ...]], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _check_size(self.n_samples, self.sample_size)
        object.__setattr__(self, "_steps", _steps([self.n_samples] * self.sample_size))

    def draw(self, rng: np.random.Generator) -> IndexArray:
        """Return `sample_size` independent indices below `n_samples`.

        Parameters
        ----------
        rng : numpy.random.Generator
            The source of randomness.

        Returns
        -------
        ndarray of shape (sample_size,)
        """
        drawn: list[int] = []
        for bound, bases in self._steps:
            digits = int(rng.integers(bound))
            for base in bases:
                digits, index = divmod(digits, base)
                drawn.append(index)
        return np.array(drawn, dtype=np.intp)

    def sampling(self, inliers: BoolArray) -> Sampling:  # noqa: ARG002 -- the same for any inliers
        """Return the law of the draws, ``"replacement"``."""
        return "replacement"


class StratifiedSampler:
    """Draw a fixed number of distinct indices from each stratum.

    Parameters
    ----------
    strata : sequence of (indices, sample_size)
        For each stratum, the indices of its measurements and how many of them every sample
        takes. Together the strata hold each index from 0 to n-1 exactly once.

    Raises
    ------
    ValueError
        If the strata are not a partition of 0 to n-1, or a stratum's `sample_size` is not from
        0 to its number of measurements, or no stratum gives any.

    Notes
    -----
    OpenGV's MultiRansac and the hybrid estimators of RansacLib and PoseLib draw so.
    """

    def __init__(self, strata: Sequence[tuple[npt.ArrayLike, int]]) -> None:
        members = [np.asarray(indices, dtype=np.intp).reshape(-1) for indices, _ in strata]
        every = np.concatenate(members) if members else np.empty(0, dtype=np.intp)
        if not np.array_equal(np.sort(every), np.arange(every.size)):
            raise ValueError("strata must hold each index from 0 to n-1 exactly once")
        self._members = members
        self._sizes = [size for _, size in strata]
        for number, (indices, size) in enumerate(zip(members, self._sizes, strict=True)):
            if not 0 <= size <= indices.size:
                raise ValueError(
                    f"sample_size of stratum {number} must be from 0 to its {indices.size} "
                    f"measurements, not {size}"
                )
        # A stratum that gives nothing keeps its place in the law and is never drawn from.
        self._drawn = [
            (indices, DistinctSampler(indices.size, size))
            for indices, size in zip(members, self._sizes, strict=True)
            if size
        ]
        if not self._drawn:
            raise ValueError("at least one stratum must have a sample_size above 0")
        self.n_samples = int(every.size)
        self.sample_size = sum(self._sizes)

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{size} of {indices.size}"
            for indices, size in zip(self._members, self._sizes, strict=True)
        )
        return f"{type(self).__name__}({counts})"

    def draw(self, rng: np.random.Generator) -> IndexArray:
        """Return the indices of one sample, stratum after stratum.

        Parameters
        ----------
        rng : numpy.random.Generator
            The source of randomness.

        Returns
        -------
        ndarray of shape (sample_size,)
        """
        return np.concatenate([indices[sampler.draw(rng)] for indices, sampler in self._drawn])

    def sampling(self, inliers: BoolArray) -> Sampling:
        """Return the strata with the number of `inliers` in each.

        Parameters
        ----------
        inliers : ndarray of bool, shape (n_samples,)
            Which measurements agree with the model in hand.

        Returns
        -------
        tuple of Stratum
        """
        return tuple(
            Stratum(int(np.count_nonzero(inliers[indices])), indices.size, size)
            for indices, size in zip(self._members, self._sizes, strict=True)
        )

    @property
    def n_subsets(self) -> int:
        """Different subsets, the product of C(n_j, k_j)."""
        return math.prod(sampler.n_subsets for _, sampler in self._drawn)

    def subset(self, rank: int) -> IndexArray:
        """Return the subset with this number; the last stratum's subset changes fastest.

        Parameters
        ----------
        rank : int
            0 to ``n_subsets - 1``.

        Returns
        -------
        ndarray of shape (sample_size,)

        Raises
        ------
        ValueError
            If `rank` is out of range.
        """
        if not 0 <= rank < self.n_subsets:
            raise ValueError(f"rank must be from 0 to {self.n_subsets - 1}, not {rank}")
        parts = []
        for indices, sampler in reversed(self._drawn):
            rank, digit = divmod(rank, sampler.n_subsets)
            parts.append(indices[sampler.subset(digit)])
        return np.concatenate(parts[::-1])

    def subsets(self) -> Iterator[IndexArray]:
        """Yield every combination of the strata's subsets once, in the order of `subset`."""
        for parts in itertools.product(
            *(itertools.combinations(indices, s.sample_size) for indices, s in self._drawn)
        ):
            yield np.array([index for part in parts for index in part], dtype=np.intp)


def _check_size(n_samples: int, sample_size: int) -> None:
    if not 1 <= sample_size <= n_samples:
        raise ValueError(
            f"sample_size must be from 1 to n_samples = {n_samples}, not {sample_size}"
        )


def _steps(bases: Sequence[int]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Group bases so that the product of each group can bound one random integer."""
    steps: list[tuple[int, tuple[int, ...]]] = []
    bound = 1
    group: list[int] = []
    for base in bases:
        if bound * base > _LARGEST_BOUND:
            steps.append((bound, tuple(group)))
            bound, group = 1, []
        bound *= base
        group.append(base)
    return (*steps, (bound, tuple(group)))


def _unrank(rank: int, n: int, k: int) -> list[int]:
    """Return the k-subset of range(n) with this number in lexicographic order."""
    indices = []
    first = 0
    # Subsets from here on, counted down: those whose smallest index is `first` or more.
    remaining = math.comb(n, k)
    for size in range(k, 0, -1):
        # The smallest index is the last i with at least remaining - rank subsets in range(i, n).
        wanted = remaining - rank
        low, high = first, n - size
        while low < high:
            middle = (low + high + 1) // 2
            if math.comb(n - middle, size) >= wanted:
                low = middle
            else:
                high = middle - 1
        indices.append(low)
        rank -= remaining - math.comb(n - low, size)
        remaining = math.comb(n - low - 1, size - 1)
        first = low + 1
    return indices
