"""How runs end that nothing but their rule could end: with the first model found, or later."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from ransac_fix.audit.worker.planted import evenly, plant
from ransac_fix.audit.worker.streams import LARGEST_CONFIDENCE, Stream, first_true

if TYPE_CHECKING:
    from ransac_fix.audit.worker.interface import EntryPoint


def endings(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Count the runs at the highest confidence that end with the smaller of two groups.

    Any rule lets such a run go on to the larger group. The run whose trials are counted ended
    with the first group if one trial less finds none; another if each larger budget leaves it
    with the same group as the smallest budget that finds one.

    Parameters
    ----------
    entry_point : EntryPoint
        A function whose runs repeat.
    request : dict
        ``n_samples``, ``group_size``, ``budget`` (in which the larger group is all but surely
        found), ``wanted`` (runs that end so), ``streams`` and ``seconds`` (to try at most) and
        ``seed``.

    Returns
    -------
    dict
        ``first``: the runs that ended with the smaller group and as soon as it was found;
        ``later``: those that found a group and went on, at which the count ends; ``runs``.
    """
    first = later = runs = 0
    n, size, budget = request["n_samples"], request["group_size"], request["budget"]
    strata = evenly(n, size, size + 1, entry_point.n_strata)
    started = time.monotonic()
    for seed in range(request["seed"], request["seed"] + request["streams"]):
        if time.monotonic() - started > request["seconds"]:
            break
        planted = plant(entry_point.problem, n, size, 1, size + 1, seed, strata=strata)
        stream = Stream(entry_point, planted, seed)
        outcome = stream.run(budget, LARGEST_CONFIDENCE)
        group = planted.group_of(outcome.inliers)
        if group is not None:
            if outcome.trials is not None:
                before = outcome.trials - 1
                at_once = before == 0 or stream.group(before, LARGEST_CONFIDENCE) is None
            else:
                at_once = _first_group(stream, budget) == group
            first += at_once and group != stream.label_b
            later += not at_once
        runs += stream.runs
        if later or first >= request["wanted"]:
            break
    return {"first": first, "later": later, "runs": runs}


def _first_group(stream: Stream, largest: int) -> int | None:
    """Return the group in hand after the first trial that finds one."""
    trials = first_true(
        lambda budget: stream.group(budget, LARGEST_CONFIDENCE) is not None, largest
    )
    return None if trials is None else stream.group(trials, LARGEST_CONFIDENCE)
