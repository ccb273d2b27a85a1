"""Record the RANSAC calls of a program: `trace`, and the same in the processes it starts.

The functions of the supported libraries are replaced by ones that call them, once and with the
same arguments, and read from the result what the run was. Nothing is decided differently: a
library that is not patched stays as it is, one that is stays exact.
"""

import contextlib
import functools
import os
import shutil
import sys
import sysconfig
import tempfile
import threading
import warnings
from collections.abc import Callable
from time import perf_counter
from types import FrameType, ModuleType, TracebackType
from typing import Any, Self

from ransac_fix.errors import PatchNotApplicable, RansacFixError, RansacFixWarning
from ransac_fix.patching import engine, missing, plugins, registry, startup
from ransac_fix.patching.calls import described
from ransac_fix.patching.interface import Replacement
from ransac_fix.patching.recorder import Recorder, merge
from ransac_fix.patching.samples import Drawn, request
from ransac_fix.patching.summary import TraceReport, summarise
from ransac_fix.patching.verification import verify as make_again
from ransac_fix.patching.watching import CURRENT, Watched

__all__ = ["adopt", "collect", "environment", "trace"]

_LOCK = threading.RLock()
_recorder: Recorder | None = None
_placed: list[registry.Place] = []


class trace:  # noqa: N801 -- read as a word: `with ransac_fix.trace() as t:`
    """Record the RANSAC calls made in a block, in all threads and in processes started in it.

    Parameters
    ----------
    verify : int, default 0
        So many of the calls that stopped short are made again with the exact rule once the block
        has ended, in another process, to see how many models were really missed. Their inputs are
        copied to a temporary folder.

    Attributes
    ----------
    report : TraceReport
        What was recorded, once the block has ended.

    Raises
    ------
    RansacFixError
        On entry, if another trace is under way in this process, or ``RANSAC_FIX=0`` is set.

    Notes
    -----
    RANSAC inside a compiled pipeline (a mapper, a matcher) is not visible from Python. Worker
    processes that were started before the block are not seen.

    Examples
    --------
    >>> with trace() as t:
    ...     pass  # what is to be recorded
    >>> t.report.calls
    0
    """

    def __init__(self, *, verify: int = 0) -> None:
        if not (isinstance(verify, int) and verify >= 0):
            raise RansacFixError(f"verify must be a number of calls, not {verify!r}")
        self._verify = int(verify)
        self._report: TraceReport | None = None

    @property
    def report(self) -> TraceReport:
        """What was recorded, once the block has ended."""
        if self._report is None:
            raise RansacFixError("a trace has a report when its block has ended")
        return self._report

    def __enter__(self) -> Self:
        if startup.off():
            raise RansacFixError("RANSAC_FIX=0 is set: nothing can be traced")
        with _LOCK:
            if _recorder is not None:
                raise RansacFixError("a trace is under way in this process already")
            self._folder = tempfile.mkdtemp(prefix="ransac_fix_trace_")
            if self._verify:
                request(self._folder, self._verify)
            self._recorder = Recorder(self._folder, write=False)
            self._pid = os.getpid()
            environment(os.environ, self._folder)
            self._start = perf_counter()
            _set(self._recorder)
        _look()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if os.getpid() != self._pid:  # a fork that leaves the block of its parent
            return
        seconds = perf_counter() - self._start
        with _LOCK:
            _end()
            environment(os.environ, "")
        self._report = collect(self._recorder, seconds, processes=1, verify=self._verify)


def collect(
    recorder: Recorder, seconds: float, *, processes: int = 0, verify: int = 0
) -> TraceReport:
    """Return the report of a recorder and of what is in its folder, which is removed.

    Parameters
    ----------
    recorder : Recorder
        The calls of this process.
    seconds : float
        Time from start to end.
    processes : int, default 0
        1 where this process recorded calls itself.
    verify : int, default 0
        How many calls to make again.
    """
    telling = merge(recorder)
    verified = make_again(recorder.folder, telling, verify) if verify else None
    shutil.rmtree(recorder.folder, ignore_errors=True)
    return summarise(recorder, seconds, processes + len(telling) - 1, verify, verified)


def environment(environ: "os._Environ[str] | dict[str, str]", folder: str) -> None:
    """Change an environment so that processes started with it record their calls.

    Parameters
    ----------
    environ : mutable mapping
        ``os.environ`` or a copy.
    folder : str
        Where they write. Empty: they record no more.
    """
    if folder:
        systems = {
            name: patch.modules
            for name, patch in plugins.discover().patches.items()
            if patch.observe is not None
        }
        environ[startup.TRACE] = f"{folder};{startup.listed(systems)}"
    else:
        environ.pop(startup.TRACE, None)
    startup.environment(environ, startup.parsed(environ.get(startup.WATCH, "")))


def adopt() -> None:
    """Begin to record in a process that was started to be traced."""
    with _LOCK:
        if _recorder is not None:
            return
        _set(Recorder(startup.trace_folder(), write=True))
    _look()


def _set(recorder: Recorder) -> None:
    global _recorder
    _recorder = recorder


def _look() -> None:
    """Watch what is imported already, and what will be. Waits for imports: without the lock."""
    for system in engine.observable():
        engine.observe(system, _arrived)
        with contextlib.suppress(PatchNotApplicable):  # `_arrived` says so
            system.look()
        for name in system.patch.modules:
            module = sys.modules.get(name)
            if module is not None:
                _arrived(system, module)


def _end() -> None:
    global _recorder
    _recorder = None
    for place in reversed(_placed):
        if vars(place.holder).get(place.name) is place.replaced:
            registry.put(place, place.replaced, place.original, copies=True)
    _placed.clear()
    for system in engine.observable():
        engine.observe(system, None)


def _arrived(system: Any, module: ModuleType) -> None:
    """Watch the functions of a library that has been imported. Never raises."""
    recorder = _recorder
    if recorder is None or system.patch.observe is None:
        return
    try:
        replacements = system.patch.observe(module)
    except PatchNotApplicable as error:
        recorder.leave_out(system.name, str(error))
        return
    except (Exception, SystemExit) as error:  # noqa: BLE001 -- may be a stranger's code
        recorder.leave_out(system.name, f"its patch failed with {type(error).__name__}: {error}")
        return
    if system.refusal is not None:
        recorder.leave_out(system.name, system.refusal)
        return
    recorder.know(system.name, exact=system.is_exact, counted=system.patch.counts_trials)

    def put() -> None:
        for replacement in replacements:
            _place(system, replacement)

    engine.place(system, put)


def _place(system: Any, replacement: Replacement) -> None:
    holder, name = replacement.holder, replacement.name
    current: Any = vars(holder).get(name, getattr(holder, name, None))
    if any(place.replaced is current for place in _placed):
        return
    if isinstance(current, staticmethod | classmethod):  # none of the libraries has one
        return
    label = name if isinstance(holder, ModuleType) else f"{holder.__qualname__}.{name}"
    replaced = _watching(current, replacement.exact, system, label)
    place = registry.Place(system.name, holder, name, current, replaced)
    registry.put(place, current, replaced, copies=True)
    _placed.append(place)


def _watching(
    inner: Callable[..., Any], reader: Callable[..., Any], system: Any, function: str
) -> Callable[..., Any]:
    """Return a function that stands for `inner` and records its calls, read by `reader`."""
    active = system.switch.active
    called = system.name, function

    @functools.wraps(inner)
    def call(*args: Any, **kwargs: Any) -> Any:
        recorder = _recorder
        if recorder is None:
            return inner(*args, **kwargs)
        watched = Watched(active())
        samples = recorder.samples
        drawn = None if samples is None else samples.draw(args, kwargs)
        before = CURRENT.watched
        CURRENT.watched = watched
        failed = True
        start = perf_counter()
        try:
            result = reader(*args, **kwargs)
            failed = False
        finally:
            seconds = perf_counter() - start
            CURRENT.watched = before
            _record(recorder, called, watched, seconds, failed, drawn)
        return result

    call.__ransac_fix__ = True  # type: ignore[attr-defined]
    return call


def _record(
    recorder: Recorder,
    called: tuple[str, str],
    watched: Watched,
    seconds: float,
    failed: bool,
    drawn: Drawn | None,
) -> None:
    """Record one call. What goes wrong here is said once and is not the program's affair."""
    try:
        key = called + _call_site(2)
        patched = watched.exact
        # What a patched library leaves out on purpose.
        allowed = missing.slack() if patched else 0.0
        raw = watched.facts, seconds, patched, failed, allowed
        recorder.add(key, raw)
        if recorder.samples is not None and not failed:
            recorder.samples.keep(drawn, key, described(raw, called[0] in recorder.exact))
    except Exception as error:  # noqa: BLE001 -- see above
        warnings.warn(f"a call of {called} was not recorded: {error}", RansacFixWarning, 4)


# Where a program's own code is not: the standard library, installed packages, ransac-fix.
_ELSEWHERE = tuple(
    dict.fromkeys(
        os.path.join(path, "")  # noqa: PTH118 -- a prefix of file names
        for name in ("stdlib", "platstdlib", "purelib", "platlib")
        if (path := sysconfig.get_path(name))
    )
)
_OURS = tuple(
    os.path.join(folder, "")  # noqa: PTH118
    for folder in dict.fromkeys(
        os.path.dirname(os.path.abspath(file))  # noqa: PTH100, PTH120
        for file in (
            startup.__file__,
            getattr(sys.modules.get("ransac_fix.patches"), "__file__", ""),
        )
        if file
    )
)
_DEEPEST = 60
_kinds: dict[str, int] = {}


def _call_site(depth: int) -> tuple[str, int, str]:
    """Return the nearest line of the program's own code, or of what called the library.

    Parameters
    ----------
    depth : int
        How many functions of ours are on the stack: they need not be looked at.
    """
    frame: FrameType | None = sys._getframe(depth + 1)  # noqa: SLF001 -- there is no other way
    nearest: FrameType | None = None
    for _ in range(_DEEPEST):
        if frame is None:
            break
        file = frame.f_code.co_filename
        kind = _kinds.get(file)
        if kind is None:
            kind = _kinds[file] = _kind(file)
        if kind == _PROGRAM:
            nearest = frame
            break
        if kind == _LIBRARY and nearest is None:
            nearest = frame
        frame = frame.f_back
    if nearest is None:
        return "(unknown)", 0, ""
    return nearest.f_code.co_filename, nearest.f_lineno, nearest.f_code.co_qualname


_PROGRAM, _LIBRARY, _OWN = range(3)


def _kind(file: str) -> int:
    if file.startswith(_OURS):
        return _OWN
    return _LIBRARY if file.startswith((*_ELSEWHERE, "<frozen")) else _PROGRAM


def _after_fork() -> None:
    global _LOCK, _recorder  # another thread of the parent may have held it
    _LOCK = threading.RLock()
    if _recorder is not None:
        before = _recorder
        _recorder = Recorder(before.folder, write=True)
        _recorder.exact, _recorder.counted = before.exact, before.counted


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
