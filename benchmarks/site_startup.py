"""What `ransac-fix site enable` costs a program that uses none of the libraries.

    python benchmarks/site_startup.py [--repeat 200]

Starts ``python -c pass`` in a virtual environment of its own, with and without the .pth file in
turn, and compares processor time (of the child alone) and elapsed time. Prints medians and the
smallest; the exit code is 1 where the median of the processor time grows by 3 ms or more.
"""

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from importlib import import_module
from pathlib import Path

import ransac_fix
from ransac_fix.patching.site import FILE


def environment(folder: Path) -> Path:
    """Make an environment with this ransac-fix, and what it needs behind it."""
    venv.create(folder, with_pip=False, symlinks=True)
    packages = next(folder.glob("lib/python*/site-packages"))
    package = packages / "ransac_fix"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(ransac_fix.__file__).parent, package, ignore=ignored)
    patches = import_module("ransac_fix.patches").__file__
    assert patches is not None
    shutil.copytree(Path(patches).parent, package / "patches", ignore=ignored, dirs_exist_ok=True)
    metadata = packages / "ransac_fix-0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: ransac-fix\nVersion: 0\n")
    names = sorted(path.stem for path in (package / "patches").glob("[a-z]*.py"))
    lines = [f"{name.replace('_', '-')} = ransac_fix.patches.{name}" for name in names]
    (metadata / "entry_points.txt").write_text("[ransac_fix.patches]\n" + "\n".join(lines) + "\n")
    libraries = [path for path in sys.path if path.endswith("-packages")]
    (packages / "libraries.pth").write_text("\n".join(libraries) + "\n")
    return folder / "bin" / "python"


def site(python: Path, word: str) -> None:
    """Run `ransac-fix site`."""
    subprocess.run([python, "-m", "ransac_fix", "site", word], check=True, capture_output=True)


def start(python: Path) -> tuple[float, float]:
    """Return processor and elapsed seconds of a program that does nothing."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.perf_counter()
    subprocess.run([python, "-c", "pass"], check=True)
    elapsed = time.perf_counter() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, elapsed


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeat", type=int, default=200)
    repeat = parser.parse_args().repeat
    found: dict[str, list[tuple[float, float]]] = {"disable": [], "enable": []}
    for name in ("RANSAC_FIX", "PYTHONDONTWRITEBYTECODE"):  # an installed package has its bytecode
        os.environ.pop(name, None)
    with tempfile.TemporaryDirectory() as folder:
        python = environment(Path(folder, "environment"))
        site(python, "enable")
        file = next(Path(folder).rglob(FILE))
        text = file.read_text()
        for _ in range(repeat):
            for word, seconds in found.items():
                if word == "enable":
                    file.write_text(text)
                else:
                    file.unlink(missing_ok=True)
                if not seconds:
                    start(python)  # writes the bytecode
                seconds.append(start(python))
    print("| | processor, median ms | least | elapsed, median ms | least |")
    print("| --- | --- | --- | --- | --- |")
    medians = []
    for label, word in (("without", "disable"), ("with `site enable`", "enable")):
        columns = [[1e3 * value for value in column] for column in zip(*found[word], strict=True)]
        cells = [f"{f(column):.2f}" for column in columns for f in (statistics.median, min)]
        medians.append(statistics.median(columns[0]))
        print(f"| {label} | {' | '.join(cells)} |")
    print(f"\n{medians[1] - medians[0]:+.2f} ms of processor time at the median")
    return int(medians[1] - medians[0] >= 3)


if __name__ == "__main__":
    sys.exit(main())
