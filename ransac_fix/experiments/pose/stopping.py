"""The trial at which a stopping rule first ends a run, found from outside."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Stop:
    """Where a rule ended a run.

    Parameters
    ----------
    trials : int
        The smallest number of trials that is enough for the inliers in hand after them.
    capped : bool
        Whether the cap, not the rule, ended it.
    """

    trials: int
    capped: bool


def first_stop(
    inliers_after: Callable[[int], int],
    trials_for: Callable[[int], float],
    cap: int,
    *,
    start: int = 1,
) -> Stop:
    """Return the smallest m in `start` to `cap` with ``m >= trials_for(inliers_after(m))``.

    Parameters
    ----------
    inliers_after : callable
        Inliers of the best model after that many trials, which never become fewer.
    trials_for : callable
        Trials the rule asks for with that many inliers in hand, which never become more;
        infinite where no number is enough.
    cap : int
        Trials after which a run ends in any case.
    start : int, default 1
        Trials before which the rule is known not to be met.
    """
    low, high = start - 1, max(start, min(16, cap))
    while True:
        needed = trials_for(inliers_after(high))
        if high >= needed:
            break
        if high >= cap:
            return Stop(cap, capped=True)
        low = high
        # Not further than the inliers in hand ask for, and not at once as far: more may come.
        high = int(min(needed, 4 * high, cap))
    while high - low > 1:
        needed = trials_for(inliers_after(high))
        if needed >= high:  # fewer trials hold no more inliers, so they are not enough
            break
        middle = int(needed) if needed > low else (low + high) // 2
        if middle >= trials_for(inliers_after(middle)):
            high = middle
        else:
            low = middle
    return Stop(high, capped=False)
