"""Findings as text: one block each (full), or one line each (concise)."""

from collections.abc import Iterator

from ransac_fix.scan import Finding, ScanResult
from ransac_fix.scan.findings import Location

_ROLES = {
    "inlier_ratio": "inlier ratio",
    "n_inliers": "inliers",
    "n_samples": "samples",
    "sample_size": "sample size",
    "confidence": "confidence",
    "trials": "trials",
}


def findings_full(result: ScanResult) -> str:
    """Return each finding with its source, its roles and the places that belong to it."""
    blocks: list[str] = []
    for finding in result.findings:
        lines = [_headline(finding)]
        if finding.expression:
            lines.append(f"    {_shortened(finding.expression)}")
        roles = [
            f"{_ROLES.get(role, role)}: {text}"
            for role, text in finding.roles.items()
            if text is not None
        ]
        if roles:
            lines.append(f"    {'; '.join(roles)}")
        lines += [f"    {place(one.location)}: {one.message}" for one in finding.related]
        if finding.fix is not None:
            option = "--fix" if finding.fix.safe else "--fix --unsafe-fixes"
            lines.append(f"    {option}: {finding.fix.message}")
        elif finding.no_fix:
            lines.append(f"    no fix: {finding.no_fix}")
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, *_errors(result), summary(result)]) + "\n"


def findings_concise(result: ScanResult) -> str:
    """Return one line a finding, as compilers write them."""
    lines = [_headline(finding) for finding in result.findings]
    return "\n".join([*lines, *_errors(result), summary(result)]) + "\n"


def summary(result: ScanResult) -> str:
    """Return the last line: how much was found in how much."""
    aside = f" {len(result.suppressed)} set aside by comments." if result.suppressed else ""
    files = f"{result.files} file{'' if result.files == 1 else 's'}"
    if not result.findings:
        return f"Nothing found in {files}.{aside}"
    count = len(result.warnings)
    notes = len(result.findings) - count
    parts = [f"{count} finding{'' if count == 1 else 's'}"] if count else []
    parts += [f"{notes} note{'' if notes == 1 else 's'}"] if notes else []
    found = len({finding.location.path for finding in result.findings})
    return f"{' and '.join(parts)} in {found} of {files}.{aside}"


def _errors(result: ScanResult) -> Iterator[str]:
    for error in result.errors:
        place = error.path if error.line is None else f"{error.path}:{error.line}"
        yield f"{place}: {error.code} {error.message}"


def _headline(finding: Finding) -> str:
    return f"{place(finding.location)}: {finding.code} {finding.message} [{sure(finding)}]"


def sure(finding: Finding) -> str:
    """Spell how sure a finding is, and that it is a note."""
    note = "note, " if finding.severity == "note" else ""
    return f"{note}{finding.certainty}"


def place(location: Location) -> str:
    """Spell where something is: path, line and column, in a notebook path, cell and line."""
    if location.cell is not None:
        return f"{location.path}:cell {location.cell.index}:{location.cell.line}"
    return f"{location.path}:{location.start_line}:{location.start_column}"


def _shortened(text: str, width: int = 160) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."
