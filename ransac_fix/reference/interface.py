"""What the loop asks of a model, of a sampler and of a stopping rule."""

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from ransac_fix.criterion import Sampling

FloatArray: TypeAlias = npt.NDArray[np.float64]
IndexArray: TypeAlias = npt.NDArray[np.intp]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

StoppingRule: TypeAlias = Callable[[int, int, int, float], int | float]
"""``rule(n_inliers, n_samples, sample_size, confidence)``: trials required, or ``math.inf``.

`ransac_fix.required_trials` and `ransac_fix.approximate_required_trials` are two.
"""

M = TypeVar("M")


class Model(Protocol[M]):
    """A geometric model with a minimal solver.

    `M` is the type of one fitted model; the models of this package are arrays. `data` is always
    an array of shape (number of measurements, columns), one measurement a row.
    """

    @property
    def sample_size(self) -> int:
        """Measurements in a minimal sample, k."""

    def solve(self, sample: FloatArray, /) -> Sequence[M]:
        """Return every model through a minimal sample, none for a degenerate one.

        Parameters
        ----------
        sample : ndarray of shape (sample_size, columns)
            The measurements of the sample.
        """

    def residuals(self, model: M, data: FloatArray, /) -> FloatArray:
        """Return the residual of every measurement, shape (n,), not negative.

        NaN and infinity are allowed and never count as inliers.
        """

    def refit(self, data: FloatArray, /) -> M | None:
        """Return the model that fits all of `data` best, None where there is none."""


class Sampler(Protocol):
    """A source of minimal samples; `draw` is all that a sampler must have."""

    def draw(self, rng: np.random.Generator, /) -> IndexArray:
        """Return the indices of one minimal sample, shape (sample_size,)."""


@runtime_checkable
class KnownSampler(Protocol):
    """A sampler that states its law, so that the loop can choose the exact rule for it."""

    def draw(self, rng: np.random.Generator, /) -> IndexArray:
        """Return the indices of one minimal sample, shape (sample_size,)."""

    def sampling(self, inliers: BoolArray, /) -> Sampling:
        """Return the `sampling` argument of `ransac_fix.required_trials` for these inliers."""


@runtime_checkable
class SubsetSampler(KnownSampler, Protocol):
    """A sampler that draws uniformly from finitely many subsets and can number them.

    The loop can then try each of them once.
    """

    @property
    def n_subsets(self) -> int:
        """How many different subsets there are."""

    def subset(self, rank: int, /) -> IndexArray:
        """Return the subset with this number, 0 to ``n_subsets - 1``."""

    def subsets(self) -> Iterator[IndexArray]:
        """Yield every subset once, in the order of their numbers."""
