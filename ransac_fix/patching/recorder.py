"""Where recorded calls go: sums in memory, and in other processes a file that outlives them.

A worker process may be killed at any moment (a pool ends its workers so), so each call is written
out at once, as one line. When the lines grow long they are summed up in a second file.
"""

import contextlib
import json
import os
import threading
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

from ransac_fix.patching.calls import Key, Raw, Tally, described

__all__ = ["Recorder", "merge"]

# Lines are summed up when a file is as long as this.
_LONGEST = 4_000_000
# A program has no more call sites, unless it makes code as it runs.
_MOST_SITES = 10_000
_MOST_PENDING = 256
_SUMS, _LINES = ".sums.json", ".lines"


class Recorder:
    """The calls of one process.

    Parameters
    ----------
    folder : str
        Where other processes write, and this one too with `write`.
    write : bool
        Write every call to the folder, for another process to read.
    """

    def __init__(self, folder: str, *, write: bool) -> None:
        self.folder = folder
        self.tallies: dict[Key, Tally] = {}
        self.left_out: dict[str, str] = {}
        self.exact: set[str] = set()
        self.counted: set[str] = set()
        self._lock = threading.Lock()
        self._pending: list[tuple[Key, Raw]] = []
        self._name = f"{os.getpid()}-{os.urandom(4).hex()}"
        self._part = count(1)
        self._writes = write
        self._file: int | None = None
        self._written = 0

    def add(self, key: Key, raw: Raw) -> None:
        """Count one call."""
        with self._lock:
            # Worked through later, many at once: between calls of a library it takes longer.
            self._pending.append((key, raw))
            if self._writes:
                self._write(["call", key, raw])
            if len(self._pending) >= _MOST_PENDING:
                self.flush()

    def flush(self) -> None:
        """Work through the calls that are pending."""
        pending, self._pending = self._pending, []
        for key, raw in pending:
            self.tally(key).add(described(raw))

    def tally(self, key: Key) -> Tally:
        """Return the sums of one call site."""
        tally = self.tallies.get(key)
        if tally is None:
            if len(self.tallies) >= _MOST_SITES:
                key = (*key[:2], "(further call sites)", 0, "")
            tally = self.tallies.setdefault(key, Tally())
        return tally

    def leave_out(self, system: str, reason: str) -> None:
        """Say why the calls of a library are not seen."""
        with self._lock:
            self.left_out[system] = reason
            if self._writes:
                self._write(["left out", system, reason])

    def know(self, system: str, *, exact: bool, counted: bool) -> None:
        """Keep what is known of a library: its rule is exact, it says what it ran."""
        with self._lock:
            for names, is_so in ((self.exact, exact), (self.counted, counted)):
                if is_so:
                    names.add(system)
            if self._writes:
                self._write(["library", system, [exact, counted]])

    def to_data(self) -> dict[str, Any]:
        """Return all sums as plain data, for a file."""
        self.flush()
        return {
            "tallies": [[key, tally.to_data()] for key, tally in self.tallies.items()],
            "left_out": self.left_out,
            "exact": sorted(self.exact),
            "counted": sorted(self.counted),
        }

    def _open(self) -> None:
        self._path = f"{self.folder}/{self._name}.{next(self._part)}{_LINES}"
        self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        self._written = 0

    def _write(self, line: list[object]) -> None:
        try:
            if self._file is None:
                self._open()
            assert self._file is not None
            self._written += os.write(self._file, json.dumps(line).encode() + b"\n")
            if self._written > _LONGEST:
                self._sum_up()
        except OSError:  # the trace is over and its folder gone, or the disk is full
            self._writes = False

    def _sum_up(self) -> None:
        """Put all sums so far into a file in place of the lines."""
        assert self._file is not None
        os.close(self._file)
        self._file = None
        path = f"{self.folder}/{self._name}{_SUMS}"
        new = Path(f"{path}.new")
        # The lines they stand for are named: a reader that finds both counts them once.
        part = self._path.removesuffix(_LINES).rpartition(".")[2]
        new.write_text(json.dumps({**self.to_data(), "through": int(part)}))
        new.replace(path)
        with contextlib.suppress(OSError):
            Path(self._path).unlink()


def merge(recorder: Recorder) -> int:
    """Add to a recorder what the other processes wrote into its folder.

    Returns
    -------
    int
        How many processes there were.
    """
    recorder.flush()
    through: dict[str, int] = {}
    processes = set()
    for path in sorted(Path(recorder.folder).glob(f"*{_SUMS}")):
        name = path.name.removesuffix(_SUMS)
        data = json.loads(path.read_text())
        through[name] = data["through"]
        for key, tally in data["tallies"]:
            recorder.tally(_key(key)).merge(Tally.from_data(tally))
        recorder.left_out.update(data["left_out"])
        recorder.exact.update(data["exact"])
        recorder.counted.update(data["counted"])
        processes.add(name)
    for path in sorted(Path(recorder.folder).glob(f"*{_LINES}")):
        name, _, part = path.name.removesuffix(_LINES).rpartition(".")
        processes.add(name)
        if int(part) > through.get(name, 0):
            with path.open() as lines:
                for line in lines:
                    if line.endswith("\n"):  # the last one may have been cut off
                        kind, about, value = json.loads(line)
                        _READ[kind](recorder, about, value)
    return len(processes)


def _key(data: list[Any]) -> Key:
    system, function, file, line, name = data
    return system, function, file, line, name


def _read_call(recorder: Recorder, key: Any, raw: Any) -> None:
    facts, *others = raw
    recorder.tally(_key(key)).add(described((facts and tuple(facts), *others)))


def _read_left_out(recorder: Recorder, system: Any, reason: Any) -> None:
    recorder.left_out[system] = reason


def _read_library(recorder: Recorder, system: Any, known: Any) -> None:
    for names, is_so in zip((recorder.exact, recorder.counted), known, strict=True):
        if is_so:
            names.add(system)


_READ: dict[str, Callable[[Recorder, Any, Any], None]] = {
    "call": _read_call,
    "left out": _read_left_out,
    "library": _read_library,
}
