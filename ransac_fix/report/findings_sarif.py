"""Findings as SARIF 2.1.0, for code scanning services."""

import hashlib
import inspect
import json
from collections import Counter
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

from ransac_fix._version import __version__
from ransac_fix.report.rule_text import rule_markdown
from ransac_fix.scan import Finding, Location, ScanError, ScanResult
from ransac_fix.scan.findings import Fix
from ransac_fix.scan.rules import Rule, all_rules

_SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)
_LEVELS = {"high": "error", "medium": "warning", "low": "note"}
# SARIF has no word for how sure a finding is; a rank from 0 to 100 comes closest.
_RANKS = {"high": 95.0, "medium": 60.0, "low": 25.0}


def findings_sarif(result: ScanResult) -> str:
    """Return the whole scan as one SARIF run; suppressed findings are in it and say so."""
    rules = all_rules()
    index = {rule.code: number for number, rule in enumerate(rules)}
    seen: Counter[str] = Counter()
    run = {
        "tool": {
            "driver": {
                "name": "ransac-fix",
                "version": __version__,
                "rules": [_rule(rule) for rule in rules],
            }
        },
        "columnKind": "unicodeCodePoints",
        "originalUriBaseIds": {"ROOT": {"uri": f"{Path.cwd().as_uri()}/"}},
        "results": [
            _result(finding, index[finding.code], seen)
            for finding in (*result.findings, *result.suppressed)
        ],
        "invocations": [
            {
                "executionSuccessful": not any(error.named for error in result.errors),
                "toolExecutionNotifications": [_notification(error) for error in result.errors],
            }
        ],
    }
    document = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(document, indent=2) + "\n"


def _rule(rule: Rule) -> dict[str, Any]:
    page = inspect.getdoc(type(rule)) or ""
    return {
        "id": rule.code,
        "name": "".join(part.capitalize() for part in rule.name.split("-")),
        "shortDescription": {"text": rule.summary},
        "fullDescription": {"text": page.partition("\n")[0]},
        "help": {"text": page, "markdown": rule_markdown(rule)},
    }


def _result(finding: Finding, rule_index: int, seen: Counter[str]) -> dict[str, Any]:
    result: dict[str, Any] = {
        "ruleId": finding.code,
        "ruleIndex": rule_index,
        "level": "note" if finding.severity == "note" else _LEVELS[finding.certainty],
        "rank": _RANKS[finding.certainty],
        "message": {"text": finding.message},
        "locations": [{"physicalLocation": _physical(finding.location)}],
        "partialFingerprints": {"expression/v1": fingerprint(finding, seen)},
        "properties": {"certainty": finding.certainty, "roles": dict(finding.roles)},
    }
    if finding.related:
        result["relatedLocations"] = [
            {
                "id": number,
                "physicalLocation": _physical(related.location),
                "message": {"text": related.message},
            }
            for number, related in enumerate(finding.related, 1)
        ]
    if finding.fix is not None:
        result["fixes"] = [_fix(finding.fix)]
    if finding.suppression is not None:
        result["suppressions"] = [
            {"kind": "inSource", "justification": finding.suppression or "no reason given"}
        ]
    return result


def fingerprint(finding: Finding, seen: Counter[str]) -> str:
    """Name a finding by path, rule and source, never by line; equal ones are counted."""
    key = "\0".join((_uri(finding.location.path), finding.code, finding.expression))
    seen[key] += 1
    return f"{hashlib.sha256(key.encode()).hexdigest()[:32]}:{seen[key]}"


def _physical(location: Location) -> dict[str, Any]:
    return {"artifactLocation": _artifact(location.path), "region": _region(location)}


def _region(location: Location) -> dict[str, Any]:
    region = {"startLine": location.start_line, "endLine": location.end_line}
    if location.cell is None:
        region |= {"startColumn": location.start_column, "endColumn": location.end_column}
    return region


def _artifact(path: str) -> dict[str, str]:
    uri = _uri(path)
    return {"uri": uri} if uri.startswith("file:") else {"uri": uri, "uriBaseId": "ROOT"}


def _uri(path: str) -> str:
    """Give a path relative to the current folder, or whole where it lies elsewhere."""
    absolute = Path(path).absolute()
    try:
        return quote(PurePath(absolute.relative_to(Path.cwd())).as_posix())
    except ValueError:
        return absolute.as_uri()


def _fix(fix: Fix) -> dict[str, Any]:
    changes: dict[str, list[dict[str, Any]]] = {}
    for edit in fix.edits:
        changes.setdefault(edit.location.path, []).append(
            {"deletedRegion": _region(edit.location), "insertedContent": {"text": edit.content}}
        )
    return {
        "description": {"text": fix.message},
        "artifactChanges": [
            {"artifactLocation": _artifact(path), "replacements": replacements}
            for path, replacements in changes.items()
        ],
    }


def _notification(error: ScanError) -> dict[str, Any]:
    physical: dict[str, Any] = {"artifactLocation": _artifact(error.path)}
    if error.line:
        physical["region"] = {"startLine": error.line}
    return {
        "descriptor": {"id": error.code},
        "level": "error" if error.named else "warning",
        "message": {"text": error.message},
        "locations": [{"physicalLocation": physical}],
    }
