"""An audit as Markdown, for the summary of a CI step."""

from ransac_fix.audit.expectations import Surprises
from ransac_fix.audit.model import Report, Verdict
from ransac_fix.report.controls_text import controls_summary
from ransac_fix.report.markdown import escaped
from ransac_fix.report.outcomes_text import outcome_summary

MARKS = {
    "exact": "✅",
    "undersamples": "❌",
    "oversamples": "⚠️",
    "other rule": "⚠️",
    "not measured": "❔",
}


def verdicts_markdown(report: Report, surprises: Surprises | None = None) -> str:
    """Return the audit as one table and, below it, the reasons and the advice.

    Where verdicts are expected, what differs from them comes first.
    """
    lines = ["# Stopping rules of the installed RANSAC implementations", ""]
    if surprises is not None:
        lines += [*difference_lines(surprises), ""]
    lines += [
        "| system | entry point | verdict | rule |",
        "| --- | --- | --- | --- |",
    ]
    lines += [_row(verdict) for verdict in report.verdicts]
    lines.append("")
    for verdict in report.verdicts:
        if verdict.verdict != "exact":
            advice = f" {escaped(verdict.advice)}" if verdict.advice else ""
            if verdict.outcomes is not None:
                advice += f" {escaped(outcome_summary(verdict.outcomes))}"
            name = f"{verdict.system} {verdict.entry_point}"
            lines.append(f"- **{escaped(name)}**: {escaped(verdict.reason)}.{advice}")
    controls = controls_summary(report.controls)
    summary = f"{controls}; {report.runs:,} library runs in {report.seconds:.0f} s."
    return "\n".join([*lines, "", summary])


def difference_lines(surprises: Surprises, *, versions: bool = False) -> list[str]:
    """Return what differs from expectations as a Markdown list.

    Parameters
    ----------
    surprises : Surprises
        The differences.
    versions : bool, default False
        Name the release of each verdict, where there are several.
    """
    differences = [
        (
            f"{one.verdict.system}{f' {one.verdict.version}' * versions} {one.verdict.entry_point}",
            one.what,
        )
        for one in surprises.unexpected
    ]
    differences += [(one.name, f"expected but not seen: {one.verdict}") for one in surprises.unmet]
    if not differences:
        return ["✅ Everything is as expected."]
    lines = [f"- ❌ **{escaped(name)}**: {escaped(what)}" for name, what in differences]
    return ["**Not as expected:**", "", *lines]


def _row(verdict: Verdict) -> str:
    rule = f"`{verdict.stopping_law.formula}`" if verdict.stopping_law else ""
    cells = (
        escaped(f"{verdict.system} {verdict.version or ''}".rstrip()),
        escaped(verdict.entry_point),
        f"{MARKS[verdict.verdict]} {verdict.verdict}",
        rule,
    )
    return f"| {' | '.join(cells)} |"
