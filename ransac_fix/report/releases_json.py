"""An audit of releases as JSON. The schema is `schemas/releases.json` beside this file."""

import json
from dataclasses import asdict

from ransac_fix.audit.releases.model import ReleaseReport


def releases_json(report: ReleaseReport) -> str:
    """Return everything that was measured as a JSON document."""
    return json.dumps(asdict(report), indent=2, allow_nan=False)
