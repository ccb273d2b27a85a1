"""Bisection of a history for the releases where a verdict changes."""

from collections.abc import Callable, Sequence
from itertools import pairwise

from ransac_fix.audit.releases.model import Release

_UNKNOWN = "not measured"
_ABSENT = "absent"


def bisect(versions: Sequence[str], measure: Callable[[str], Release]) -> list[Release]:
    """Measure as few releases as it takes to pin down each change that shows.

    The ends of the history are measured first. Between two releases that were measured one after
    the other and differ in the verdict on some entry point, or of which one does not have it, the
    one in the middle is measured next, until there is none left between them. So every change that
    is found is narrowed down to two neighbours, in histories that change back and forth, too. What
    changed and changed back between two releases that agree is not found.

    Parameters
    ----------
    versions : sequence of str
        The releases, oldest first.
    measure : callable
        Measures one. Releases that could not be measured are passed over.

    Returns
    -------
    list of Release
        Those measured or tried, oldest first.
    """
    tried: dict[int, Release] = {}

    def verdicts(index: int) -> dict[str, str]:
        return {one.entry_point: one.verdict for one in tried[index].verdicts}

    # The first and the last that can be measured.
    for indices in (range(len(versions)), reversed(range(len(versions)))):
        for index in indices:
            if index not in tried:
                tried[index] = measure(versions[index])
            if any(found != _UNKNOWN for found in verdicts(index).values()):
                break
    while (middle := _next(sorted(tried), verdicts)) is not None:
        tried[middle] = measure(versions[middle])
    return [tried[index] for index in sorted(tried)]


def _next(tried: Sequence[int], verdicts: Callable[[int], dict[str, str]]) -> int | None:
    """Return the untried release nearest to the middle of the first gap in which something changes.

    Parameters
    ----------
    tried : sequence of int
        Positions of the releases tried, in order.
    verdicts : callable
        The verdicts on one of them, by entry point.
    """
    known = {index: verdicts(index) for index in tried}
    for entry_point in dict.fromkeys(name for found in known.values() for name in found):
        states = [
            (index, state)
            for index in tried
            # Of a release that could not be built, not even this is known.
            if known[index] and (state := known[index].get(entry_point, _ABSENT)) != _UNKNOWN
        ]
        for (low, before), (high, after) in pairwise(states):
            if before == after:
                continue
            between = [i for i in range(low + 1, high) if i not in known]
            if between:
                return min(between, key=lambda i: abs(2 * i - low - high))
    return None
