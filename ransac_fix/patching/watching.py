"""What a RANSAC call that is being watched says about itself.

`ransac_fix.trace` sets a `Watched` around each call; what wraps or observes the library's
function tells it the numbers of the run through `note`. Without one `note` does nothing.
"""

import contextlib
import threading

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Literal, TypeAlias

    Sampling: TypeAlias = Literal["distinct", "replacement"]
    Facts: TypeAlias = tuple[int, int, int, float, float | None, float, Sampling, float | None]
    """The arguments of `note`."""

__all__ = ["CURRENT", "Watched", "note", "watching"]


class Watched:
    """One call that is being watched.

    Attributes
    ----------
    exact : bool
        The library is patched here and now: the missing trials are to be drawn.
    raising : bool
        More may be asked of the first run than the program did, as `exact` alone allows it.
    facts : tuple or None
        The arguments of `note` when it was last called: what holds at the end of the run.
    first : tuple or None
        Those when it was first called: what held before any missing trials.
    """

    __slots__ = ("exact", "facts", "first", "raising")

    def __init__(self, exact: bool, *, raising: bool = True) -> None:
        self.exact = exact
        self.raising = exact and raising
        self.facts: Facts | None = None
        self.first: Facts | None = None

    def note(self, facts: "Facts") -> None:
        """Take note of the numbers of a run."""
        self.facts = facts
        if self.first is None:
            self.first = facts


class _Current(threading.local):
    """The call that is being made in this thread, where it is watched; else None.

    No other task can run in the thread until the call returns. A context variable would take
    longer: to set one slows down NumPy, which keeps its error state in another.
    """

    watched: Watched | None = None


CURRENT = _Current()


@contextlib.contextmanager
def watching(watched: Watched) -> "Iterator[Watched]":
    """Watch the call that is made in a block."""
    before = CURRENT.watched
    CURRENT.watched = watched
    try:
        yield watched
    finally:
        CURRENT.watched = before


def note(
    n_inliers: int,
    n_samples: int,
    sample_size: int,
    confidence: float,
    trials: float | None,
    max_trials: float,
    sampling: "Sampling" = "distinct",
    chance: float | None = None,
) -> Watched | None:
    """Tell the numbers of a run to whoever watches the call.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, confidence, trials, max_trials, sampling, chance
        As in `ransac_fix.patching.missing.missing_trials`. Without `trials` the run is taken to
        be what the library's rule asks for with `n_inliers` in hand, up to its limit: that is
        worked out when the program has no need to wait for it.

    Returns
    -------
    Watched or None
        The watched call; None where nobody watches.
    """
    watched = CURRENT.watched
    if watched is not None:
        watched.note(
            (n_inliers, n_samples, sample_size, confidence, trials, max_trials, sampling, chance)
        )
    return watched
