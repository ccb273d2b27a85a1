"""Where recorded calls go: sums in memory, and in other processes a file that outlives them.

A worker process may be killed at any moment (a pool ends its workers so), so each call is written
out at once, as one line in a file that is mapped into memory: what has been written there outlives
the process, and takes no call of the system. When the file is full it is summed up in a second one.
"""

import contextlib
import errno
import json
import marshal
import mmap
import os
import threading
from binascii import a2b_base64, b2a_base64
from collections.abc import Callable
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any

from ransac_fix.patching.calls import Key, Raw, Tally, described
from ransac_fix.patching.samples import Samples, asked

__all__ = ["Recorder", "merge"]

# Bytes of lines that are summed up together.
_LONGEST = 1_000_000
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
        self.name = f"{os.getpid()}-{os.urandom(4).hex()}"
        self._part = count(1)
        self._writes = write
        self._lines: mmap.mmap | None = None
        self._written = 0
        size = asked(folder)
        self.samples = Samples(folder, self.name, size) if size else None

    def add(self, key: Key, raw: Raw) -> None:
        """Count one call."""
        with self._lock:
            # Worked through later, many at once: between calls of a library it takes longer. Where
            # they are written, that is when the file is full: who reads it works through the rest.
            self._pending.append((key, raw))
            if self._writes:
                # Several times as quick as JSON. Version 2 is read by every Python.
                numbers = b2a_base64(marshal.dumps(raw, 2), newline=False)
                self._write(b'["call",%b,"%b"]' % (_as_json(key), numbers))
            elif len(self._pending) >= _MOST_PENDING:
                self.flush()

    def flush(self) -> None:
        """Work through the calls that are pending."""
        pending, self._pending = self._pending, []
        sites: dict[Key, list[Raw]] = {}
        for key, raw in pending:
            sites.setdefault(key, []).append(raw)
        for key, raws in sites.items():
            self.tally(key).add(list(map(described, raws)))

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
                self._write(json.dumps(["left out", system, reason]).encode())

    def know(self, system: str, *, exact: bool, counted: bool) -> None:
        """Keep what is known of a library: its rule is exact, it says what it ran."""
        with self._lock:
            for names, is_so in ((self.exact, exact), (self.counted, counted)):
                if is_so:
                    names.add(system)
            if self._writes:
                self._write(json.dumps(["library", system, [exact, counted]]).encode())

    @property
    def telling(self) -> int:
        """How many of the calls counted can have missed a model."""
        return sum(tally.telling for tally in self.tallies.values())

    def to_data(self) -> dict[str, Any]:
        """Return all sums as plain data, for a file."""
        self.flush()
        return {
            "tallies": [[key, tally.to_data()] for key, tally in self.tallies.items()],
            "left_out": self.left_out,
            "exact": sorted(self.exact),
            "counted": sorted(self.counted),
        }

    def _open(self) -> mmap.mmap:
        self._path = f"{self.folder}/{self.name}.{next(self._part)}{_LINES}"
        with open(self._path, "x+b", buffering=0) as file:  # noqa: PTH123 -- closed below
            # All of it at once: writing to a mapping of what the disk has no room for is fatal.
            if file.write(bytes(_LONGEST)) != _LONGEST:
                raise OSError(errno.ENOSPC, "the disk is full")
            lines = mmap.mmap(file.fileno(), _LONGEST)
        self._lines, self._written = lines, 0
        return lines

    def _write(self, text: bytes) -> None:
        """Write a line. What it says has been counted before: it may be part of the sums."""
        try:
            lines = self._lines or self._open()
            line = text + b"\n"
            end = self._written + len(line)
            if end > len(lines):
                self._sum_up()
            else:
                lines[self._written : end] = line
                self._written = end
        except OSError:  # the trace is over and its folder gone, or the disk is full
            self._writes = False

    def _sum_up(self) -> None:
        """Put all sums so far into a file in place of the lines."""
        assert self._lines is not None
        self._lines.close()
        self._lines = None
        path = f"{self.folder}/{self.name}{_SUMS}"
        new = Path(f"{path}.new")
        # The lines they stand for are named: a reader that finds both counts them once.
        part = self._path.removesuffix(_LINES).rpartition(".")[2]
        new.write_text(json.dumps({**self.to_data(), "through": int(part)}))
        new.replace(path)
        with contextlib.suppress(OSError):
            Path(self._path).unlink()


def merge(recorder: Recorder) -> dict[str, int]:
    """Add to a recorder what the other processes wrote into its folder.

    Returns
    -------
    dict
        For each of these processes, and this one, how many calls can have missed a model: what
        its sample was drawn from.
    """
    recorder.flush()
    through: dict[str, int] = {}
    telling = {recorder.name: recorder.telling}

    for path in sorted(Path(recorder.folder).glob(f"*{_SUMS}")):
        name = path.name.removesuffix(_SUMS)
        before = recorder.telling
        data = json.loads(path.read_text())
        through[name] = data["through"]
        for key, tally in data["tallies"]:
            recorder.tally(_key(key)).merge(Tally.from_data(tally))
        recorder.left_out.update(data["left_out"])
        recorder.exact.update(data["exact"])
        recorder.counted.update(data["counted"])
        telling[name] = telling.get(name, 0) + recorder.telling - before
    for path in sorted(Path(recorder.folder).glob(f"*{_LINES}")):
        name, _, part = path.name.removesuffix(_LINES).rpartition(".")
        before = recorder.telling
        if int(part) > through.get(name, 0):
            written = path.read_bytes().partition(b"\0")[0]
            for line in written.split(b"\n")[:-1]:  # the last one may have been cut off
                kind, about, value = json.loads(line)
                _READ[kind](recorder, about, value)
        telling[name] = telling.get(name, 0) + recorder.telling - before
    return telling


@lru_cache(maxsize=1024)
def _as_json(key: Key) -> bytes:
    return json.dumps(key).encode()


def _key(data: list[Any]) -> Key:
    system, function, file, line, name = data
    return system, function, file, line, name


def _read_call(recorder: Recorder, key: Any, numbers: Any) -> None:
    recorder.tally(_key(key)).add([described(marshal.loads(a2b_base64(numbers)))])  # noqa: S302


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
