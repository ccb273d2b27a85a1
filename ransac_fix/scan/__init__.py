"""Find stopping rules in source code.

From paths to files (``files``), to the small form (``python``, ``notebook``, ``cpp``), to resolved
expressions (``evaluate``, of ``nodes``), to sites (``recogniser``, by what ``algebra``,
``monomials``, ``logarithms`` and ``probability`` say; ``reading``), to findings (``rules``).
``scan_paths`` does it all.
"""

import gc
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import islice
from pathlib import Path

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.files import DEFAULT_EXCLUDES, LANGUAGES, SourceFile, find_files
from ransac_fix.scan.findings import (
    Cell,
    Certainty,
    Finding,
    FixStyle,
    Location,
    Related,
    ScanError,
    ScanResult,
    Severity,
)

__all__ = [
    "Cell",
    "Certainty",
    "Finding",
    "FixStyle",
    "Location",
    "Related",
    "ScanError",
    "ScanResult",
    "Severity",
    "scan_paths",
    "scan_text",
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
    cache: Path | None = None,
    fix_style: FixStyle = "self-contained",
    python: str | None = None,
    dask_scheduler: str | None = None,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
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
        checked whose findings depend on the file alone. Notes of a selected rule are warnings.
    gate : bool
        Whether files and definitions are set aside by their text alone. The findings are the same
        without, and take far longer.
    cache : Path, optional
        A file that remembers, by content, what was found to hold nothing.
    fix_style : {"self-contained", "import"}
        Whether fixes add a function to the file, or import this package's.
    python : str, optional
        The interpreter whose environment the files run in, for the rules that ask; this one by
        default.
    dask_scheduler : str, optional
        Address of a dask scheduler whose workers take the place of ``jobs``. Files are read here
        and only those that could hold a rule are sent, so nothing needs to be shared.
    progress : callable
        Called with how many files are done, and how many there are.

    Returns
    -------
    ScanResult
        Findings and errors, in order of path and place.

    Raises
    ------
    RansacFixError
        A path does not exist, a named file is in no language that is scanned, there is no such
        rule, or no such scheduler.
    """
    from ransac_fix.scan.rules import choose, default_codes

    codes = choose(select, ignore)
    if not set(codes) <= default_codes():
        cache = None  # what is found depends on more than the file
    errors: list[ScanError] = []
    found = find_files(
        [os.fspath(path) for path in paths],
        respect_gitignore=respect_gitignore,
        excludes=excludes,
        on_error=errors.append,
    )
    options = _Options(codes, gate, cache is not None, fix_style, python)
    known = frozenset[bytes]() if cache is None else _load(cache)
    files = list(islice(found, _PARALLEL_FROM))
    workers = None
    if jobs != 1 and len(files) == _PARALLEL_FROM and not known and dask_scheduler is None:
        workers = _Workers(jobs)  # they start while the rest is found
    files += found
    findings: list[Finding] = []
    new: set[bytes] = set()
    done = 0
    for batch in _scan_all(files, jobs, options, known, dask_scheduler, workers):
        done += batch.files
        progress(done, len(files))
        findings += batch.findings
        errors += batch.errors
        new |= batch.empty
    if cache is not None and not new <= known:
        from ransac_fix.scan.cache import save

        save(cache, known | new)
    findings = _raised(findings, select)
    if any(one.callee for one in findings):
        from ransac_fix.scan.callers import with_callers

        findings = with_callers(findings, files)
    findings.sort(
        key=lambda one: (one.location.path, one.location.start_line, one.location.start_column)
    )
    kept = tuple(one for one in findings if one.suppression is None)
    suppressed = tuple(one for one in findings if one.suppression is not None)
    errors.sort(key=lambda one: (one.path, one.line or 0))
    return ScanResult(kept, tuple(errors), len(files), suppressed)


def scan_text(
    data: bytes,
    path: str,
    *,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    fix_style: FixStyle = "self-contained",
    python: str | None = None,
) -> ScanResult:
    """Scan what is not in a file, such as standard input.

    Parameters
    ----------
    data : bytes
        The text, as a file of its language would hold it.
    path : str
        The name of the file that it stands for, which says its language; it is not opened. Python
        where the name says none.
    select, ignore, fix_style, python
        As for :func:`scan_paths`.

    Raises
    ------
    RansacFixError
        There is no such rule.
    """
    from ransac_fix.scan.rules import Settings, choose, find_rule
    from ransac_fix.scan.scanner import scan_data

    rules = [find_rule(code) for code in choose(select, ignore)]
    language = LANGUAGES.get(Path(path).suffix.lower(), "python")
    outcome = scan_data(
        data, SourceFile(path, language, named=True), rules, settings=Settings(fix_style, python)
    )
    findings = _raised(outcome.findings, select)
    kept = tuple(one for one in findings if one.suppression is None)
    suppressed = tuple(one for one in findings if one.suppression is not None)
    return ScanResult(kept, outcome.errors, 1, suppressed)


def _raised(findings: Iterable[Finding], select: Sequence[str]) -> list[Finding]:
    """Make warnings of the notes that were asked for."""
    asked = tuple(select)
    return [
        replace(one, severity="warning")
        if one.severity == "note" and one.code.startswith(asked)
        else one
        for one in findings
    ]


@dataclass(frozen=True, slots=True)
class _Options:
    codes: tuple[str, ...]
    gate: bool
    remember: bool
    fix_style: FixStyle
    python: str | None


@dataclass(slots=True)
class _Batch:
    findings: list[Finding] = field(default_factory=list)
    errors: list[ScanError] = field(default_factory=list)
    empty: set[bytes] = field(default_factory=set)
    files: int = 0


def _scan_all(
    files: Sequence[SourceFile],
    jobs: int,
    options: _Options,
    known: frozenset[bytes],
    dask_scheduler: str | None,
    workers: "_Workers | None",
) -> Iterator[_Batch]:
    least = _BATCH
    if known:
        # Here, before any worker is started: to read and search a file is less than to send it.
        least = 1  # what is left takes long
        left: list[SourceFile] = []
        for start in range(0, len(files), _BATCH):
            batch = files[start : start + _BATCH]
            unknown = _unknown(batch, options, known)
            left += unknown
            yield _Batch(files=len(batch) - len(unknown))
        files = left
    size = max(least, len(files) // 64)
    batches = [files[start : start + size] for start in range(0, len(files), size)]
    if dask_scheduler is None and (jobs == 1 or len(files) < _PARALLEL_FROM):
        yield from (_scan_batch(batch, options) for batch in batches)
        return
    if dask_scheduler is None:
        yield from (workers or _Workers(jobs)).scan(batches, options)
        return
    import joblib

    from ransac_fix.scan.rules import default_codes
    from ransac_fix.workers import workers as dask_workers

    with dask_workers(dask_scheduler):
        if not set(options.codes) <= default_codes():
            raise RansacFixError("RFX101 asks about this environment: leave it or --dask out")
        options = replace(options, remember=False)
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        yield from parallel(
            joblib.delayed(_scan_sent)(_read_batch(batch, options), options) for batch in batches
        )


class _Workers:
    """Worker processes, which start and load the scanner while other things are done here."""

    def __init__(self, jobs: int) -> None:
        import joblib

        self._parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        number = joblib.effective_n_jobs(jobs)
        self._starting = self._parallel(joblib.delayed(_load_scanner)() for _ in range(number))

    def scan(self, batches: Sequence[Sequence[SourceFile]], options: _Options) -> Iterator[_Batch]:
        """Scan batches of files; what comes first is given first."""
        import joblib

        deque(self._starting, maxlen=0)
        yield from self._parallel(joblib.delayed(_scan_batch)(batch, options) for batch in batches)


def _load_scanner() -> None:
    import_module("ransac_fix.scan.scanner")


@dataclass(frozen=True, slots=True)
class _Sent:
    """What is sent to another machine: the files that could matter, and what was wrong here."""

    contents: list[tuple[SourceFile, bytes]]
    errors: list[ScanError]
    files: int


def _read_batch(files: Sequence[SourceFile], options: _Options) -> _Sent:
    from ransac_fix.scan.rules import find_rule
    from ransac_fix.scan.scanner import is_gated, read_file

    rules = [find_rule(code) for code in options.codes]
    sent = _Sent([], [], len(files))
    for file in files:
        data = read_file(file)
        if isinstance(data, ScanError):
            sent.errors.append(data)
        elif not (options.gate and is_gated(data, file, rules)):
            sent.contents.append((file, data))
    return sent


def _scan_sent(sent: _Sent, options: _Options) -> _Batch:
    from ransac_fix.scan.rules import Settings, find_rule
    from ransac_fix.scan.scanner import scan_data

    rules = [find_rule(code) for code in options.codes]
    batch = _Batch(errors=list(sent.errors), files=sent.files)
    settings = Settings(options.fix_style, options.python)
    with _uncollected():
        for file, data in sent.contents:
            outcome = scan_data(data, file, rules, gate=options.gate, settings=settings)
            batch.findings.extend(outcome.findings)
            batch.errors.extend(outcome.errors)
    return batch


@contextmanager
def _uncollected() -> Iterator[None]:
    """Keep the garbage collector out: syntax trees are many objects, and free themselves."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _load(path: Path) -> frozenset[bytes]:
    from ransac_fix.scan.cache import load

    return load(path)


def _unknown(
    files: Sequence[SourceFile], options: _Options, known: frozenset[bytes]
) -> list[SourceFile]:
    from ransac_fix.scan.rules import find_rule
    from ransac_fix.scan.scanner import is_known

    rules = [find_rule(code) for code in options.codes]
    return [file for file in files if not is_known(file, rules, known, gate=options.gate)]


def _scan_batch(files: Sequence[SourceFile], options: _Options) -> _Batch:
    from ransac_fix.scan.rules import Settings, find_rule
    from ransac_fix.scan.scanner import scan_file

    rules = [find_rule(code) for code in options.codes]
    remember = options.remember
    batch = _Batch(files=len(files))
    settings = Settings(options.fix_style, options.python)
    with _uncollected():
        for file in files:
            outcome = scan_file(
                file, rules, gate=options.gate, remember=remember, settings=settings
            )
            batch.findings.extend(outcome.findings)
            batch.errors.extend(outcome.errors)
            if outcome.digest is not None:
                batch.empty.add(outcome.digest)
    return batch
