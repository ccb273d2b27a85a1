"""The probe of a user's own function: ``module:function`` and its problem as arguments."""

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any

from ransac_fix.audit.user import entry_point
from ransac_fix.audit.worker.interface import EntryPoint, Probe, Unmeasured
from ransac_fix.errors import RansacFixError


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("probe_file")
    parser.add_argument("target")
    parser.add_argument("--problem", required=True)
    parser.add_argument("--sample-size", type=int)
    parser.add_argument("--trials", type=int, default=40)
    return parser.parse_args()


def _entry_points(_module: Any) -> list[EntryPoint | Unmeasured]:
    options = _arguments()
    module_name, _, path = options.target.partition(":")
    # As `python -m` would, find modules beside the user.
    sys.path.insert(0, str(Path.cwd()))
    found: Any = importlib.import_module(module_name)
    for attribute in path.split("."):
        if not hasattr(found, attribute):
            raise RansacFixError(f"{module_name} has no {path}")
        found = getattr(found, attribute)
    return [
        entry_point(
            found,
            problem=options.problem,
            sample_size=options.sample_size,
            name=options.target,
            typical_trials=options.trials,
        )
    ]


PROBE = Probe("your own", "ransac_fix", (), _entry_points)
