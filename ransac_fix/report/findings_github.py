"""Findings as GitHub Actions workflow commands, which annotate the lines of a pull request."""

from ransac_fix.scan import Finding, ScanError, ScanResult

_LEVELS = {"high": "error", "medium": "warning", "low": "notice"}


def findings_github(result: ScanResult) -> str:
    """Return one workflow command a finding, its level by how sure it is; notes are notices."""
    lines = [_finding(finding) for finding in result.findings]
    lines += [_error(error) for error in result.errors]
    return "".join(f"{line}\n" for line in lines)


def _finding(finding: Finding) -> str:
    place = finding.location
    properties = {
        "title": f"ransac-fix ({finding.code})",
        "file": place.path,
        "line": str(place.start_line),
        "endLine": str(place.end_line),
    }
    if place.cell is None and place.start_line == place.end_line:
        properties |= {"col": str(place.start_column), "endColumn": str(place.end_column)}
    level = "notice" if finding.severity == "note" else _LEVELS[finding.certainty]
    return _command(level, properties, finding.message)


def _error(error: ScanError) -> str:
    properties = {"title": f"ransac-fix ({error.code})", "file": error.path}
    if error.line is not None:
        properties["line"] = str(error.line)
    return _command("error" if error.named else "warning", properties, error.message)


def _command(level: str, properties: dict[str, str], message: str) -> str:
    spelled = ",".join(f"{name}={_property(value)}" for name, value in properties.items())
    return f"::{level} {spelled}::{_data(message)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
