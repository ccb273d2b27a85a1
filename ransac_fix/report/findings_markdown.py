"""Findings as Markdown, for the summary of a CI step."""

from ransac_fix.report.findings_text import place, summary, sure
from ransac_fix.report.markdown import escaped
from ransac_fix.scan import Finding, ScanResult


def findings_markdown(result: ScanResult) -> str:
    """Return one table of findings, and below it what was not read."""
    lines = ["# Stopping rules in source", "", escaped(summary(result))]
    if result.findings:
        lines += ["", "| place | rule | sure | finding | fix |", "| --- | --- | --- | --- | --- |"]
        lines += [_row(finding) for finding in result.findings]
    if result.errors:
        lines += ["", "Not read:", ""]
        lines += [f"- {escaped(error.path)}: {escaped(error.message)}" for error in result.errors]
    return "\n".join([*lines, ""])


def _row(finding: Finding) -> str:
    fix = finding.no_fix
    if finding.fix is not None:
        fix = "safe" if finding.fix.safe else "unsafe"
    cells = (
        escaped(place(finding.location)),
        finding.code,
        sure(finding),
        escaped(finding.message),
        escaped(fix),
    )
    return f"| {' | '.join(cells)} |"
