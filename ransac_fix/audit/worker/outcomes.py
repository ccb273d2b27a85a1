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


def dispersion(entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
    """Count what independent runs on one and the same problem return, for several problems.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    request : dict
        ``case``: ``[n_samples, group_size, n_groups, max_trials, confidence]``, ``problems``,
        ``runs`` on each, and ``seed``.

    Returns
    -------
    dict
        ``counts``: of each problem, the runs that returned a smaller model, and the larger one;
        and ``runs``.
    """
    n_samples, size, n_groups, max_trials, confidence = request["case"]
    settings = Settings(max_trials, confidence)
    counts = []
    for seed in range(request["seed"], request["seed"] + request["problems"]):
        planted = plant(entry_point.problem, n_samples, size, n_groups, size + 1, seed)
        groups = [
            planted.group_of(entry_point.run(planted, settings, number).inliers)
            for number in range(request["runs"])
        ]
        smaller = sum(group is not None and group < n_groups for group in groups)
        counts.append([smaller, groups.count(n_groups)])
    return {"counts": counts, "runs": request["problems"] * request["runs"]}
