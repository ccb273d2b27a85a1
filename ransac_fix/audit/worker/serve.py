"""The worker's loop: one JSON request a line in, one JSON answer a line out."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import json
import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe, Settings, Unmeasured
from ransac_fix.audit.worker.planted import plant
from ransac_fix.audit.worker.requests import REQUESTS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import TextIO


def load_probe(probe_file: Path) -> Probe:
    """Run a probe's file and return its ``PROBE``. No library is imported by that."""
    spec = importlib.util.spec_from_file_location("ransac_fix_probe", probe_file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{probe_file} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    probe: Probe = module.PROBE
    return probe


class Worker:
    """Answers the requests about one library.

    Parameters
    ----------
    probe_file : Path
        The file that ends in ``PROBE``.
    """

    def __init__(self, probe_file: Path) -> None:
        self.probe = load_probe(probe_file)
        self.entry_points: dict[str, EntryPoint] = {}
        # Makes a call of a wrapped function and counts its trials.
        self.counted: Callable[..., dict[str, Any] | None] | None = None

    def describe(self, request: dict[str, Any]) -> dict[str, Any]:
        """Import the library and name its entry points."""
        how: Callable[[], Any] | None = None
        if request.get("prepare"):
            where, function = request["prepare"].split(":")
            how = getattr(importlib.import_module(where), function)(self.probe.system)
        if self.probe.one_cpu and hasattr(os, "sched_setaffinity"):
            allowed = sorted(os.sched_getaffinity(0))
            os.sched_setaffinity(0, {allowed[os.getpid() % len(allowed)]})
        library = self._library()
        if library is None:
            return {"system": self.probe.system, "installed": False}
        listed = self.probe.entry_points(library)
        self.counted, refused = (None, "") if how is None else how()
        self.entry_points = {one.name: one for one in listed if isinstance(one, EntryPoint)}
        return {
            "system": self.probe.system,
            "installed": True,
            "version": self._version(library),
            "wrapped": self.counted is not None,
            "refused": refused,
            "entry_points": [described(one) for one in listed],
        }

    def _library(self) -> Any:
        """Import the library, or find it by the probe's own means; None if not installed."""
        if self.probe.find is not None:
            return self.probe.find()
        try:
            return importlib.import_module(self.probe.module)
        except ModuleNotFoundError as missing:
            if missing.name and self.probe.module.split(".")[0] == missing.name.split(".")[0]:
                return None
            raise

    def _version(self, library: object) -> str | None:
        if self.probe.find is None and not self.probe.distributions:
            return None
        for distribution in self.probe.distributions:
            try:
                return importlib.metadata.version(distribution)
            except importlib.metadata.PackageNotFoundError:
                continue
        return str(getattr(library, "__version__", "unknown"))

    def extended(self, entry_point: EntryPoint, request: dict[str, Any]) -> dict[str, Any]:
        """Run a wrapped function on planted problems: count its trials, and what it returns.

        ``cases`` are lists ``[n_samples, group_size, n_groups, strata, max_trials, confidence,
        runs]``, strata as for `plant`; ``seed`` is that of the first problem; without ``exact``
        the missing trials are not drawn.
        """
        assert self.counted is not None
        counts, returned = [], []
        seed = request["seed"]
        for n_samples, size, n_groups, strata, max_trials, confidence, runs in request["cases"]:
            settings = Settings(max_trials, confidence)
            smaller = larger = 0
            for _ in range(runs):
                shape = n_samples, size, n_groups, size + 1, seed
                planted = plant(entry_point.problem, *shape, strata=strata)
                found: list[Outcome] = []
                count = self.counted(
                    lambda planted=planted, seed=seed, found=found, settings=settings: found.append(
                        entry_point.run(planted, settings, seed)
                    ),
                    exact=request["exact"],
                )
                if count is not None:
                    counts.append(count)
                group = planted.group_of(found[0].inliers)
                larger += group == n_groups
                smaller += group is not None and group < n_groups
                seed += 1
            returned.append([smaller, larger])
        return {"counts": counts, "returned": returned, "runs": seed - request["seed"]}

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Answer one request."""
        what = request["do"]
        if what == "describe":
            return self.describe(request)
        entry_point = self.entry_points[request["entry_point"]]
        if what == "extended":
            return self.extended(entry_point, request)
        return REQUESTS[what](entry_point, request)


def described(one: EntryPoint | Unmeasured) -> dict[str, Any]:
    """Return what the audit needs to know of an entry point before it asks."""
    if isinstance(one, Unmeasured):
        return {"name": one.name, "unmeasured": one.reason}
    return {
        "name": one.name,
        "problem": one.problem,
        "sample_size": one.sample_size,
        "counted": one.counted,
        "seeded": one.seeded,
        "repeatable": one.repeatable,
        "typical_trials": one.typical_trials,
        "fewest_samples": one.fewest_samples,
        "spare": one.spare,
        "verifying": one.verifying,
        "size_seen": one.size_seen,
        "budget": one.budget,
        "n_strata": one.n_strata,
        "watched": one.draws is not None,
        "defaults": None if one.defaults is None else vars(one.defaults),
    }


def serve(probe_file: Path, requests: Iterable[str], answers: TextIO) -> None:
    """Answer requests until there are no more.

    Parameters
    ----------
    probe_file : Path
        The probe.
    requests : iterable of str
        JSON lines.
    answers : text file
        Gets one JSON line a request: the answer, or ``{"error": ...}``.
    """

    def send(message: dict[str, Any]) -> None:
        answers.write(json.dumps(message) + "\n")
        answers.flush()

    try:
        worker = Worker(probe_file)
    except Exception as error:  # noqa: BLE001 -- whatever a probe raises is the answer
        send({"error": _one_line(error)})
        return
    send({"ready": True})
    for line in requests:
        try:
            send(worker.answer(json.loads(line)))
        except Exception as error:  # noqa: BLE001 -- whatever a library raises is the answer
            # Of a library, the line is nobody's to mend.
            place = _place(error) if worker.probe.system == "your own" else ""
            send({"error": _one_line(error) + place})


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    if type(error).__name__ == "RansacFixError":
        return text
    said = f": {text[:200]}" if text else ""
    return f"{type(error).__name__}{said}"


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    if type(error).__name__ == "RansacFixError" or not frames:
        return ""
    return f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"
