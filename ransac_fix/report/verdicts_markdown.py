"""An audit as Markdown, for the summary of a CI step."""

from ransac_fix.audit.model import Report, Verdict
from ransac_fix.report.markdown import escaped

MARKS = {
    "exact": "✅",
    "undersamples": "❌",
    "oversamples": "⚠️",
    "other rule": "⚠️",
    "not measured": "❔",
}


def verdicts_markdown(report: Report) -> str:
    """Return the audit as one table and, below it, the reasons and the advice."""
    lines = [
        "# Stopping rules of the installed RANSAC implementations",
        "",
        "| system | entry point | verdict | rule |",
        "| --- | --- | --- | --- |",
    ]
    lines += [_row(verdict) for verdict in report.verdicts]
    lines.append("")
    for verdict in report.verdicts:
        if verdict.verdict != "exact":
            advice = f" {escaped(verdict.advice)}" if verdict.advice else ""
            name = f"{verdict.system} {verdict.entry_point}"
            lines.append(f"- **{escaped(name)}**: {escaped(verdict.reason)}.{advice}")
    passed = sum(control.passed for control in report.controls)
    summary = (
        f"{passed} of {len(report.controls)} controls identified; {report.runs:,} library runs "
        f"in {report.seconds:.0f} s."
    )
    return "\n".join([*lines, "", summary])


def _row(verdict: Verdict) -> str:
    rule = f"`{verdict.stopping_law.formula}`" if verdict.stopping_law else ""
    cells = (
        escaped(f"{verdict.system} {verdict.version or ''}".rstrip()),
        escaped(verdict.entry_point),
        f"{MARKS[verdict.verdict]} {verdict.verdict}",
        rule,
    )
    return f"| {' | '.join(cells)} |"
