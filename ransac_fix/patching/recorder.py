"""Where recorded calls go: sums in memory, and in other processes a file that outlives them.

A worker process may be killed at any moment (a pool ends its workers so), so each call is written
out at once, into a file that is mapped into memory: what has been written there outlives the
process, and takes no call of the system. When the file is full it is summed up in a second one.

The file is a sequence of entries. An entry begins with its kind, a byte that is written last, so
that one which was cut off reads as the end. A call is what `packed` makes of it, with the number
of its call site. All else is JSON text after its length, call sites among it: in the order of
their numbers, each before its first call.
"""

import contextlib
import errno
import json
import mmap
import os
import struct
import threading
from itertools import count
from pathlib import Path
from typing import Any

from ransac_fix.patching.calls import (
    PACKED_SIZE,
    Key,
    Raw,
    Tally,
    described,
    packed,
    unpacked,
)
from ransac_fix.patching.samples import Samples, asked

__all__ = ["Recorder", "merge"]

# Bytes of entries that are summed up together.
_LONGEST = 400_000
# A program has no more call sites, unless it makes code as it runs.
_MOST_SITES = 10_000
_MOST_PENDING = 256
_SUMS, _ENTRIES = ".sums.json", ".entries"
_CALL, _TEXT = 1, 2
_LENGTH = struct.Struct("=I")


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
        self._pending: dict[Key, list[Raw]] = {}
        self._waiting = 0
        self.name = f"{os.getpid()}-{os.urandom(4).hex()}"
        self._part = count(1)
        self._writes = write
        self._entries: mmap.mmap | None = None
        self._written = 0
        # Numbers of the call sites that the file names.
        self._sites: dict[Key, int] = {}
        size = asked(folder)
        self.samples = Samples(folder, self.name, size) if size else None

    def add(self, key: Key, raw: Raw) -> None:
        """Count one call."""
        with self._lock:
            # Worked through later, many at once: between calls of a library it takes longer. Where
            # they are written, that is when the file is full: who reads it works through the rest.
            waiting = self._pending.get(key)
            if waiting is None:
                waiting = self._pending[key] = []
            waiting.append(raw)
            if self._writes:
                self._write_call(key, raw)
            else:
                self._waiting += 1
                if self._waiting >= _MOST_PENDING:
                    self.flush()

    def flush(self) -> None:
        """Work through the calls that are pending."""
        pending, self._pending, self._waiting = self._pending, {}, 0
        self.count(pending)

    def count(self, calls: dict[Key, list[Raw]]) -> None:
        """Add calls to the sums of their call sites."""
        for key, raws in calls.items():
            exact = key[0] in self.exact
            self.tally(key).add([described(raw, exact) for raw in raws])

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
                self._write_text("left out", system, reason)

    def know(self, system: str, *, exact: bool, counted: bool) -> None:
        """Keep what is known of a library: its rule is exact, it says what it ran."""
        with self._lock:
            for names, is_so in ((self.exact, exact), (self.counted, counted)):
                if is_so:
                    names.add(system)
            if self._writes:
                self._write_text("library", system, exact, counted)

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
        self._path = f"{self.folder}/{self.name}.{next(self._part)}{_ENTRIES}"
        with open(self._path, "x+b", buffering=0) as file:  # noqa: PTH123 -- closed below
            # All of it at once: writing to a mapping of what the disk has no room for is fatal.
            if file.write(bytes(_LONGEST)) != _LONGEST:
                raise OSError(errno.ENOSPC, "the disk is full")
            entries = mmap.mmap(file.fileno(), _LONGEST)
        self._entries, self._written = entries, 0
        return entries

    def _write_call(self, key: Key, raw: Raw) -> None:
        site = self._sites.get(key)
        if site is None:
            site = len(self._sites)
            if not self._write_text("site", *key):
                return
            self._sites[key] = site
        self._write(_CALL, packed(site, raw))

    def _write_text(self, *values: object) -> bool:
        text = json.dumps(values).encode()
        return self._write(_TEXT, _LENGTH.pack(len(text)) + text)

    def _write(self, kind: int, entry: bytes) -> bool:
        """Write an entry, and return whether it is there.

        It is not where the file was full: what it says has been counted before, and is part of
        the sums.
        """
        try:
            entries = self._entries or self._open()
            start = self._written + 1
            end = start + len(entry)
            if end >= len(entries):
                self._sum_up()
                return False
            entries[start:end] = entry
            entries[start - 1] = kind
            self._written = end
        except OSError:  # the trace is over and its folder gone, or the disk is full
            self._writes = False
        return self._writes

    def _sum_up(self) -> None:
        """Put all sums so far into a file in place of the entries."""
        assert self._entries is not None
        self._entries.close()
        self._entries = None
        self._sites.clear()
        path = f"{self.folder}/{self.name}{_SUMS}"
        new = Path(f"{path}.new")
        # The entries they stand for are named: a reader that finds both counts them once.
        part = self._path.removesuffix(_ENTRIES).rpartition(".")[2]
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
    for path in sorted(Path(recorder.folder).glob(f"*{_ENTRIES}")):
        name, _, part = path.name.removesuffix(_ENTRIES).rpartition(".")
        before = recorder.telling
        if int(part) > through.get(name, 0):
            _read(recorder, path.read_bytes())
        telling[name] = telling.get(name, 0) + recorder.telling - before
    return telling


def _read(recorder: Recorder, entries: bytes) -> None:
    """Count the calls of a file."""
    sites: list[Key] = []
    calls: dict[Key, list[Raw]] = {}
    offset = 0
    while offset < len(entries) and (kind := entries[offset]):
        offset += 1
        if kind == _CALL:
            site, raw = unpacked(entries, offset)
            calls.setdefault(sites[site], []).append(raw)
            offset += PACKED_SIZE
            continue
        (length,) = _LENGTH.unpack_from(entries, offset)
        offset += _LENGTH.size
        about, *values = json.loads(entries[offset : offset + length])
        offset += length
        if about == "site":
            sites.append(_key(values))
        elif about == "library":
            system, exact, counted = values
            recorder.know(system, exact=exact, counted=counted)
        else:
            recorder.leave_out(*values)
    recorder.count(calls)


def _key(data: list[Any]) -> Key:
    system, function, file, line, name = data
    return system, function, file, line, name
