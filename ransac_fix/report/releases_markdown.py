"""An audit of releases as Markdown, for the summary of a CI step."""

from itertools import groupby

from ransac_fix.audit.expectations import Surprises
from ransac_fix.audit.releases.model import Release, ReleaseReport
from ransac_fix.report.markdown import escaped
from ransac_fix.report.releases_text import change_line, summary_line
from ransac_fix.report.verdicts_markdown import MARKS, difference_lines


def releases_markdown(report: ReleaseReport, surprises: Surprises | None = None) -> str:
    """Return the audit as one table a distribution, the changes below it.

    Where verdicts are expected, what differs from them comes first.
    """
    lines = ["# Stopping rules of releases"]
    if surprises is not None:
        lines += ["", *difference_lines(surprises, versions=True)]
    for distribution, of_one in groupby(report.releases, key=lambda one: one.distribution):
        releases = list(of_one)
        lines += ["", f"## {escaped(distribution)}, Python {releases[0].python}", ""]
        lines += release_table(releases)
        changes = [one for one in report.changes if one.distribution == distribution]
        lines += ["", *(f"- {escaped(change_line(one))}" for one in changes)] if changes else []
    return "\n".join([*lines, "", f"{summary_line(report)}."])


def release_table(releases: list[Release]) -> list[str]:
    """Return a Markdown table of releases, one row an entry point."""
    lines = ["| release | entry point | verdict | rule |", "| --- | --- | --- | --- |"]
    for release in releases:
        if not release.verdicts:
            mark = f"{MARKS['not measured']} not measured"
            lines.append(f"| {release.version} | | {mark} | {escaped(release.unmeasured)} |")
        for verdict in release.verdicts:
            law = verdict.stopping_law
            rule = escaped(verdict.reason) if law is None else f"`{law.formula}`"
            mark = f"{MARKS[verdict.verdict]} {verdict.verdict}"
            name = escaped(verdict.entry_point)
            lines.append(f"| {release.version} | {name} | {mark} | {rule} |")
    return lines
