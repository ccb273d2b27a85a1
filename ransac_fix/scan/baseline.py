"""A baseline: the findings that a project knows of, so that only new ones are reported.

Findings are known by path, rule and normalised source, never by line; of several that are the
same the number counts.
"""

import json
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.findings import Finding, ScanResult

SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True, order=True)
class Known:
    """What a finding is known by."""

    path: str
    code: str
    expression: str


@dataclass(frozen=True, slots=True)
class Compared:
    """A scan next to a baseline.

    Attributes
    ----------
    result : ScanResult
        What is new.
    known : int
        How many findings the baseline knows of.
    gone : tuple of Known
        What the baseline knows of in these paths and the scan did not find: fixed since.
    """

    result: ScanResult
    known: int
    gone: tuple[Known, ...]


def _key(finding: Finding, root: Path) -> Known:
    # Paths relative to the baseline's own folder, so that it holds wherever the scan starts.
    relative = os.path.relpath(Path(finding.location.path).absolute(), root)
    return Known(PurePosixPath(Path(relative)).as_posix(), finding.code, finding.expression)


def write_baseline(findings: Iterable[Finding], path: Path) -> int:
    """Write the findings of a scan as the baseline; return how many there are.

    Raises
    ------
    RansacFixError
        The file cannot be written.
    """
    counted = Counter(_key(finding, path.absolute().parent) for finding in findings)
    entries = [
        {"path": one.path, "code": one.code, "expression": one.expression, "count": count}
        for one, count in sorted(counted.items())
    ]
    document = {"schema_version": SCHEMA_VERSION, "findings": entries}
    try:
        path.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise RansacFixError(f"cannot write the baseline {path}: {error.strerror}") from None
    return sum(counted.values())


def compare(result: ScanResult, path: Path, scanned: Sequence[str | os.PathLike[str]]) -> Compared:
    """Take what a baseline knows of out of a scan.

    Parameters
    ----------
    result : ScanResult
    path : Path
        The baseline.
    scanned : sequence of path
        The files and folders that were scanned: of others nothing is known.

    Raises
    ------
    RansacFixError
        There is no such file, or it is no baseline.
    """
    left = _read(path)
    new: list[Finding] = []
    known = 0
    for finding in result.findings:
        key = _key(finding, path.absolute().parent)
        if left[key] > 0:
            left[key] -= 1
            known += 1
        else:
            new.append(finding)
    root = path.absolute().parent
    below = [Path(one).absolute() for one in scanned]
    gone = tuple(
        known for known in sorted(left.elements()) if _is_below((root / known.path), below)
    )
    return Compared(replace(result, findings=tuple(new)), known, gone)


def _is_below(path: Path, folders: Sequence[Path]) -> bool:
    path = Path(os.path.normpath(path))
    return any(path.is_relative_to(os.path.normpath(one)) for one in folders)


def _read(path: Path) -> Counter[Known]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RansacFixError(f"cannot read the baseline {path}: {error.strerror}") from None
    except ValueError as error:
        raise RansacFixError(f"cannot read the baseline {path}: {error}") from None
    try:
        if document["schema_version"] != SCHEMA_VERSION:
            raise RansacFixError(
                f"cannot read the baseline {path}: its version is {document['schema_version']},"
                " write it again with `ransac-fix baseline update`"
            )
        return Counter(
            {
                Known(one["path"], one["code"], one["expression"]): int(one["count"])
                for one in document["findings"]
            }
        )
    except (KeyError, TypeError, ValueError):
        raise RansacFixError(f"cannot read the baseline {path}: not a baseline") from None
