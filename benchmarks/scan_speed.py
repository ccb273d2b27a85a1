"""How long the scan of a tree takes: cold, warm, next to reading it, and next to semgrep.

    python benchmarks/scan_speed.py FOLDER [--jobs N] [--repeat N] [--semgrep COMMAND] [--no-gates]

Each figure is of a process of its own: wall time, processor time with that of its workers, and the
largest memory of one of its processes. Of ``--repeat`` runs of this package the quickest counts,
by its processor time; semgrep runs once. On a busy machine only ratios of processor times of one
run of this script mean anything, and those only roughly.

``--semgrep`` runs semgrep with a rule that has the plain spellings of the same formula over the
Python files of the folder, which lie in a folder of their own so that both are given the same ones:
as many jobs, no limit to the size of a file, nothing ignored, and no network. This package scans
them without its cache, and checks all of its rules.
``--no-gates`` scans once more with every gate off, which takes many minutes on a large tree, and
says whether the findings are the same.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from ransac_fix.scan import ScanResult, scan_paths
from ransac_fix.scan.files import find_files

_RULE = """
rules:
  - id: approximate-stopping-rule
    languages: [python]
    severity: WARNING
    message: the power of the inlier ratio in a stopping rule
    pattern-either:
      - pattern: $A / $M.log(1 - $W ** $K)
      - pattern: $A / $M.log(1 - pow($W, $K))
      - pattern: $A / $M.log(1 - $N.power($W, $K))
      - patterns:
          - pattern: $A / $M.log($D)
          - pattern-inside: |
              $D = <... 1 - $W ** $K ...>
              ...
"""
_READ = """
import sys
for name in open(sys.argv[1]).read().split("\\0"):
    open(name, "rb").read()
"""


@dataclass(frozen=True, slots=True)
class Run:
    """What one process took."""

    wall: float
    processor: float
    output: str

    def __str__(self) -> str:
        return f"{self.wall:7.2f} s, {self.processor:7.2f} s of processors"


def run(*command: str, cache: Path | None = None, folder: Path | None = None) -> Run:
    """Run a command to its end and measure it."""
    environment = dict(os.environ)
    if cache is not None:
        environment["XDG_CACHE_HOME"] = str(cache)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(done.stderr[-2000:])
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(wall, spent, done.stdout)


def quickest(times: int, *command: str, cache: Path | None = None) -> Run:
    """Run a command several times, with an empty cache each time where it has one."""
    runs: list[Run] = []
    for _ in range(times):
        if cache is not None:
            shutil.rmtree(cache, ignore_errors=True)
        runs.append(run(*command, cache=cache))
    return min(runs, key=lambda one: one.processor)


def places(result: ScanResult) -> set[tuple[str, str, int]]:
    return {(one.code, one.location.path, one.location.start_line) for one in result.findings}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--semgrep", metavar="COMMAND")
    parser.add_argument("--no-gates", action="store_true")
    options = parser.parse_args()

    files = [file.path for file in find_files([str(options.folder)])]
    size = sum(Path(path).stat().st_size for path in files)
    print(f"{len(files)} files, {size / 1e6:.0f} MB")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        listed = folder / "files"
        listed.write_text("\0".join(files))
        run(sys.executable, "-c", _READ, str(listed))  # into the memory of the system
        bare = run(sys.executable, "-c", _READ, str(listed))
        scan = [sys.executable, "-m", "ransac_fix", "scan", "--exit-zero", "--output-format"]
        scan += ["json", "--jobs", str(options.jobs)]
        cache = folder / "cache"
        cold = quickest(options.repeat, *scan, str(options.folder), cache=cache)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        warms = [run(*scan, str(options.folder), cache=cache) for _ in range(options.repeat)]
        warm = min(warms, key=lambda one: one.processor)
        found = json.loads(cold.output)
        print(f"reading {bare}")
        print(f"cold    {cold}, {cold.processor / bare.processor:6.1f} times reading")
        print(f"warm    {warm}, {warm.processor / bare.processor:6.1f} times reading")
        print(f"memory  {peak:7.0f} MB at most in one process")
        print(f"findings {len(found['findings'])}, errors {len(found['errors'])}")
        if options.semgrep:
            rule = folder / "rule.yml"
            rule.write_text(_RULE)
            python = [path for path in files if path.endswith(".py")]
            tree = folder / "python"
            for path in python:
                target = tree / Path(path).relative_to(options.folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(Path(path).read_bytes())
            same = quickest(options.repeat, *scan, "--no-cache", str(tree))
            version = run(*options.semgrep.split(), "--version").output.strip()
            semgrep = run(
                *options.semgrep.split(),
                *("scan", "--config", str(rule), "--metrics=off", "--disable-version-check"),
                *("--no-git-ignore", "--x-ignore-semgrepignore-files", "--max-target-bytes=0"),
                *(f"--jobs={options.jobs}", "--json", "--quiet", str(tree)),
                folder=folder,
            )
            report = json.loads(semgrep.output)
            here = json.loads(same.output)
            size = sum(Path(path).stat().st_size for path in python)
            print(f"{len(python)} Python files, {size / 1e6:.0f} MB, {options.jobs} jobs each:")
            print(f"here    {same}; {here['files']} files, findings {len(here['findings'])}")
            print(
                f"semgrep {semgrep}; {len(report['paths']['scanned'])} files,"
                f" findings {len(report['results'])} ({version})"
            )
            ratios = semgrep.wall / same.wall, semgrep.processor / same.processor
            print(f"{ratios[0]:.1f} times the wall time, {ratios[1]:.1f} times the processor time")
            ratio = semgrep.processor / warm.processor
            print(f"{ratio:.1f} times the processor time of a warm scan of all files")
    if options.no_gates:
        gated = scan_paths([options.folder], jobs=options.jobs)
        start = time.perf_counter()
        ungated = scan_paths([options.folder], jobs=options.jobs, gate=False)
        same_places = places(ungated) == places(gated)
        print(f"without gates {time.perf_counter() - start:.0f} s of wall time, findings", end=" ")
        print("the same" if same_places else "DIFFER")
        for one in sorted(places(ungated) ^ places(gated)):
            print(f"  {one}")


if __name__ == "__main__":
    main()
