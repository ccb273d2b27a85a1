"""Asking whoever runs a library: a worker process, or this one."""

from typing import Any, Protocol


class Asked(Protocol):
    """Whoever runs the library."""

    def ask(self, do: str, **request: Any) -> dict[str, Any]:
        """Answer one request; see `ransac_fix.audit.worker.serve`."""


class Looks:
    """Requests about one entry point, and how many runs they took.

    Parameters
    ----------
    host : Asked
        Runs the library.
    name : str
        The entry point.
    seed : int
        Fixes the planted problems.
    """

    def __init__(self, host: Asked, name: str, seed: int) -> None:
        self._host, self._name, self._seed = host, name, seed
        self.runs = 0

    def _ask(self, do: str, **request: Any) -> dict[str, Any]:
        answer = self._host.ask(do, entry_point=self._name, **request)
        self.runs += answer["runs"]
        return answer
