"""A trace as JSON. The schema is `schemas/trace.json` beside this file."""

import json
from dataclasses import asdict

from ransac_fix.patching.summary import TraceReport


def trace_json(report: TraceReport) -> str:
    """Return the report as a JSON document."""
    return json.dumps(asdict(report), indent=2, allow_nan=False)
