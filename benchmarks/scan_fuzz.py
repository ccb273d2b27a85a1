"""Try to make the scan crash, hang, swell or keep silent, with changed real files.

    python benchmarks/scan_fuzz.py FOLDER... [--seconds 600] [--seed 0] [--keep FOLDER]

Files of the folders are changed in ways that files go wrong (cut short, bytes flipped, lines lost
or doubled, brackets nested, expressions grown, NULs, other encodings) and scanned with the gates
off. What counts as a failure: an exception, more than 20 s of one processor on one file, more than
300 MB more memory than before, or a file that the parser of its language does not read and that
gives neither a finding nor an error. Failing inputs are kept.
"""

import argparse
import ast
import random
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from types import FrameType

from ransac_fix.scan.files import LANGUAGES, SourceFile
from ransac_fix.scan.scanner import FileResult, scan_file

_SECONDS = 20
_MEGABYTES = 300
_RULE = b"\nransac = log(1 - s) / log(1 - w**k)\n"


class _TooLong(BaseException):
    """One file took too long; no handler of the scan may swallow it."""


def changed(data: bytes, chance: random.Random, other: bytes) -> tuple[str, bytes]:
    """Change a file in one of the ways that files go wrong."""
    lines = data.split(b"\n")
    place = chance.randrange(len(data) + 1)
    line = chance.randrange(len(lines))
    match chance.randrange(17):
        case 0:
            return "cut short", data[:place]
        case 1:
            flipped = bytearray(data)
            for _ in range(chance.randrange(1, 20)):
                if flipped:
                    flipped[chance.randrange(len(flipped))] ^= 1 << chance.randrange(8)
            return "bits flipped", bytes(flipped)
        case 2:
            end = line + chance.randrange(1, 10)
            return "lines lost", b"\n".join(lines[:line] + lines[end:])
        case 3:
            end = line + chance.randrange(1, 30)
            return "lines doubled", b"\n".join(lines[:end] + lines[line:])
        case 4:
            chance.shuffle(lines)
            return "lines shuffled", b"\n".join(lines)
        case 5:
            depth = chance.choice((50, 90, 150, 400, 3000))
            opening, closing = chance.choice(((b"(", b")"), (b"[", b"]"), (b"{", b"}")))
            inner = b"x = " + opening * depth + b"1" + closing * depth + b"\n"
            return "nested", data[:place] + b"\n" + inner + data[place:]
        case 6:
            sign = chance.choice((b" + ", b" * ", b" ** ", b" / ", b" and ", b" < "))
            grown = (
                b"N = log(.1) / log(1 - w" + sign + sign.join([b"w"] * chance.choice((99, 3000)))
            )
            return "expression grown", data + b"\n" + grown + b")\n"
        case 7:
            return "NULs", data[:place] + b"\0" * chance.randrange(1, 9) + data[place:]
        case 8:
            code = chance.choice(("utf-16", "utf-32", "latin-1", "cp1252", "shift_jis", "utf-7"))
            return f"as {code}", data.decode("utf-8", "replace").encode(code, "replace")
        case 9:
            return "another coding line", b"# -*- coding: " + chance.choice(
                (b"latin-1", b"utf-16", b"rot13", b"hex", b"undefined", b"koi8-r", b"zlib")
            ) + b" -*-\n" + data
        case 10:
            return "spliced", data[:place] + other[chance.randrange(len(other) + 1) :]
        case 11:
            return "carriage returns", data.replace(b"\n", chance.choice((b"\r\n", b"\r", b"\n\r")))
        case 12:
            deep = b"".join(b" " * step + b"if x:\n" for step in range(chance.choice((90, 110))))
            return "blocks nested", data + b"\n" + deep + b" " * 120 + b"pass\n"
        case 13:
            swapped = data.replace(b"    ", b"\t", chance.randrange(1, 50))
            return "tabs among spaces", swapped
        case 14:
            odd = chance.choice(("\u2028", "\x0c", "\x1c", "\x85", "\ufeff", "\u200b", "\x00", "é"))
            return "odd characters", data[:place] + odd.encode() + data[place:]
        case 15:
            names = [f"f{number}" for number in range(chance.choice((20, 60)))]
            pairs = zip(names, [*names[1:], names[0]], strict=True)
            calls = "".join(f"def {a}(x): return {b}(x * x) ** {b}(x)\n" for a, b in pairs)
            return (
                "calls in a ring",
                data + b"\n" + calls.encode() + b"N=log(f0(2))/log(1-f1(3)**2)\n",
            )
        case _:
            loops = b"".join(b" " * step + b"for i in w:\n" for step in range(18))
            return "loops nested", data + b"\n" + loops + b" " * 18 + b"w = w * i ** w\n"


def is_silent(path: Path, result: FileResult) -> bool:
    """Whether a file that cannot be read was passed over without a word."""
    if result.errors or result.findings or path.suffix != ".py":
        return False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ast.parse(path.read_bytes())
    except (SyntaxError, ValueError, LookupError):
        # Python 2 may have been repaired: then it was read.
        from ransac_fix.scan.repair import repair
        from ransac_fix.scan.scanner import decode

        try:
            return repair(decode(path.read_bytes())) is None
        except (SyntaxError, ValueError, LookupError):
            return True
    except (RecursionError, MemoryError):
        return False
    return False


def _alarm(_signal: int, _frame: FrameType | None) -> None:
    raise _TooLong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("scan-fuzz"))
    options = parser.parse_args()
    chance = random.Random(options.seed)
    files = [
        path
        for folder in options.folders
        for path in sorted(folder.rglob("*"))
        if path.suffix.lower() in LANGUAGES and path.is_file() and path.stat().st_size < 200_000
    ]
    print(f"{len(files)} files, seed {options.seed}")
    options.keep.mkdir(parents=True, exist_ok=True)
    signal.signal(signal.SIGVTALRM, _alarm)
    tried: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    slowest, worst = 0.0, ""
    end = time.monotonic() + options.seconds
    while time.monotonic() < end:
        path, other = chance.choice(files), chance.choice(files)
        kind, data = "", path.read_bytes()
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            more, data = changed(data, chance, other.read_bytes())
            kind = f"{kind}+{more}" if kind else more
        if chance.random() < 0.5:
            data += _RULE
        target = options.keep / f"input{path.suffix.lower()}"
        target.write_bytes(data)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start = time.process_time()
        problem = ""
        signal.setitimer(signal.ITIMER_VIRTUAL, _SECONDS)
        try:
            language = LANGUAGES[path.suffix.lower()]
            result = scan_file(SourceFile(str(target), language, named=True), gate=False)
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            if is_silent(target, result):
                problem = "silent"
        except _TooLong:
            problem = "hang"
        except Exception:  # noqa: BLE001 -- what this looks for
            problem = f"crash: {traceback.format_exc().strip().splitlines()[-1]}"
            traceback.print_exc()
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        took = time.process_time() - start
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        if not problem and grown > _MEGABYTES:
            problem = f"{grown:.0f} MB"
        for one in kind.split("+"):
            tried[one] += 1
        if took > slowest:
            slowest, worst = took, f"{kind}: {path}"
        if problem:
            failed[problem.partition(":")[0]] += 1
            kept = options.keep / f"{sum(failed.values()):03}{path.suffix.lower()}"
            kept.write_bytes(data)
            print(f"FAILED {problem} ({kind}) {path} -> {kept}", flush=True)
    (options.keep / "input").unlink(missing_ok=True)
    print(f"{sum(tried.values())} changes: {dict(tried.most_common())}")
    print(f"slowest {slowest:.1f} s ({worst}); failed: {dict(failed) or 'none'}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"memory at most {peak:.0f} MB")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
