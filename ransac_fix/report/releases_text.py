"""An audit of releases as text for the terminal."""

from itertools import groupby
from typing import TYPE_CHECKING

from ransac_fix.audit.releases.model import Change, Release, ReleaseReport
from ransac_fix.report.controls_text import controls_summary, failure_lines
from ransac_fix.report.verdicts_text import STYLES, WIDEST

if TYPE_CHECKING:
    from rich.console import Console


def print_releases(report: ReleaseReport, console: "Console") -> None:
    """Print the audit: every release with its rules, and the changes of each distribution.

    Parameters
    ----------
    report : ReleaseReport
        The audit.
    console : rich.console.Console
        Where to; it decides about colours.
    """
    from rich.text import Text

    console.width = min(console.width, WIDEST)
    for distribution, of_one in groupby(report.releases, key=lambda one: one.distribution):
        for release in of_one:
            _print_release(release, console)
        console.print()
        changes = [one for one in report.changes if one.distribution == distribution]
        for change in changes:
            console.print(Text(change_line(change)))
        if changes:
            console.print()
    for line in failure_lines(report.controls):
        console.print(Text(line, style="bold red"))
    console.print(Text(summary_line(report)))


def _print_release(release: Release, console: "Console") -> None:
    from rich.padding import Padding
    from rich.text import Text

    head = Text(f"{release.distribution} {release.version}", style="bold")
    head.append(f"  Python {release.python}", style="dim")
    if release.remark:
        head.append(f", {release.remark}", style="dim")
    console.print(head)
    lines = [
        Text.assemble(
            (verdict.verdict, STYLES[verdict.verdict]),
            f"  {verdict.entry_point}  ",
            verdict.reason if verdict.stopping_law is None else verdict.stopping_law.formula,
        )
        for verdict in release.verdicts
    ]
    if not lines:
        lines = [Text.assemble(("not measured", STYLES["not measured"]), f"  {release.unmeasured}")]
    for line in lines:
        console.print(Padding(line, (0, 0, 0, 2), expand=False))


def change_line(change: Change) -> str:
    """Return one change in words."""
    return (
        f"{change.entry_point}: {change.verdict_before} in {change.before}, "
        f"{change.verdict_after} in {change.after}"
    )


def summary_line(report: ReleaseReport) -> str:
    """Return what the audit comes to, in one line."""
    measured = sum(
        any(verdict.verdict != "not measured" for verdict in one.verdicts)
        for one in report.releases
    )
    parts = [f"{measured} of {len(report.releases)} releases measured"]
    if report.not_tried:
        parts.append(
            f"{len(report.not_tried)} passed over: a change that was undone between two releases "
            "measured would not show"
        )
    parts.append(controls_summary(report.controls))
    parts.append(f"{report.runs:,} library runs; {report.seconds:.0f} s")
    return "; ".join(parts)
