"""Measure an entry point in this process: the controls' tests and a user's own function."""

from typing import Any

from ransac_fix.audit.worker.interface import EntryPoint
from ransac_fix.audit.worker.requests import REQUESTS
from ransac_fix.audit.worker.serve import described


class LocalHost:
    """Answers requests about one entry point without a worker process.

    Parameters
    ----------
    entry_point : EntryPoint
        The function.
    """

    def __init__(self, entry_point: EntryPoint) -> None:
        self._entry_point = entry_point

    @property
    def described(self) -> dict[str, Any]:
        """The entry point in the words of the worker."""
        return described(self._entry_point)

    def ask(self, do: str, **request: Any) -> dict[str, Any]:
        """Answer one request."""
        return REQUESTS[do](self._entry_point, request)
