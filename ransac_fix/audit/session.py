"""One audit: every probe in its own worker, the controls beside them."""

import os
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ransac_fix.audit import plan
from ransac_fix.audit.controls import CONTROLS
from ransac_fix.audit.defaults import at_defaults, rule_trials, standard_problems
from ransac_fix.audit.host import WorkerFailed, WorkerHost
from ransac_fix.audit.judge import advise, judge
from ransac_fix.audit.measure import SEED, measure
from ransac_fix.audit.model import (
    SCHEMA_VERSION,
    Control,
    Report,
    StoppingLaw,
    Verdict,
)
from ransac_fix.errors import RansacFixError
from ransac_fix.systems import find_system, load_systems

GROUP = "ransac_fix.probes"
_CONTROL_PROBE = Path(__file__).parent / "control_probe.py"
# A default cap up to this many trials is checked by running into it.
_CHECKED_TRIALS = 5_000
_CHECK_STREAMS = 12
_CHECK_SECONDS = 1.0


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
        is imported; how a patched library is measured.
    preparable : frozenset of str
        The systems that `prepare` is called for; the others are measured as they are.
    problems : tuple of (n, I, s)
        Where to state guarantees besides the standard problems; s None for the default.
    """

    systems: tuple[str, ...]
    python: str
    seconds: float = 60.0
    prepare: str | None = None
    preparable: frozenset[str] = frozenset()
    problems: tuple[tuple[int, int, float | None], ...] = ()


def audit(options: Options, progress: Callable[[str], object] = lambda _: None) -> Report:
    """Measure the installed systems.

    Parameters
    ----------
    options : Options
        What to do.
    progress : callable, optional
        Called with the name of each system once it is done, from several threads.

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
    probes = _chosen(options.systems)
    with ThreadPoolExecutor(max(2, os.cpu_count() or 1)) as pool:
        controls_running = pool.submit(measure_controls, options)
        running = {
            name: pool.submit(_audit_system, name, file, options)
            for name, file in sorted(probes.items(), key=lambda item: _slowest_first(item[0]))
        }
        verdicts: list[Verdict] = []
        missing: list[str] = []
        for name in probes:
            result = running[name].result()
            progress(name)
            if result is None and options.systems:
                result = [Verdict(name, "-", None, "not measured", "not installed")]
            if result is None:
                missing.append(name)
            else:
                verdicts += result
        controls = controls_running.result()
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


def _chosen(names: Iterable[str]) -> dict[str, Path]:
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
    """Put the systems that take longest to import first, so that no worker waits at the end."""
    order = ("kornia", "scikit-learn", "scikit-image", "opencv")
    return order.index(name) if name in order else len(order)


def _audit_system(name: str, file: Path, options: Options) -> list[Verdict] | None:
    """Return the verdicts on one system, None where it is not installed."""
    verdicts: list[Verdict] = []
    done: set[str] = set()
    while True:
        try:
            with WorkerHost(file, options.python, options.seconds) as host:
                described = host.ask(
                    "describe", prepare=options.prepare if name in options.preparable else None
                )
                if not described["installed"]:
                    return None
                version = described["version"]
                for one in described["entry_points"]:
                    if one["name"] in done:
                        continue
                    done.add(one["name"])
                    if "unmeasured" in one:
                        verdicts.append(
                            Verdict(name, one["name"], version, "not measured", one["unmeasured"])
                        )
                        continue
                    host.allow(options.seconds)
                    try:
                        verdicts.append(_audit_entry_point(host, name, version, one, options))
                    except WorkerFailed as why:
                        verdicts.append(
                            Verdict(name, one["name"], version, "not measured", str(why))
                        )
                        if not host.alive:
                            break
                else:
                    return verdicts
        except WorkerFailed as why:
            # The worker did not even come up.
            return [*verdicts, Verdict(name, "-", None, "not measured", str(why))]


def _audit_entry_point(
    host: WorkerHost, system: str, version: str, one: dict[str, Any], options: Options
) -> Verdict:
    started = time.monotonic()
    measured = measure(host, one)
    runs = measured.runs
    if not measured.points:
        reasons = "; ".join(f"{why} ({times} streams)" for why, times in measured.discarded.items())
        return Verdict(
            system,
            one["name"],
            version,
            "not measured",
            f"no stream showed the rule: {reasons}",
            sampler_law=measured.sampler,
            runs=runs,
            seconds=round(time.monotonic() - started, 3),
        )
    verdict, reason = judge(measured.fit, measured.sampler, measured.points)
    defaults = None
    advice = ""
    declared = one["defaults"]
    if declared is not None:
        checked, more = _check_defaults(host, one, declared, measured.fit.law)
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
        )
        fixed_in = find_system(system).fixed_in if verdict == "undersamples" else None
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
        tuple(measured.points),
        runs,
        round(time.monotonic() - started, 3),
    )


def _check_defaults(
    host: WorkerHost, one: dict[str, Any], declared: dict[str, Any], law: StoppingLaw | None
) -> tuple[bool | None, int]:
    """Run with nothing set where the default cap binds, and see whether it does."""
    cap = declared["max_trials"]
    if law is None or cap is None or cap > _CHECKED_TRIALS:
        return None, 0
    # B comes after about as many trials as the cap allows; the rule would allow far more.
    setting = plan.settings(
        one["sample_size"], cap / 2, spare=one["spare"], fewest=one["fewest_samples"]
    )[0]
    rule = rule_trials(law, setting.group_size, setting.n, declared["confidence"])
    if rule * declared["multiplier"] < 1.5 * cap:
        return None, 0
    answer = host.ask(
        "defaults",
        entry_point=one["name"],
        n_samples=setting.n,
        group_size=setting.group_size,
        n_groups=1,
        trials=cap,
        streams=_CHECK_STREAMS,
        seconds=_CHECK_SECONDS,
        seed=SEED + 5000,
    )
    return answer["different"] == 0, answer["runs"]


def measure_controls(options: Options, seed: int = SEED) -> tuple[Control, ...]:
    """Measure the known laws.

    Parameters
    ----------
    options : Options
        Only the time matters: the controls run in the audit's own environment.
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
            for known in CONTROLS:
                host.allow(options.seconds)
                measured = measure(host, described[known.name], seed)
                found = measured.fit.law
                controls.append(
                    Control(
                        known.name,
                        f"{known.formula}; {known.drawn}",
                        f"{found.formula if found else 'none'}; {measured.sampler.drawn}",
                        known.recognised(measured.fit, measured.sampler),
                        measured.runs,
                    )
                )
    except WorkerFailed as why:
        controls.append(Control("reference", "runs", str(why), False, 0))
    return tuple(controls)
