"""One audit: every probe in its own worker, the controls beside them."""

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ransac_fix.audit.controls import CONTROLS, KINDS, Kind, KnownLaw, controls_for
from ransac_fix.audit.defaults import at_defaults, rule_trials, standard_problems
from ransac_fix.audit.drawing import spread
from ransac_fix.audit.extended import count_trials, decide_by_outcomes, judge_extension
from ransac_fix.audit.host import WorkerFailed, WorkerHost
from ransac_fix.audit.judge import advise, judge
from ransac_fix.audit.measure import (
    SEED,
    Measurement,
    goes_by_outcomes,
    measure,
    sampler_law,
    settings_for,
)
from ransac_fix.audit.model import (
    SCHEMA_VERSION,
    Control,
    Report,
    Verdict,
)
from ransac_fix.errors import RansacFixError
from ransac_fix.systems import find_system, load_systems
from ransac_fix.verdicts import fixed_release

GROUP = "ransac_fix.probes"
_CONTROL_PROBE = Path(__file__).parent / "control_probe.py"
_USER_PROBE = Path(__file__).parent / "user_probe.py"
# A default cap up to this many trials is checked by running into it.
_CHECKED_TRIALS = 5_000
_CHECK_STREAMS = 12
_COUNTED_STREAMS = 3
_LARGEST_CHECK = 60
# Entry points waiting, from which on a second worker for a system is worth its start.
_WORTH_HELPING = 3
_CHECK_SECONDS = 1.0
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
    controls = _Controls(options)
    controls.ask("any")
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
    controls = _Controls(options)
    _Crew([job], options, lambda _: None, controls).work()
    if "-" not in job.done:
        controls.ask("any")
    return _report(job.verdicts(), controls.measured(job.verdicts()), [], started)


def audit_system(
    system: str, options: Options, progress: Callable[[str], object] = lambda _: None
) -> list[Verdict]:
    """Measure one system, one entry point after another and without controls.

    Parameters
    ----------
    system : str
        A system with a probe.
    options : Options
        What to do.
    progress : callable, optional
        As in `audit`.

    Returns
    -------
    list of Verdict
        Empty where the system is not installed; one of entry point ``"-"`` where it could not be
        imported.
    """
    job = _Job(system, probe_files()[system])
    _Crew([job], options, progress).work()
    return job.verdicts()


def _report(
    verdicts: list[Verdict], controls: tuple[Control, ...], missing: list[str], started: float
) -> Report:
    """Put a report together; without a verdict where a control failed."""
    failed = [control.name for control in controls if not control.passed]
    if failed:
        why = f"a control was misidentified ({', '.join(failed)}), so no verdict is given"
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


class _Controls:
    """The known laws that an audit proves itself on, those of each kind measured once.

    Parameters
    ----------
    options : Options
        As for `measure_controls`.
    """

    def __init__(self, options: Options) -> None:
        self._options = options
        self._lock = threading.Lock()
        self._asked: set[Kind] = set()
        self._waiting: deque[Kind] = deque()
        self._found: dict[Kind, tuple[Control, ...]] = {}

    def ask(self, *kinds: Kind) -> None:
        """Have the laws of these kinds measured, unless they were asked for before."""
        with self._lock:
            for kind in set(kinds) - self._asked:
                self._asked.add(kind)
                self._waiting.append(kind)

    def measure_next(self) -> bool:
        """Measure those of one kind that are waiting; whether there were any."""
        try:
            kind = self._waiting.popleft()
        except IndexError:
            return False
        laws = controls_for(kind, quick=self._options.quick)
        self._found[kind] = measure_controls(self._options, laws)
        return True

    def measured(self, verdicts: Iterable[Verdict]) -> tuple[Control, ...]:
        """Return all that was asked for, and what these verdicts rest on besides."""
        if any(verdict.outcomes for verdict in verdicts):
            self.ask("outcomes")
        while self.measure_next():
            pass
        return tuple(control for kind in KINDS for control in self._found.get(kind, ()))


def _kinds(one: dict[str, Any], *, wrapped: bool) -> list[Kind]:
    """Return the kinds of control that the measurement of an entry point rests on."""
    kinds: list[Kind] = ["strata"] if one["n_strata"] > 1 else []
    # The trials of wrapped functions are counted.
    if goes_by_outcomes(one) and not wrapped:
        kinds.append("outcomes")
        if not one["budget"]:
            kinds.append("no budget")
    return kinds


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
        controls: _Controls | None = None,
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
            if self._controls is not None and self._controls.measure_next():
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
        host.allow(max(_DESCRIBE_SECONDS, options.seconds))
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
                if self._controls is not None:
                    self._controls.ask(*_kinds(one, wrapped=wrapped))
                verdict = _audit_entry_point(host, job.system, version, one, options, wrapped)
                if described["refused"]:
                    unpatched = f"Measured as it is: its patch was refused, {described['refused']}."
                    verdict = replace(verdict, advice=f"{unpatched} {verdict.advice}".rstrip())
            except WorkerFailed as why:
                verdict = Verdict(job.system, name, version, "not measured", str(why))
            job.done[name] = verdict
            self._progress(f"{job.system} {name}")
            if not host.alive:
                return True


def _audit_entry_point(
    host: WorkerHost,
    system: str,
    version: str | None,
    one: dict[str, Any],
    options: Options,
    wrapped: bool,
) -> Verdict:
    started = time.monotonic()
    if wrapped and not one["budget"]:
        why = "it takes no number of trials, so that those that it leaves out cannot be counted"
        return Verdict(system, one["name"], version, "not measured", why)
    if wrapped:
        sampler, runs = sampler_law(host, one, SEED)
        counts, more = count_trials(host, one, sampler, SEED + 7000)
        if counts:
            outcomes, again = decide_by_outcomes(host, one, sampler, SEED + 9000)
            verdict, reason, extension = judge_extension(
                counts, sampler, outcomes, counted=one["counted"]
            )
            return Verdict(
                system,
                one["name"],
                version,
                verdict,
                reason,
                sampler_law=sampler,
                runs=runs + more + again,
                seconds=round(time.monotonic() - started, 3),
                extension=extension,
            )
    measured = measure(host, one, verdict_only=options.quick)
    runs = measured.runs
    verdict, reason = judge(measured)
    defaults = None
    advice = ""
    declared = one["defaults"]
    if declared is not None and (measured.points or measured.outcomes or measured.defects):
        checked = None
        if not goes_by_outcomes(one):
            checked, more = _check_defaults(host, one, declared, measured)
            runs += more
        problems = [
            (n, n_inliers, None) for n, n_inliers in standard_problems(measured.sampler.sample_size)
        ]
        defaults = at_defaults(
            declared,
            measured.fit.law,
            measured.sampler,
            [*problems, *options.problems],
            checked,
            one["n_strata"],
        )
        fixed_in = fixed_in_release(system, version, one["name"])
        advice = advise(verdict, defaults, declared["max_trials_name"], fixed_in)
    return Verdict(
        system,
        one["name"],
        version,
        verdict,
        reason,
        advice,
        measured.sampler,
        measured.fit.law,
        defaults,
        measured.points,
        measured.defects,
        measured.outcomes,
        runs,
        round(time.monotonic() - started, 3),
    )


def fixed_in_release(system: str, version: str | None, entry_point: str) -> str | None:
    """Return the first newer release that was measured not to undersample any more.

    Parameters
    ----------
    system, version, entry_point : str
        What is in use; the version of a library that is no release is None.

    Returns
    -------
    str or None
        None where there is none, or none was measured.
    """
    known = next((one for one in load_systems() if one.name == system), None)
    if version is None or known is None or not known.distributions:
        return None
    return fixed_release(known.distributions[0], version, entry_point)


def _check_counts(
    host: WorkerHost, one: dict[str, Any], declared: dict[str, Any], measured: Measurement
) -> tuple[bool | None, int]:
    """Count the trials of runs with nothing set where the minimum binds, and the rule."""
    law, k, n_strata = measured.fit.law, one["sample_size"], one["n_strata"]
    assert law is not None
    fewest, multiplier = declared["min_trials"], declared["multiplier"]
    expected: dict[tuple[int, int], int] = {}
    for n in range(max(2 * k + 6, one["fewest_samples"]), _LARGEST_CHECK):
        for size in range(k + 2, n - 1):
            strata = spread(size, n, n_strata)
            trials = math.ceil(multiplier * rule_trials(law, strata, declared["confidence"]))
            if 2 * trials < fewest:
                expected[n, size] = fewest
            elif 1.3 * fewest < trials < 2 * fewest:
                expected[n, size] = trials
    runs = same = different = 0
    for binds in (True, False):
        chosen = [key for key, trials in expected.items() if (trials == fewest) == binds]
        if not chosen:
            return None, runs
        n, size = chosen[0]
        answer = host.ask(
            "defaults",
            entry_point=one["name"],
            n_samples=n,
            group_size=size,
            n_groups=1,
            strata=[(total, inliers, 0) for inliers, total in spread(size, n, n_strata)],
            trials=expected[n, size],
            # Whether the offset is multiplied, too, is not known.
            tolerance=2 * (1 + multiplier),
            streams=_COUNTED_STREAMS,
            seconds=_CHECK_SECONDS,
            seed=SEED + 5000,
        )
        runs += answer["runs"]
        same, different = same + answer["same"], different + answer["different"]
    return (different == 0 if same + different else None), runs


def _check_defaults(
    host: WorkerHost, one: dict[str, Any], declared: dict[str, Any], measured: Measurement
) -> tuple[bool | None, int]:
    """Run with nothing set where the default cap binds, and see whether it does."""
    law, cap = measured.fit.law, declared["max_trials"]
    if law is None:
        return None, 0
    if one["counted"] and not one["watched"] and declared["min_trials"]:
        return _check_counts(host, one, declared, measured)
    if cap is None or cap > _CHECKED_TRIALS:
        return None, 0
    # B comes after about as many trials as the cap allows; the rule would allow far more.
    setting = settings_for({**one, "typical_trials": cap / 2}, measured.sampler, counted=False)[0]
    strata = tuple((a, n) for n, a, _ in setting.strata) or ((setting.group_size, setting.n),)
    rule = rule_trials(law, strata, declared["confidence"])
    if rule * declared["multiplier"] < 1.5 * cap:
        return None, 0
    answer = host.ask(
        "defaults",
        entry_point=one["name"],
        n_samples=setting.n,
        group_size=setting.group_size,
        n_groups=1,
        strata=setting.strata,
        trials=cap,
        tolerance=0,
        streams=_CHECK_STREAMS,
        seconds=_CHECK_SECONDS,
        seed=SEED + 5000,
    )
    if not answer["same"] + answer["different"]:
        return None, answer["runs"]
    return answer["different"] == 0, answer["runs"]


def measure_controls(
    options: Options, laws: Sequence[KnownLaw] = CONTROLS, seed: int = SEED
) -> tuple[Control, ...]:
    """Measure the known laws.

    Parameters
    ----------
    options : Options
        Its time matters, and `quick`: the controls run in the audit's own environment.
    laws : sequence of KnownLaw, optional
        Which; see `controls_for`.
    seed : int, optional
        Fixes the planted problems and the random streams.

    Returns
    -------
    tuple of Control
    """
    controls: list[Control] = []
    try:
        with WorkerHost(_CONTROL_PROBE, sys.executable, options.seconds) as host:
            described = {one["name"]: one for one in host.ask("describe")["entry_points"]}
            for known in laws:
                host.allow(options.seconds)
                one = described[known.name]
                measured = measure(host, one, seed, verdict_only=options.quick)
                found = measured.fit.law
                controls.append(
                    Control(
                        known.name,
                        f"{known.formula}; {known.drawn}",
                        f"{found.formula if found else 'none'}; {measured.sampler.drawn}",
                        known.recognised(measured),
                        measured.runs,
                    )
                )
    except WorkerFailed as why:
        controls.append(Control("reference", "runs", str(why), False, 0))
    return tuple(controls)


def controls_by_outcomes(verdicts: Iterable[Verdict], options: Options) -> tuple[Control, ...]:
    """Measure the known laws that verdicts by outcomes rest on; none where there are none.

    Parameters
    ----------
    verdicts : iterable of Verdict
        What was measured.
    options : Options
        As for `measure_controls`.

    Returns
    -------
    tuple of Control
    """
    if any(verdict.outcomes for verdict in verdicts):
        # A verdict does not say whether there was a number of trials to set.
        laws = (*controls_for("outcomes", quick=options.quick), *controls_for("no budget"))
        return measure_controls(options, laws)
    return ()
