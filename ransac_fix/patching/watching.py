"""What a RANSAC call that is being watched says about itself.

`ransac_fix.trace` sets a `Watched` around each call; what wraps or observes the library's
function tells it the numbers of the run through `note`. Without one `note` does nothing.
"""

from contextvars import ContextVar

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Literal, TypeAlias

    Sampling: TypeAlias = Literal["distinct", "replacement"]
    Facts: TypeAlias = tuple[int, int, int, float, float, float, Sampling, float | None]
    """The arguments of `note`."""

__all__ = ["CURRENT", "Watched", "note"]


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


CURRENT: ContextVar[Watched | None] = ContextVar("ransac_fix watched call", default=None)


def note(
    n_inliers: int,
    n_samples: int,
    sample_size: int,
    confidence: float,
    trials: float,
    max_trials: float,
    sampling: "Sampling" = "distinct",
    chance: float | None = None,
) -> Watched | None:
    """Tell the numbers of a run to whoever watches the call.

    Parameters
    ----------
    n_inliers, n_samples, sample_size, confidence, trials, max_trials, sampling, chance
        As in `ransac_fix.patching.missing.missing_trials`.

    Returns
    -------
    Watched or None
        The watched call; None where nobody watches.
    """
    watched = CURRENT.get()
    if watched is not None:
        watched.facts = (
            n_inliers,
            n_samples,
            sample_size,
            confidence,
            trials,
            max_trials,
            sampling,
            chance,
        )
        if watched.first is None:
            watched.first = watched.facts
    return watched
