"""What `ransac_fix.status` returns."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["INHERITANCE", "PatchingStatus", "State", "SystemStatus"]

State = Literal[
    "patched",
    "already exact",
    "waiting",
    "refused",
    "off",
    "switched off",
    "not installed",
    "broken",
]
"""What can be said of a system.

patched: in force, as far as the other fields say. already exact: nothing was changed. waiting:
asked for, the library is not imported yet. refused: of an unknown shape, left as it is. off: not
asked for. switched off: ``RANSAC_FIX=0``. not installed. broken: the patch itself failed.
"""

INHERITANCE = (
    "`with patched():` and the drop-ins hold in the thread or async task that entered them and in"
    " async tasks started there, until the block ends. Threads started inside the block and"
    " joblib or multiprocessing workers do not inherit them: `patched(threads=True)` covers all"
    " threads of this process, `ransac-fix run` and `import ransac_fix.auto` cover worker"
    " processes too, and the drop-ins work in both, for they enter their block inside the call."
)


@dataclass(frozen=True, slots=True)
class SystemStatus:
    """One system's patch.

    Attributes
    ----------
    system : str
        The system's name.
    state : str
        See `State`.
    reason : str
        Why it is so, in one sentence; empty where there is nothing to add.
    version : str or None
        The imported or installed release.
    checked : bool
        Whether that release is one the patch was tried on.
    sites : tuple of str
        Full names of the replaced functions that stand in place now.
    process_wide : bool
        In force in every thread, by `patch` or ``patched(threads=True)``.
    here : bool
        In force in the calling thread or task.
    scopes : int
        Blocks and drop-in calls under way, in any thread, that are not process-wide.
    """

    system: str
    state: State
    reason: str
    version: str | None
    checked: bool
    sites: tuple[str, ...]
    process_wide: bool
    here: bool
    scopes: int

    def __str__(self) -> str:
        name = f"{self.system} {self.version}" if self.version else self.system
        parts: list[str] = [self.state]
        if self.state == "patched":
            if self.process_wide:
                parts.append("in every thread")
            elif self.here:
                parts.append("in this thread or task only")
            else:
                parts.append("in other threads or tasks only")
        if self.reason:
            parts.append(self.reason)
        return f"{name}: {', '.join(parts)}"


@dataclass(frozen=True, slots=True)
class PatchingStatus:
    """All systems that have a patch, and how far patches reach.

    Attributes
    ----------
    systems : tuple of SystemStatus
        By name.
    worker_processes : bool
        Whether processes started from here are patched from their start.
    inheritance : str
        Who inherits a patch, in words.
    """

    systems: tuple[SystemStatus, ...]
    worker_processes: bool
    inheritance: str = INHERITANCE

    def __str__(self) -> str:
        workers = "are" if self.worker_processes else "are not"
        lines = [str(system) for system in self.systems]
        lines.append(f"Processes started from here {workers} patched from their start.")
        lines.append(self.inheritance)
        return "\n".join(lines)
