"""What can be asked of a function, by name: each answers one request with JSON-ready data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ransac_fix.audit.worker.endings import endings
from ransac_fix.audit.worker.outcomes import dispersion, outcomes
from ransac_fix.audit.worker.streams import defaults, hits, larger, points, trials

if TYPE_CHECKING:
    from collections.abc import Callable

    from ransac_fix.audit.worker.interface import EntryPoint

REQUESTS: dict[str, Callable[[EntryPoint, dict[str, Any]], dict[str, Any]]] = {
    "points": points,
    "hits": hits,
    "larger": larger,
    "trials": trials,
    "defaults": defaults,
    "endings": endings,
    "outcomes": outcomes,
    "dispersion": dispersion,
}
