"""An audit as JSON. The schema is `schemas/audit.json` beside this file."""

import json
from dataclasses import asdict

from ransac_fix.audit.model import Report


def verdicts_json(report: Report) -> str:
    """Return the whole audit as a JSON document."""
    return json.dumps(asdict(report), indent=2, allow_nan=False)
