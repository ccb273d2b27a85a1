"""How long the scan of a tree takes: cold, warm, and next to reading it.

    python benchmarks/scan_speed.py FOLDER [--jobs N] [--no-gates]

``--no-gates`` scans once more with every gate off, which takes many minutes on a large tree, and
says whether the findings are the same.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

from ransac_fix.scan import ScanResult, scan_paths
from ransac_fix.scan.files import find_files


def timed(folder: Path, **options: object) -> tuple[float, ScanResult]:
    start = time.perf_counter()
    result = scan_paths([folder], **options)  # type: ignore[arg-type]
    return time.perf_counter() - start, result


def places(result: ScanResult) -> set[tuple[str, str, int]]:
    return {(one.code, one.location.path, one.location.start_line) for one in result.findings}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=-1)
    parser.add_argument("--no-gates", action="store_true")
    options = parser.parse_args()

    start = time.perf_counter()
    files = [file.path for file in find_files([str(options.folder)])]
    walked = time.perf_counter() - start
    start = time.perf_counter()
    size = sum(len(Path(path).read_bytes()) for path in files)
    read = time.perf_counter() - start
    print(f"{len(files)} files, {size / 1e6:.0f} MB; walk {walked:.2f} s, reading {read:.2f} s")

    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "scanned"
        cold, result = timed(options.folder, jobs=options.jobs, cache=cache)
        warm, again = timed(options.folder, jobs=options.jobs, cache=cache)
    assert places(again) == places(result)
    print(f"cold {cold:.2f} s ({cold / (walked + read):.1f} times walking and reading)")
    print(f"warm {warm:.2f} s ({warm / (walked + read):.1f} times)")
    print(f"findings {len(result.findings)}, errors {len(result.errors)}")
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    print(f"memory {max(one.ru_maxrss for one in usage) / 1024:.0f} MB at most in one process")
    if options.no_gates:
        slow, ungated = timed(options.folder, jobs=options.jobs, gate=False)
        same = places(ungated) == places(result)
        print(f"without gates {slow:.0f} s, findings {'the same' if same else 'DIFFER'}")
        for one in sorted(places(ungated) ^ places(result)):
            print(f"  {one}")


if __name__ == "__main__":
    main()
