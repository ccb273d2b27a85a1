"""Which of the planted models runs return, where a run cannot be repeated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ransac_fix.audit.worker.interface import Settings
from ransac_fix.audit.worker.planted import plant

if TYPE_CHECKING:
    from ransac_fix.audit.worker.interface import EntryPoint


def outcomes(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Count what independent runs return, each on a planted problem of its own.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    request : dict
        ``cases``: list of ``[n_samples, group_size, n_groups, max_trials, confidence, runs]``,
        and ``seed``. The larger group has one measurement more than ``group_size``.

    Returns
    -------
    dict
        ``counts``: one list a case, of the runs that returned the larger model, one of the
        smaller ones, and neither; and ``runs``.
    """
    counts = []
    seed = request["seed"]
    for n_samples, size, n_groups, max_trials, confidence, runs in request["cases"]:
        larger = smaller = 0
        for _ in range(runs):
            planted = plant(entry_point.problem, n_samples, size, n_groups, size + 1, seed)
            outcome = entry_point.run(planted, Settings(max_trials, confidence), seed)
            group = planted.group_of(outcome.inliers)
            larger += group == n_groups
            smaller += group is not None and group < n_groups
            seed += 1
        counts.append([larger, smaller, runs - larger - smaller])
    return {"counts": counts, "runs": seed - request["seed"]}
