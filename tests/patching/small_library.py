"""A small library with a rule and a loop, and a patch for it, as source text."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import ransac_fix
from ransac_fix.patching.state import SystemStatus

LIBRARY = '''
"""A library with the shape that scikit-image and scikit-learn have."""
import math

def _trials(n_inliers, n_samples, min_samples, probability):
    """Say how many trials are enough."""
    p = (n_inliers / n_samples) ** min_samples
    if p == 1: return 1.0
    if p == 0 or probability == 1: return math.inf
    return float(math.ceil(math.log(1 - probability) / math.log1p(-p)))

def estimate(n_inliers, n_samples, min_samples, probability=0.99, max_trials=math.inf):
    """Return the bound that a run with these counts would have."""
    max_trials = min(max_trials, _trials(n_inliers, n_samples, min_samples, probability))
    return max_trials
'''

PATCH = """
from ransac_fix.patching.interface import LibraryPatch
from ransac_fix.patching.rules import count_rule

def plan(module):
    return count_rule(
        module, "_trials", caller="estimate", limit="max_trials",
        parameters=("n_inliers", "n_samples", "min_samples", "probability"),
    )

PATCH = LibraryPatch(
    system="{name}", requirements=("{name}-dist>=2,<3",), modules=("{name}.robust",), plan=plan
)
"""

APPROXIMATE, EXACT = 49.0, 56.0  # of the counts below
COUNTS = (6, 20, 2)


@dataclass(frozen=True, slots=True)
class Library:
    """A library on disk. `robust` imports the module that has the rule."""

    name: str
    folder: Path

    @property
    def module_name(self) -> str:
        return f"{self.name}.robust"

    def robust(self) -> ModuleType:
        return importlib.import_module(self.module_name)

    def trials(self) -> float:
        trials: float = self.robust().estimate(*COUNTS)
        return trials

    def status(self) -> SystemStatus:
        return next(s for s in ransac_fix.status().systems if s.system == self.name)


MakeLibrary = Callable[..., Library]


def install_patch(folder: Path, name: str, source: str) -> None:
    (folder / f"{name}_patch.py").write_text(source)
    metadata = folder / f"{name}_patch-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}-patch\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[ransac_fix.patches]\n{name} = {name}_patch\n")
