"""Keep the inputs of some recorded calls, so that they can be made again with the exact rule.

Each process keeps a uniform sample (reservoir sampling) of its calls that stopped short while
their limits allowed more trials: of those alone a model can have been missed. Inputs are copied
before the call, which may change them, and go to a file each at once, since a pool may end its
workers at any time; nothing stays in memory, and what they take on disk is bounded.
"""

import io
import json
import pickle
import random
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any

from ransac_fix.patching.calls import Key, Record, is_telling

__all__ = ["Drawn", "Samples", "Unkept", "asked", "kept", "request"]

SUFFIX = ".call"
_REQUEST = "verify"
# Inputs of one call, and of all that one process keeps.
_LARGEST = 32_000_000
_LARGEST_TOGETHER = 256_000_000
_PLAIN = (bool, int, float, str, bytes, type(None))


class Unkept(Exception):  # noqa: N818 -- a reason, in the words of a report
    """The inputs of a call could not be kept; the text says why."""


def request(folder: str, sample_size: int) -> None:
    """Ask all processes that write into a folder to keep so many calls."""
    Path(folder, _REQUEST).write_text(str(sample_size))


def asked(folder: str) -> int:
    """Return how many calls the processes that write into a folder are to keep."""
    try:
        return int(Path(folder, _REQUEST).read_text())
    except (OSError, ValueError):
        return 0


@dataclass(frozen=True, slots=True)
class Drawn:
    """A call that was drawn: its place, its inputs, and why they could not be copied."""

    place: int
    inputs: bytes
    why: str


class Samples:
    """The calls that one process keeps.

    Parameters
    ----------
    folder, name : str
        Where their files go, and what their names begin with.
    sample_size : int
        How many to keep.
    """

    def __init__(self, folder: str, name: str, sample_size: int) -> None:
        self._folder = folder
        self._name = name
        self._size = sample_size
        self._seen = 0
        self._bytes: dict[int, int] = {}
        self._lock = threading.Lock()
        # Not the program's generator.
        self._random = random.Random()  # noqa: S311 -- not for secrets

    def draw(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Drawn | None:
        """Copy the inputs of a call about to be made, where it is drawn: chances are the same.

        Returns
        -------
        Drawn or None
            For `keep`.
        """
        with self._lock:
            place = self._random.randrange(self._seen + 1)
        if place >= self._size:
            return None
        try:
            return Drawn(place, packed((args, kwargs)), "")
        except Unkept as why:
            return Drawn(place, b"", str(why))

    def keep(self, drawn: Drawn | None, key: Key, record: Record) -> None:
        """Count a call that has been made if it is a telling one, and keep it if it was drawn."""
        if not is_telling(record):
            return
        with self._lock:
            seen, self._seen = self._seen, self._seen + 1
            if drawn is not None:
                # The first ones fill the places, whatever other threads have drawn meanwhile.
                self._write(seen if seen < self._size else drawn.place, key, drawn)

    def _write(self, place: int, key: Key, drawn: Drawn) -> None:
        self._bytes.pop(place, None)
        inputs, why = drawn.inputs, drawn.why
        if sum(self._bytes.values()) + len(inputs) > _LARGEST_TOGETHER:
            inputs, why = b"", f"one process keeps no more than {_LARGEST_TOGETHER / 1e6:.0f} MB"
        self._bytes[place] = len(inputs)
        head = json.dumps({"key": key, "why": why, "path": sys.path}).encode()
        path = Path(self._folder, f"{self._name}.{place}{SUFFIX}")
        new = path.with_suffix(".new")
        try:
            new.write_bytes(head + b"\n" + inputs)
            new.replace(path)
        except OSError:  # the trace is over and its folder gone, or the disk is full
            self._size = 0


def kept(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return what a file says of its call, and the inputs."""
    head, _, payload = path.read_bytes().partition(b"\n")
    return json.loads(head), payload


def packed(value: object) -> bytes:
    """Return a copy of inputs as bytes.

    Raises
    ------
    Unkept
        Where something in it cannot be copied, or it is too large.
    """
    buffer = _Limited()
    try:
        _Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL).dump(value)
    except _OfMain:
        # Only what a program defines in its main module must be taken by value.
        import cloudpickle

        try:
            data: bytes = cloudpickle.dumps(value)
        except Exception as error:
            raise Unkept(_because(error)) from error
        if len(data) > _LARGEST:
            raise Unkept(_TOO_LARGE) from None
        return data
    except Unkept:
        raise
    except Exception as error:
        raise Unkept(_because(error)) from error
    return buffer.getvalue()


_TOO_LARGE = f"its inputs take more than {_LARGEST / 1e6:.0f} MB"


def _because(error: Exception) -> str:
    return f"its inputs cannot be copied: {' '.join(str(error).split())[:100]}"


class _OfMain(Exception):  # noqa: N818 -- not an error
    """Something is defined in the program's main module, which is not there when it is read."""


class _Limited(io.BytesIO):
    def write(self, data: Any, /) -> int:
        if self.tell() + memoryview(data).nbytes > _LARGEST:
            raise Unkept(_TOO_LARGE)
        return super().write(data)


class _Pickler(pickle.Pickler):
    """Takes objects of compiled libraries too that hold nothing but public values."""

    def reducer_override(self, value: Any) -> Any:
        kind = value if isinstance(value, type) else type(value)
        if kind.__module__ == "__main__" or getattr(value, "__module__", "") == "__main__":
            raise _OfMain
        if isinstance(value, (type, FunctionType, BuiltinFunctionType)):
            return NotImplemented
        try:
            value.__reduce_ex__(pickle.HIGHEST_PROTOCOL)
        except TypeError:
            kind()  # it must be possible to make another
            names = [name for name in dir(value) if not name.startswith("_")]
            values = {name: getattr(value, name, None) for name in names}
            state = {name: held for name, held in values.items() if _is_value(held, kind)}
            return _rebuilt, (kind, state)
        return NotImplemented


def _is_value(held: object, kind: type) -> bool:
    if isinstance(held, _PLAIN):
        return held is not None
    module = type(held).__module__.partition(".")[0]
    return not callable(held) and module in ("numpy", kind.__module__.partition(".")[0])


def _rebuilt(kind: type, state: dict[str, Any]) -> object:
    value = kind()
    for name, held in state.items():
        setattr(value, name, held)
    return value
