"""One audit: every probe in its own worker, the controls beside them."""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ransac_fix.audit.examination import examine
from ransac_fix.audit.host import WorkerFailed, WorkerHost
from ransac_fix.audit.model import SCHEMA_VERSION, Control, Report, Verdict
from ransac_fix.audit.proof import Controls, kinds_for, objection
from ransac_fix.errors import RansacFixError
from ransac_fix.systems import find_system, load_systems

GROUP = "ransac_fix.probes"
_USER_PROBE = Path(__file__).parent / "user_probe.py"
# Entry points waiting, from which on a second worker for a system is worth its start.
_WORTH_HELPING = 3
# Importing a library, or compiling a driver for it, once, on a busy machine.
_DESCRIBE_SECONDS = 300.0


@dataclass(frozen=True, slots=True)
class Options:
    """What an audit is asked to do.

    Parameters
    ----------
    systems : tuple of str
        Names to audit; none for every system with a probe.
    python : str
        Interpreter of the environment to measure.
    seconds : float
        Time one entry point may take.
    prepare : str or None
        ``"module:function"``, called with the system's name in each worker before the library
        is imported; how a patched library is measured. It returns a function that gives, once the
        library is imported, what counts the trials of its wrapped functions, or None, and why
        its patch was refused, or nothing: see `ransac_fix.patching.audited`.
    preparable : frozenset of str
        The systems that `prepare` is called for; the others are measured as they are.
    problems : tuple of (n, I, s)
        Where to state guarantees besides the standard problems; s None for the default.
    quick : bool
        Measure one entry point of each system only, the one users call most, and runs that show
        nothing but outcomes only until the verdict is settled.
    entry_points : tuple of str
        Shell patterns: measure only the entry points whose name matches one; none for all.
    """

    systems: tuple[str, ...]
    python: str
    seconds: float = 60.0
    prepare: str | None = None
    preparable: frozenset[str] = frozenset()
    problems: tuple[tuple[int, int, float | None], ...] = ()
    quick: bool = False
    entry_points: tuple[str, ...] = ()


def audit(options: Options, progress: Callable[[str], object] = lambda _: None) -> Report:
    """Measure the installed systems.

    Parameters
    ----------
    options : Options
        What to do.
    progress : callable, optional
        Called with the name of each entry point once it is done, from several threads.

    Returns
    -------
    Report
        Where a control failed every verdict is ``not measured``.

    Raises
    ------
    RansacFixError
        If a name is unknown or its system has no probe.
    """
    started = time.monotonic()
    jobs = [_Job(system, file) for system, file in chosen_probes(options.systems).items()]
    controls = Controls(options.seconds, quick=options.quick)
    crew = _Crew(jobs, options, progress, controls)
    with ThreadPoolExecutor(max(2, os.cpu_count() or 1)) as pool:
        members = [pool.submit(crew.work) for _ in range(max(2, os.cpu_count() or 1))]
        for member in members:
            member.result()
    verdicts: list[Verdict] = []
    missing: list[str] = []
    for job in crew.jobs:
        if job.installed:
            verdicts += job.verdicts()
        elif options.systems:
            verdicts.append(Verdict(job.system, "-", None, "not measured", "not installed"))
        else:
            missing.append(job.system)
    return _report(verdicts, controls.measured(verdicts), missing, started)


def audit_function(arguments: Sequence[str], options: Options) -> Report:
    """Measure a user's own function.

    Parameters
    ----------
    arguments : sequence of str
        Those of `ransac_fix.audit.user_probe`.
    options : Options
        Its time and interpreter matter.

    Returns
    -------
    Report
        With one verdict; its entry point is ``"-"`` where the function could not be wrapped.
    """
    started = time.monotonic()
    job = _Job("your own", _USER_PROBE, tuple(arguments))
    controls = Controls(options.seconds, quick=options.quick)
    _Crew([job], options, lambda _: None, controls).work()
    return _report(job.verdicts(), controls.measured(job.verdicts()), [], started)


def audit_system(
    system: str,
    options: Options,
    controls: Controls,
    progress: Callable[[str], object] = lambda _: None,
) -> list[Verdict]:
    """Measure one system, one entry point after another.

    Parameters
    ----------
    system : str
        A system with a probe.
    options : Options
        What to do.
    controls : Controls
        Those of the run, of which the ones that the measurements rest on are asked for.
    progress : callable, optional
        As in `audit`.

    Returns
    -------
    list of Verdict
        Empty where the system is not installed; one of entry point ``"-"`` where it could not be
        imported.
    """
    job = _Job(system, probe_files()[system])
    _Crew([job], options, progress, controls).work()
    return job.verdicts()


def _report(
    verdicts: list[Verdict], controls: tuple[Control, ...], missing: list[str], started: float
) -> Report:
    """Put a report together; without a verdict where a control failed."""
    why = objection(controls)
    if why:
        verdicts = [replace(v, verdict="not measured", reason=why, advice="") for v in verdicts]
    return Report(
        SCHEMA_VERSION,
        tuple(verdicts),
        controls,
        tuple(missing),
        sum(v.runs for v in verdicts) + sum(c.runs for c in controls),
        round(time.monotonic() - started, 2),
    )


def probe_files() -> dict[str, Path]:
    """Return the file of every probe installed, by system. Nothing is imported but packages."""
    files = {}
    for entry_point in entry_points(group=GROUP):
        spec = None
        # The package that declares a probe may have gone without its metadata.
        with suppress(ImportError):
            spec = find_spec(entry_point.module)
        if spec is not None and spec.origin is not None:
            files[entry_point.name] = Path(spec.origin)
    order = {system.name: index for index, system in enumerate(load_systems())}
    return dict(sorted(files.items(), key=lambda item: (order.get(item[0], 999), item[0])))


def chosen_probes(names: Iterable[str]) -> dict[str, Path]:
    """Return the probes of these systems, or all of them if none is named.

    Raises
    ------
    RansacFixError
        If a name is unknown or its system has no probe.
    """
    files = probe_files()
    if not names:
        return files
    chosen = {}
    for name in names:
        system = name if name in files else find_system(name).name
        if system not in files:
            raise RansacFixError(
                f"there is no probe for {system}: probes exist for {', '.join(files)}"
            )
        chosen[system] = files[system]
    return chosen


def _slowest_first(name: str) -> int:
    """Put the systems that take longest first, so that no worker waits at the end."""
    order = (
        *("opencv", "opengv", "kornia", "gc-ransac", "magsac"),
        *("kornia-rs", "open3d", "scikit-learn", "theia", "scikit-image"),
    )
    return order.index(name) if name in order else len(order)


def _longest_first(one: dict[str, Any]) -> tuple[bool, int]:
    """Put entry points that take longest first: thousands of runs, then large samples."""
    if "unmeasured" in one:
        return True, 0
    return one["repeatable"] or one["counted"], -one["sample_size"]


class _Job:
    """The entry points of one system: those to do, and the verdicts on those done."""

    def __init__(self, system: str, file: Path, arguments: tuple[str, ...] = ()) -> None:
        self.system = system
        self.file = file
        self.arguments = arguments
        self.installed = True
        self.order: list[str] | None = None
        self.waiting: deque[dict[str, Any]] = deque()
        self.done: dict[str, Verdict] = {}

    def fill(self, described: dict[str, Any], options: Options) -> None:
        """Take over what the first worker says of the system."""
        listed = described["entry_points"]
        if options.entry_points:
            listed = [
                one
                for one in listed
                if any(fnmatchcase(one["name"], pattern) for pattern in options.entry_points)
            ]
        if options.quick:
            listed = [one for one in listed if "unmeasured" not in one][:1] or listed[:1]
        if not listed:
            known = (
                "none of the entry points asked for" if options.entry_points else "no entry point"
            )
            why = f"the probe finds {known} in this release"
            version = described["version"]
            self.done["-"] = Verdict(self.system, "-", version, "not measured", why)
        self.order = [one["name"] for one in listed]
        self.waiting.extend(sorted(listed, key=_longest_first))

    def verdicts(self) -> list[Verdict]:
        """Return the verdicts in the order of the probe."""
        order = [*(self.order or []), "-"]
        return [self.done[name] for name in order if name in self.done]


class _Crew:
    """Threads that each drive one worker process at a time, until nothing is left to measure.

    Every system is begun by one of them; those that find none left help with the longest queue.
    Controls that a measurement turns out to rest on go first.
    """

    def __init__(
        self,
        jobs: list[_Job],
        options: Options,
        progress: Callable[[str], object],
        controls: Controls,
    ) -> None:
        self.jobs = jobs
        self._controls = controls
        self._unbegun = deque(sorted(self.jobs, key=lambda job: _slowest_first(job.system)))
        self._options = options
        self._progress = progress
        self._lock = threading.Lock()

    def work(self) -> None:
        """Measure until nothing is left to begin or to help with."""
        while True:
            if self._controls.measure_next():
                continue
            with self._lock:
                job = self._unbegun.popleft() if self._unbegun else None
                if job is None:
                    job = max(self.jobs, key=lambda job: len(job.waiting))
                    if len(job.waiting) < _WORTH_HELPING:
                        return
            self._drive(job)

    def _drive(self, job: _Job) -> None:
        """Run workers for one system until its queue is empty, a new one after each crash."""
        while True:
            try:
                python, seconds = self._options.python, self._options.seconds
                with WorkerHost(job.file, python, seconds, job.arguments) as host:
                    if not self._serve(job, host):
                        return
            except WorkerFailed as why:
                # The worker did not even come up.
                if job.order is None:
                    verdict = Verdict(job.system, "-", None, "not measured", str(why))
                    job.done["-"] = verdict
                return

    def _serve(self, job: _Job, host: WorkerHost) -> bool:
        """Measure with one worker; whether it died and another is needed."""
        options = self._options
        prepared = job.system in options.preparable
        # To import a library takes long on a cold disk; to describe a user's function runs it.
        host.allow(options.seconds if job.arguments else max(_DESCRIBE_SECONDS, options.seconds))
        described = host.ask("describe", prepare=options.prepare if prepared else None)
        if not described["installed"]:
            job.installed = False
            return False
        with self._lock:
            if job.order is None:
                job.fill(described, options)
        while True:
            try:
                one = job.waiting.popleft()
            except IndexError:
                return False
            host.allow(options.seconds)
            name, version = one["name"], described["version"]
            try:
                if "unmeasured" in one:
                    raise WorkerFailed(one["unmeasured"])
                wrapped = described["wrapped"]
                self._controls.ask(kinds_for(one, wrapped=wrapped))
                verdict = examine(
                    host,
                    job.system,
                    version,
                    one,
                    options.problems,
                    wrapped=wrapped,
                    quick=options.quick,
                )
                if described["refused"]:
                    unpatched = f"Measured as it is: its patch was refused, {described['refused']}."
                    verdict = replace(verdict, advice=f"{unpatched} {verdict.advice}".rstrip())
            except WorkerFailed as why:
                verdict = Verdict(job.system, name, version, "not measured", str(why))
            job.done[name] = verdict
            self._progress(f"{job.system} {name}")
            if not host.alive:
                return True
