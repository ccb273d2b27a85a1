"""The controls of an audit: known laws that it measures in the same run, to prove that it can."""

import sys
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ransac_fix.audit.controls import KINDS, Kind, KnownLaw, controls_for
from ransac_fix.audit.host import WorkerFailed, WorkerHost
from ransac_fix.audit.measure import goes_by_outcomes, measure
from ransac_fix.audit.model import Control, OutcomeEvidence, Verdict

_CONTROL_PROBE = Path(__file__).parent / "control_probe.py"


class Controls:
    """The known laws that the measurements of one run rest on, those of each kind measured once.

    Parameters
    ----------
    seconds : float
        Time one of them may take.
    quick : bool, default False
        Whether few runs matter; see `controls_for`.
    """

    def __init__(self, seconds: float, *, quick: bool = False) -> None:
        self._seconds = seconds
        self._quick = quick
        self._lock = threading.Lock()
        self._asked: set[Kind] = set()
        self._waiting: deque[Kind] = deque()
        self._found: dict[Kind, tuple[Control, ...]] = {}

    def ask(self, kinds: Iterable[Kind]) -> None:
        """Have the laws of these kinds measured, unless they were asked for before."""
        with self._lock:
            new = [kind for kind in kinds if kind not in self._asked]
            self._asked.update(new)
            self._waiting.extend(new)

    def measure_next(self) -> bool:
        """Measure those of one kind that are waiting; whether there were any."""
        try:
            kind = self._waiting.popleft()
        except IndexError:
            return False
        laws = controls_for(kind, quick=self._quick)
        self._found[kind] = measure_controls(laws, self._seconds, verdict_only=self._quick)
        return True

    def measured(self, verdicts: Iterable[Verdict]) -> tuple[Control, ...]:
        """Return all that was asked for, and what these verdicts rest on besides.

        Parameters
        ----------
        verdicts : iterable of Verdict
            Those of the report, also such as were kept from another run.

        Returns
        -------
        tuple of Control
            By kind; none where nothing was measured.
        """
        for verdict in verdicts:
            self.ask(_kinds_behind(verdict))
        while self.measure_next():
            pass
        return tuple(control for kind in KINDS for control in self._found.get(kind, ()))


def kinds_for(one: dict[str, Any], *, wrapped: bool) -> list[Kind]:
    """Return the kinds of control that the measurement of an entry point rests on.

    Parameters
    ----------
    one : dict
        The entry point as described by the worker.
    wrapped : bool
        Whether a patch wraps the library: then its trials are counted.
    """
    kinds: list[Kind] = ["any"]
    if one["n_strata"] > 1:
        kinds.append("strata")
    if goes_by_outcomes(one) and not wrapped:
        kinds.append("outcomes")
        if not one["budget"]:
            kinds.append("no budget")
    return kinds


def _kinds_behind(verdict: Verdict) -> list[Kind]:
    """Return the kinds of control that a verdict rests on, by its evidence."""
    if verdict.verdict == "not measured":
        return []
    kinds: list[Kind] = ["any"]
    defaults = verdict.at_defaults
    if any(point.strata for point in verdict.points) or (defaults and defaults.n_strata > 1):
        kinds.append("strata")
    if verdict.outcomes is not None:
        kinds.append("outcomes")
        if _is_without_budget(verdict.outcomes):
            kinds.append("no budget")
    return kinds


def _is_without_budget(seen: OutcomeEvidence) -> bool:
    """Whether the function takes no number of trials: then runs of one show the share found.

    Those with a fixed number of trials have several, so that some find the larger group.
    """
    return any(one.confidence is None and one.max_trials == 1 for one in seen.counts)


def measure_controls(
    laws: Sequence[KnownLaw], seconds: float, *, verdict_only: bool = False
) -> tuple[Control, ...]:
    """Measure known laws, in the audit's own environment.

    Parameters
    ----------
    laws : sequence of KnownLaw
        Which; see `controls_for`.
    seconds : float
        Time one of them may take.
    verdict_only : bool, default False
        As in `measure`.

    Returns
    -------
    tuple of Control
        One for each law; where their worker failed the last says so, and has not passed.
    """
    controls: list[Control] = []
    try:
        with WorkerHost(_CONTROL_PROBE, sys.executable, seconds) as host:
            described = {one["name"]: one for one in host.ask("describe")["entry_points"]}
            for known in laws:
                host.allow(seconds)
                measured = measure(host, described[known.name], verdict_only=verdict_only)
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


def objection(controls: Iterable[Control]) -> str:
    """Say why no verdict can be given where a control failed; empty where none did."""
    failed = ", ".join(control.name for control in controls if not control.passed)
    return f"a control was misidentified ({failed}), so no verdict is given" if failed else ""
