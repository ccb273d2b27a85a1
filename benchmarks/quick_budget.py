"""What `ransac-fix audit --quick` takes, against importing the libraries it measures.

    python benchmarks/quick_budget.py --repeat 3
    python benchmarks/quick_budget.py --verdicts

The libraries are those of the `audit` extra that are installed. Each is imported in a process of
its own, one after another, by the statement that gets its RANSAC; the budget of `--quick` is twice
the sum. Prints wall time and processor time (user and system, all processes), of repeated runs
the fastest. On a busy machine only the processor time says something: half of it is the least
that two cores can take.

`--verdicts` compares the verdicts with those of the full audit of the same entry points.
"""

import argparse
import json
import re
import resource
import subprocess
import sys
import time
from importlib.metadata import requires
from pathlib import Path

from ransac_fix.audit.session import probe_files
from ransac_fix.errors import RansacFixError
from ransac_fix.systems import find_system

# Where the module alone would leave its RANSAC to be imported.
_STATEMENTS = {
    "kornia": "from kornia.geometry.ransac import RANSAC",
    "scikit-image": "from skimage.measure import ransac",
    "scikit-learn": "from sklearn.linear_model import RANSACRegressor",
}
_BUDGET = 2.0


def systems() -> dict[str, str]:
    """Return the systems of the extra that can be imported, each with its statement."""
    found = {}
    probes = probe_files()
    for requirement in requires("ransac-fix") or ():
        name, _, marker = requirement.partition(";")
        if not re.search(r"extra == .audit.(?!-)", marker):
            continue
        try:
            system = find_system(re.split(r"[^\w.-]", name.strip())[0])
        except RansacFixError:
            continue
        statement = _STATEMENTS.get(system.name, f"import {system.modules[0]}")
        command = [sys.executable, "-c", statement]
        # The first import reads the files from disk; it is not timed.
        if system.name in probes and not subprocess.run(command, capture_output=True).returncode:
            found[system.name] = statement
    return found


def timed(command: list[str], repeat: int, codes: tuple[int, ...] = (0,)) -> tuple[float, float]:
    """Run a command several times; its least wall time and its least processor time, in s."""
    walls, used = [], []
    for _ in range(repeat):
        before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        code = subprocess.run(command, stdout=subprocess.DEVNULL).returncode
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        walls.append(time.monotonic() - started)
        used.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
        if code not in codes:
            raise SystemExit(f"{' '.join(command)} ended with {code}")
    return min(walls), min(used)


def audited(arguments: list[str]) -> dict[tuple[str, str], dict[str, object]]:
    """Return the verdicts of an audit, by system and entry point."""
    command = [_RANSAC_FIX, "audit", *arguments, "--output-format", "json"]
    report = json.loads(subprocess.run(command, capture_output=True).stdout)
    return {(one["system"], one["entry_point"]): one for one in report["verdicts"]}


_RANSAC_FIX = str(Path(sys.executable).with_name("ransac-fix"))


def compare(names: list[str]) -> int:
    """Print the verdicts of both audits; how many differ."""
    quick = audited(["--quick", *names])
    patterns = [part for _, name in quick for part in ("--entry-point", name)]
    full = audited([*patterns, *names])
    differ = 0
    for key, one in quick.items():
        same = one["verdict"] == full[key]["verdict"]
        differ += not same
        print(
            f"{' '.join(key):45} {one['verdict']:14} {one['runs']:6} runs; in full "
            f"{full[key]['verdict']:14} {full[key]['runs']:6} runs{'' if same else '  DIFFERS'}"
        )
    print(f"{differ} of {len(quick)} verdicts differ")
    return differ


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--verdicts", action="store_true")
    options = parser.parse_args()
    libraries = systems()
    if options.verdicts:
        sys.exit(compare(list(libraries)) > 0)
    walls = used = 0.0
    for statement in libraries.values():
        wall, cpu = timed([sys.executable, "-c", statement], options.repeat)
        print(f"{statement:60} {wall:6.2f} s {cpu:6.2f} CPU s")
        walls, used = walls + wall, used + cpu
    print(f"{f'{len(libraries)} libraries one after another':60} {walls:6.2f} s {used:6.2f} CPU s")
    command = [_RANSAC_FIX, "audit", "--quick", *libraries]
    # Undersampling libraries make it end with 1.
    wall, cpu = timed(command, options.repeat, (0, 1))
    print(f"{'ransac-fix audit --quick':60} {wall:6.2f} s {cpu:6.2f} CPU s")
    print(
        f"wall time {wall / walls:.2f} times the imports (budget {_BUDGET:g}); half the processor "
        f"time {cpu / 2 / used:.2f} times theirs"
    )


if __name__ == "__main__":
    main()
