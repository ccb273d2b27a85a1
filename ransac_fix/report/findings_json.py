"""Findings as JSON. The schema is `schemas/scan.json` beside this file."""

import json
from typing import Any

from ransac_fix.scan import Finding, Location, ScanResult
from ransac_fix.scan.findings import Fix

SCHEMA_VERSION = 1


def findings_json(result: ScanResult) -> str:
    """Return the whole scan as a JSON document."""
    document = {
        "schema_version": SCHEMA_VERSION,
        "files": result.files,
        "findings": [finding_data(finding) for finding in result.findings],
        "errors": [
            {
                "code": error.code,
                "path": error.path,
                "line": error.line,
                "message": error.message,
                "named": error.named,
            }
            for error in result.errors
        ],
    }
    return json.dumps(document, indent=2) + "\n"


def findings_json_lines(result: ScanResult) -> str:
    """Return one JSON object a line, one a finding."""
    return "".join(json.dumps(finding_data(finding)) + "\n" for finding in result.findings)


def finding_data(finding: Finding) -> dict[str, Any]:
    """Return one finding as JSON data."""
    return {
        "code": finding.code,
        **_place(finding.location),
        "certainty": finding.certainty,
        "severity": finding.severity,
        "message": finding.message,
        "expression": finding.expression,
        "roles": dict(finding.roles),
        "related": [
            {**_place(related.location), "message": related.message} for related in finding.related
        ],
        "fix": None if finding.fix is None else _fix(finding.fix),
        "no_fix": finding.no_fix or None,
    }


def _fix(fix: Fix) -> dict[str, Any]:
    return {
        "message": fix.message,
        "safe": fix.safe,
        "edits": [{**_place(edit.location), "content": edit.content} for edit in fix.edits],
    }


def _place(location: Location) -> dict[str, Any]:
    cell = location.cell
    return {
        "path": location.path,
        "start_line": location.start_line,
        "start_column": location.start_column,
        "end_line": location.end_line,
        "end_column": location.end_column,
        "cell": None if cell is None else {"index": cell.index, "line": cell.line},
    }
