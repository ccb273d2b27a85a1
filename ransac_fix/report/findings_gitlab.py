"""Findings as a GitLab Code Quality report."""

import json
import os
from collections import Counter
from pathlib import PurePath

from ransac_fix.report.findings_sarif import fingerprint
from ransac_fix.scan import ScanResult

_SEVERITIES = {"high": "major", "medium": "minor", "low": "info"}


def findings_gitlab(result: ScanResult) -> str:
    """Return one entry a finding, its severity by how sure it is; paths from the current folder."""
    seen: Counter[str] = Counter()
    entries = [
        {
            "type": "issue",
            "check_name": finding.code,
            "description": finding.message,
            "categories": ["Bug Risk"],
            "severity": "info" if finding.severity == "note" else _SEVERITIES[finding.certainty],
            "fingerprint": fingerprint(finding, seen),
            "location": {
                "path": PurePath(os.path.relpath(finding.location.path)).as_posix(),
                "lines": {
                    "begin": finding.location.start_line,
                    "end": finding.location.end_line,
                },
            },
        }
        for finding in result.findings
    ]
    return json.dumps(entries, indent=2) + "\n"
