"""Folders for environments, cleared of what a run that was killed has left in them.

A run holds a lock on its folder while it lives, and the system takes it back however the run ends.
What no run holds is not whole. Where there are no such locks (Windows) nothing is cleared.
"""

import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # pragma: no cover -- Windows
    fcntl = None  # type: ignore[assignment]

# In an environment that is not yet whole.
INCOMPLETE = "incomplete"


@contextmanager
def scratch_folder(parent: Path, prefix: str) -> Iterator[Path]:
    """Give a new folder that is gone afterwards, and delete those of runs that were killed.

    Parameters
    ----------
    parent : Path
        Where to make it.
    prefix : str
        How its name begins.
    """
    for folder in parent.glob(f"{prefix}*"):
        lock = folder.with_name(f"{folder.name}.lock")
        if folder.is_dir() and (not lock.exists() or _is_free(lock)):
            shutil.rmtree(folder, ignore_errors=True)
            lock.unlink(missing_ok=True)
    folder = parent / f"{prefix}{uuid.uuid4().hex[:8]}"
    lock = folder.with_name(f"{folder.name}.lock")
    # The lock first: a folder without one belongs to nobody.
    with lock.open("w") as held:
        _lock(held, shared=False)
        folder.mkdir()
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
            lock.unlink(missing_ok=True)


@contextmanager
def kept_folder(folder: Path) -> Iterator[Path]:
    """Give a folder that stays, and delete what is not whole in it, unless another run is using it.

    Parameters
    ----------
    folder : Path
        The folder of the environments; made if need be.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = folder / ".lock"
    if not lock.exists() or _is_free(lock):
        broken = [one.parent for one in folder.glob(f"*/{INCOMPLETE}")]
        for one in (*broken, *folder.glob("shared/*.part")):
            shutil.rmtree(one, ignore_errors=True)
    with lock.open("w") as held:
        _lock(held, shared=True)
        yield folder


def _lock(held: IO[str], *, shared: bool) -> None:
    if fcntl is not None:
        fcntl.flock(held, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)


def _is_free(lock: Path) -> bool:
    """Whether no run holds a lock."""
    if fcntl is None:
        return False
    with lock.open("w") as tried:
        try:
            fcntl.flock(tried, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
    return True
