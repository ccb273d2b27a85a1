"""Find stopping rules in source code.

From paths to files (``files``), to the small form (``python``, ``notebook``), to resolved
expressions (``evaluate``), to sites (``algebra``, ``recogniser``, ``reading``), to findings
(``rules``). ``scan_paths`` does it all.
"""

import os
from collections.abc import Iterable, Sequence

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.files import DEFAULT_EXCLUDES, SourceFile, find_files
from ransac_fix.scan.findings import (
    Cell,
    Certainty,
    Finding,
    Location,
    Related,
    ScanError,
    ScanResult,
)

__all__ = [
    "Cell",
    "Certainty",
    "Finding",
    "Location",
    "Related",
    "ScanError",
    "ScanResult",
    "scan_paths",
]

# Starting worker processes pays from this many files on.
_PARALLEL_FROM = 200
_BATCH = 64


def scan_paths(
    paths: Sequence[str | os.PathLike[str]],
    *,
    jobs: int = 1,
    respect_gitignore: bool = True,
    excludes: Sequence[str] = DEFAULT_EXCLUDES,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    gate: bool = True,
) -> ScanResult:
    """Scan files and folders.

    Parameters
    ----------
    paths : sequence of path
        Files, always scanned, and folders, scanned below.
    jobs : int
        Worker processes; 1 scans in this process, -1 uses every core.
    respect_gitignore : bool
        Whether ``.gitignore`` files hold below a named folder.
    excludes : sequence of str
        gitignore patterns of what is left out below a named folder.
    select, ignore : sequence of str
        Rules to check and rules to leave out, by code or by the start of one; by default all are
        checked.
    gate : bool
        Whether files and definitions are set aside by their text alone. The findings are the same
        without, and take far longer.

    Returns
    -------
    ScanResult
        Findings and errors, in order of path and place.

    Raises
    ------
    RansacFixError
        A path does not exist, a named file is in no language that is scanned, or there is no
        such rule.
    """
    codes = _chosen(select, ignore)
    errors: list[ScanError] = []
    files = list(
        find_files(
            [os.fspath(path) for path in paths],
            respect_gitignore=respect_gitignore,
            excludes=excludes,
            on_error=errors.append,
        )
    )
    findings: list[Finding] = []
    for found, failed in _scan_all(files, jobs, codes, gate=gate):
        findings += found
        errors += failed
    findings.sort(
        key=lambda one: (one.location.path, one.location.start_line, one.location.start_column)
    )
    kept = tuple(one for one in findings if one.suppression is None)
    suppressed = tuple(one for one in findings if one.suppression is not None)
    errors.sort(key=lambda one: (one.path, one.line or 0))
    return ScanResult(kept, tuple(errors), len(files), suppressed)


_Outcome = tuple[Sequence[Finding], Sequence[ScanError]]


def _chosen(select: Sequence[str], ignore: Sequence[str]) -> tuple[str, ...]:
    from ransac_fix.scan.rules import all_rules

    known = [rule.code for rule in all_rules()]
    for start in (*select, *ignore):
        if not start or not any(code.startswith(start) for code in known):
            raise RansacFixError(f"no rule {start!r}; the rules are {', '.join(known)}")
    return tuple(
        code
        for code in known
        if (not select or code.startswith(tuple(select))) and not code.startswith(tuple(ignore))
    )


def _scan_all(
    files: Sequence[SourceFile], jobs: int, codes: Sequence[str], *, gate: bool
) -> Iterable[_Outcome]:
    if jobs == 1 or len(files) < _PARALLEL_FROM:
        return _scan_batch(files, codes, gate=gate)
    import joblib

    batches = [files[start : start + _BATCH] for start in range(0, len(files), _BATCH)]
    results: list[list[_Outcome]] = joblib.Parallel(n_jobs=jobs)(
        joblib.delayed(_scan_batch)(batch, codes, gate=gate) for batch in batches
    )
    return (one for batch in results for one in batch)


def _scan_batch(files: Sequence[SourceFile], codes: Sequence[str], *, gate: bool) -> list[_Outcome]:
    from ransac_fix.scan.rules import find_rule
    from ransac_fix.scan.scanner import scan_file

    rules = [find_rule(code) for code in codes]
    return [scan_file(file, rules, gate=gate) for file in files]
