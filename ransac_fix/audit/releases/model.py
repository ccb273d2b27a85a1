"""What was measured of several releases: plain data, the model behind every output format."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from packaging.version import Version

from ransac_fix.audit.model import Control, Judgement, Verdict
from ransac_fix.audit.proof import objection

SCHEMA_VERSION: Literal[1] = 1


@dataclass(frozen=True, slots=True)
class Release:
    """One release, measured in an environment of its own.

    Parameters
    ----------
    system : str
        Name of the system.
    distribution, version : str
        The release.
    python : str
        Version of the interpreter it was measured with.
    wheel, sha256 : str or None
        The file installed and its hash; None where there is none for this interpreter.
    dependencies : tuple of str
        What else the environment held, ``name==version``.
    probe_version : str
        Digest of the sources that measured.
    measured_on : str
        The day, ``YYYY-MM-DD``.
    remark : str
        What was done to get it to work; empty if nothing.
    unmeasured : str
        Why nothing was measured; empty if something was.
    verdicts : tuple of Verdict
        In the order of the probe.
    """

    system: str
    distribution: str
    version: str
    python: str
    wheel: str | None
    sha256: str | None
    dependencies: tuple[str, ...]
    probe_version: str
    measured_on: str
    remark: str
    unmeasured: str
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True, slots=True)
class Change:
    """Two releases measured, one after the other, that differ in one verdict.

    Parameters
    ----------
    distribution, entry_point : str
        What changed.
    before, after : str
        The releases.
    verdict_before, verdict_after : str
        Their verdicts.
    """

    distribution: str
    entry_point: str
    before: str
    after: str
    verdict_before: Judgement
    verdict_after: Judgement


@dataclass(frozen=True, slots=True)
class ReleaseReport:
    """The audit of several releases.

    Parameters
    ----------
    releases : tuple of Release
        By distribution, from the oldest to the newest.
    changes : tuple of Change
        Where a verdict differs from that of the release measured before.
    not_tried : tuple of str
        ``name==version`` of the releases that a bisection passed over.
    controls : tuple of Control
        The known laws measured alongside.
    runs : int
        Library runs spent, controls included, now or when a result was first obtained.
    seconds : float
        Time from start to end.
    """

    schema_version: Literal[1]
    releases: tuple[Release, ...]
    changes: tuple[Change, ...]
    not_tried: tuple[str, ...]
    controls: tuple[Control, ...]
    runs: int
    seconds: float


def report_on(
    releases: Iterable[Release],
    controls: tuple[Control, ...],
    seconds: float,
    not_tried: Sequence[str] = (),
) -> ReleaseReport:
    """Put a report together; without a verdict where a control failed.

    Parameters
    ----------
    releases : iterable of Release
        In any order.
    controls : tuple of Control
        The known laws measured alongside.
    seconds : float
        Time taken.
    not_tried : sequence of str, optional
        Releases passed over.

    Returns
    -------
    ReleaseReport
    """
    ordered = in_order(releases)
    why = objection(controls)
    if why:
        ordered = [replace(one, unmeasured=why, verdicts=()) for one in ordered]
    runs = sum(control.runs for control in controls)
    runs += sum(verdict.runs for one in ordered for verdict in one.verdicts)
    return ReleaseReport(
        SCHEMA_VERSION,
        tuple(ordered),
        changes(ordered),
        tuple(not_tried),
        controls,
        runs,
        round(seconds, 2),
    )


def in_order(releases: Iterable[Release]) -> list[Release]:
    """Sort releases by distribution and from the oldest to the newest."""
    return sorted(releases, key=lambda one: (one.distribution, Version(one.version)))


def changes(ordered: Sequence[Release]) -> tuple[Change, ...]:
    """Return the changes of verdict between releases in order.

    What was not measured neither changes a verdict nor ends it.

    Parameters
    ----------
    ordered : sequence of Release
        As `in_order` sorts them.

    Returns
    -------
    tuple of Change
        By distribution and entry point, from the oldest to the newest.
    """
    last: dict[tuple[str, str], tuple[str, Judgement]] = {}
    found: list[Change] = []
    for release in ordered:
        for verdict in release.verdicts:
            if verdict.verdict == "not measured":
                continue
            key = release.distribution, verdict.entry_point
            before = last.get(key)
            if before is not None and before[1] != verdict.verdict:
                found.append(Change(*key, before[0], release.version, before[1], verdict.verdict))
            last[key] = release.version, verdict.verdict
    order = {key: position for position, key in enumerate(last)}
    return tuple(sorted(found, key=lambda one: order[one.distribution, one.entry_point]))
