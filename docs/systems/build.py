"""Make ``ransac_fix/verdicts.json`` from the results stored beside this file, one file a system.

python docs/systems/build.py
"""

import json
from pathlib import Path
from typing import Any

from packaging.version import Version

from ransac_fix.systems import load_systems

HERE = Path(__file__).parent
VERDICTS = HERE.parent.parent / "ransac_fix" / "verdicts.json"


def stored_results() -> dict[str, dict[str, Any]]:
    """Return what is stored, by system, in the order of ``systems.toml``."""
    found = {}
    for system in load_systems():
        path = HERE / f"{system.name}.json"
        if path.exists():
            found[system.name] = json.loads(path.read_text("utf-8"))
    return found


def verdict_table(results: dict[str, dict[str, Any]]) -> str:
    """Return the text of ``verdicts.json``: one line a verdict, to be read in a diff."""
    rows = [
        {
            "system": system,
            "distribution": release["distribution"],
            "version": release["version"],
            "entry_point": verdict["entry_point"],
            "verdict": verdict["verdict"],
            "formula": (verdict["stopping_law"] or {}).get("formula"),
            "measured_on": release["measured_on"],
        }
        for system, result in results.items()
        for release in sorted(result["releases"], key=lambda one: Version(one["version"]))
        for verdict in release["verdicts"]
    ]
    lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in rows)
    return f'{{"schema_version": 1, "verdicts": [\n{lines}\n]}}\n'


if __name__ == "__main__":
    VERDICTS.write_text(verdict_table(stored_results()), "utf-8")
