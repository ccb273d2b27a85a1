"""An audit of releases as text for the terminal."""

from itertools import groupby
from typing import TYPE_CHECKING

from ransac_fix.audit.releases.model import Change, Release, ReleaseReport
from ransac_fix.report.verdicts_text import STYLES, WIDEST

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def print_releases(report: ReleaseReport, console: "Console") -> None:
    """Print the audit: a table a distribution, the changes below it.

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
        releases = list(of_one)
        console.print(Text(f"{distribution}, Python {releases[0].python}", style="bold"))
        console.print(_table(releases))
        for release in releases:
            for remark in (release.remark, release.unmeasured and f"none: {release.unmeasured}"):
                if remark:
                    console.print(Text(f"{release.version}: {remark}", style="dim"))
        for change in report.changes:
            if change.distribution == distribution:
                console.print(Text(change_line(change)))
        console.print()
    for control in report.controls:
        if not control.passed:
            line = f"control failed: {control.name}: put in {control.expected}, "
            console.print(Text(line + f"found {control.identified}", style="bold red"))
    console.print(Text(summary_line(report)))


def _table(releases: list[Release]) -> "Table":
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("release", "entry point", "verdict"):
        table.add_column(title, no_wrap=title != "entry point", overflow="fold")
    table.add_column("rule", overflow="fold")
    for release in releases:
        if not release.verdicts:
            table.add_row(release.version, "", Text("not measured", style=STYLES["not measured"]))
        for position, verdict in enumerate(release.verdicts):
            law = verdict.stopping_law
            table.add_row(
                release.version if position == 0 else "",
                verdict.entry_point,
                Text(verdict.verdict, style=STYLES[verdict.verdict]),
                law.formula if law is not None else verdict.reason,
            )
    return table


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
    passed = sum(control.passed for control in report.controls)
    parts.append(f"{passed} of {len(report.controls)} controls identified")
    parts.append(f"{report.runs:,} library runs; {report.seconds:.0f} s")
    return "; ".join(parts)
