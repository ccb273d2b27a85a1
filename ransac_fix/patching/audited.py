"""Patch a library for the audit, in the process that measures it."""

import math
from collections.abc import Callable
from typing import Any

from ransac_fix.patching import missing
from ransac_fix.patching.calls import judge
from ransac_fix.patching.engine import patch, status
from ransac_fix.patching.plugins import discover
from ransac_fix.patching.watching import Watched, watching

__all__ = ["counted", "patch_for_audit"]

Counting = Callable[..., dict[str, Any] | None]


def patch_for_audit(system: str) -> Callable[[], tuple[Counting | None, str]]:
    """Patch a system with a slack of 0, and return what to ask once its library is imported.

    Parameters
    ----------
    system : str
        Its name.

    Returns
    -------
    callable
        Gives `counted` where the functions are wrapped, so that missing trials are drawn on
        fresh samples and no point of the rule lies on one random stream; None where the rule
        itself can be measured, exact already or replaced. And why the library runs as it is,
        where its patch was refused; empty else.
    """
    missing.set_slack(0.0)
    patch(system)

    def how() -> tuple[Counting | None, str]:
        one = next(one for one in status().systems if one.system == system)
        wraps = one.state == "patched" and discover().patches[system].wraps
        refused = one.state in ("refused", "broken")
        return counted if wraps else None, one.reason if refused else ""

    return how


def counted(call: Callable[[], object], *, exact: bool = True) -> dict[str, Any] | None:
    """Make one call, and return how many trials it came to.

    Parameters
    ----------
    call : callable
        Calls a wrapped function once.
    exact : bool, default True
        False: the missing trials are not drawn, for comparison.

    Returns
    -------
    dict or None
        The fields of `ransac_fix.audit.model.TrialCount`. None where the call was passed through.
    """
    watched = Watched(exact)
    with watching(watched):
        call()
    if watched.first is None or watched.facts is None:
        return None
    first, last = judge(*watched.first, False), judge(*watched.facts, False)
    _, n_samples, sample_size, confidence, _, limit, _, _ = watched.facts
    return {
        "n_samples": int(n_samples),
        "n_inliers": last.n_inliers,
        "sample_size": sample_size,
        "confidence": float(confidence),
        "own": _finite(first.trials),
        "first_inliers": first.n_inliers,
        "trials": _finite(last.trials),
        "required": _finite(last.needed),
        "limit": _finite(limit),
    }


def _finite(value: float) -> int | None:
    return int(value) if math.isfinite(value) else None
