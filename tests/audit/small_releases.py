"""Releases of a small library as wheels in a folder, and a probe for it."""

import zipfile
from pathlib import Path

LIBRARY = '''
import importlib.metadata
import math

import numpy as np

{guard}

def fit_line(x, y, threshold, max_trials, confidence, seed):
    """Return the inliers of the best line and the number of trials."""
    rng, n = np.random.default_rng(seed), len(x)
    best, trials, needed = np.zeros(n, dtype=bool), 0, math.inf
    while trials < min(max_trials, needed):
        i, j = rng.choice(n, 2, replace=False)
        trials += 1
        slope = (y[j] - y[i]) / (x[j] - x[i])
        inliers = np.abs(y - y[i] - slope * (x - x[i])) < threshold
        if inliers.sum() > best.sum():
            best, count = inliers, int(inliers.sum())
            p = {probability}
            needed = 0 if p == 1 else math.ceil(math.log(1 - confidence) / math.log(1 - p))
    return best, trials
'''
GUARD = """
if int(importlib.metadata.version("numpy").split(".")[0]) >= 2:
    raise ImportError("compiled for NumPy 1")
"""
APPROXIMATE = "(count / n) ** 2"
EXACT = "math.comb(count, 2) / math.comb(n, 2)"

PROBE = """
from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe


def _entry_points(library):
    def run(planted, settings, seed):
        found = library.fit_line(
            planted.x[:, 0], planted.y[:, 0], planted.threshold,
            settings.max_trials, settings.confidence, seed,
        )
        return Outcome(*found)

    return [EntryPoint("fit_line", "line", 2, run, counted=True, typical_trials=40)]


PROBE = Probe("small", "smallransac", ("smallransac",), _entry_points)
"""


def wheel(folder: Path, name: str, version: str, files: dict[str, str], needs: str = "") -> None:
    """Write a wheel with these files."""
    info = f"{name}-{version}.dist-info"
    requires = f"Requires-Dist: {needs}\n" if needs else ""
    files = {
        **files,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{requires}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    record = "".join(f"{path},,\n" for path in [*files, f"{info}/RECORD"])
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as archive:
        for path, text in {**files, f"{info}/RECORD": record}.items():
            archive.writestr(path, text)


def write_releases(folder: Path) -> None:
    """Fill a folder with releases, and with stand-ins that lead to the NumPy of this process."""
    import numpy as np

    here = f"{Path(np.__file__).parent.parent}\n"
    for version in ("1.26.0", "2.2.0"):
        wheel(folder, "numpy", version, {"numpy_here.pth": here})
    for version, probability, guard, needs in (
        ("1.0", APPROXIMATE, "", ""),
        ("1.1", APPROXIMATE, GUARD, "numpy"),
        ("1.2", APPROXIMATE, "", "missing-package>=3"),
        ("1.3", APPROXIMATE, "import missing_module", ""),
        ("2.0", EXACT, "", "numpy>=1.20"),
        ("2.1rc1", EXACT, "", ""),
    ):
        module = LIBRARY.format(probability=probability, guard=guard)
        wheel(folder, "smallransac", version, {"smallransac.py": module}, needs)
    (folder / "smallransac-0.9.tar.gz").touch()
