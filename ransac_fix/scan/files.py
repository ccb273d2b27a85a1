# ruff: noqa: PTH100, PTH110, PTH112, PTH113, PTH116, PTH118, PTH119, PTH120 -- os.path, because
# a scan asks it about tens of thousands of files and pathlib takes three times as long.
"""From the paths a user names to the files to scan.

A named file is always taken. Below a named folder, ``.gitignore`` files and the default excludes
hold; neither says anything about the named folder itself, so that naming an ignored folder, or
the ``site-packages`` of a virtual environment, scans it.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pathspec

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.findings import ScanError

LANGUAGES: dict[str, str] = {
    ".py": "python",
    ".pyi": "python",
    ".pyw": "python",
    ".ipynb": "notebook",
    **dict.fromkeys(
        (
            *(".c", ".cc", ".cpp", ".cxx", ".c++", ".h", ".hh", ".hpp", ".hxx", ".h++"),
            *(".inl", ".ipp", ".tpp", ".txx", ".cu", ".cuh"),
        ),
        "c++",
    ),
}

DEFAULT_EXCLUDES = (
    ".bzr",
    ".direnv",
    ".eggs",
    ".git",
    ".hg",
    ".ipynb_checkpoints",
    ".mypy_cache",
    ".nox",
    ".pytest_cache",
    ".ruff_cache",
    ".svn",
    ".tox",
    ".venv",
    "__pycache__",
    "__pypackages__",
    "node_modules",
    "site-packages",
    "venv",
)


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A file to scan."""

    path: str
    language: str
    named: bool


@dataclass(frozen=True, slots=True)
class _Ignores:
    """The patterns of one .gitignore, which hold below ``folder``."""

    folder: str
    spec: pathspec.GitIgnoreSpec

    def match(self, path: str, *, folder: bool) -> bool | None:
        """Say whether a path is ignored (True), kept by a ``!`` line (False), or neither."""
        relative = os.path.relpath(path, self.folder).replace(os.sep, "/")
        return self.spec.check_file(f"{relative}/" if folder else relative).include


def find_files(
    paths: Sequence[str],
    *,
    respect_gitignore: bool = True,
    excludes: Sequence[str] = DEFAULT_EXCLUDES,
    on_error: Callable[[ScanError], None] = lambda _: None,
) -> Iterator[SourceFile]:
    """Yield the files to scan, each once, in a stable order.

    Parameters
    ----------
    paths : sequence of str
        Files and folders, as the user named them.
    respect_gitignore : bool
        Whether ``.gitignore`` files hold below a named folder: those inside it, and those above
        it up to the root of the repository.
    excludes : sequence of str
        Names and gitignore patterns of what is left out below a named folder.
    on_error : callable
        Called with a :class:`ScanError` for each folder that cannot be read.

    Raises
    ------
    RansacFixError
        A path does not exist, or a named file is in no language that is scanned.
    """
    excluded = _Excludes(excludes)
    seen: set[tuple[int, int]] = set()
    for path in paths:
        if path == "":
            raise RansacFixError("cannot scan '': an empty path")
        if os.path.isdir(path):
            ignores = _ignores_above(path) if respect_gitignore else ()
            for file, identity in _walk(path, excluded, ignores, respect_gitignore, on_error):
                # A link to a file that was seen, or a folder named twice.
                if identity not in seen:
                    seen.add(identity)
                    yield file
        elif os.path.exists(path):
            language = _language(os.path.basename(path))
            if language is None:
                raise RansacFixError(
                    f"cannot scan {path}: not a file that ransac-fix reads"
                    f" ({', '.join(sorted(LANGUAGES))})"
                )
            status = os.stat(path)
            if (status.st_dev, status.st_ino) not in seen:
                seen.add((status.st_dev, status.st_ino))
                yield SourceFile(path, language, named=True)
        else:
            raise RansacFixError(f"cannot scan {path}: no such file or folder")


class _Excludes:
    """Patterns of what to leave out; bare names, which most are, without a pattern match."""

    def __init__(self, patterns: Sequence[str]) -> None:
        self._names = {pattern for pattern in patterns if not set(pattern) & set("*?[]!/\\ #")}
        rest = [pattern for pattern in patterns if pattern not in self._names]
        self._spec = pathspec.GitIgnoreSpec.from_lines(rest) if rest else None

    def match(self, name: str, path: str, root: str, *, folder: bool) -> bool:
        if name in self._names or self._spec is None:
            return name in self._names
        relative = path[len(root) :].replace(os.sep, "/").lstrip("/") if root != "." else path
        return self._spec.match_file(f"{relative}/" if folder else relative)


def _language(name: str) -> str | None:
    stem, dot, suffix = name.rpartition(".")
    return LANGUAGES.get(f"{dot}{suffix.lower()}") if stem.strip(".") else None


def _walk(
    root: str,
    excluded: _Excludes,
    ignores: tuple[_Ignores, ...],
    respect_gitignore: bool,
    on_error: Callable[[ScanError], None],
) -> Iterator[tuple[SourceFile, tuple[int, int]]]:
    """Walk one folder: its files, each with the numbers of its device and of itself.

    Links to folders are not followed, so there are no loops.
    """
    stack: list[tuple[str, tuple[_Ignores, ...]]] = [(root, ignores)]
    while stack:
        folder, above = stack.pop()
        try:
            with os.scandir(folder) as entries:
                listed = sorted(entries, key=lambda entry: entry.name)
        except OSError as error:
            on_error(ScanError(folder, _reason(error)))
            continue
        if respect_gitignore and any(entry.name == ".gitignore" for entry in listed):
            own = _read_gitignore(folder, on_error)
            above = (*above, own) if own is not None else above
        folders: list[tuple[str, tuple[_Ignores, ...]]] = []
        for entry in listed:
            is_folder = entry.is_dir(follow_symlinks=False)
            language = None if is_folder else _language(entry.name)
            if not is_folder and language is None:
                continue
            path = os.path.join(folder, entry.name) if folder != "." else entry.name
            if excluded.match(entry.name, path, root, folder=is_folder):
                continue
            if above and _is_ignored(os.path.abspath(path), above, folder=is_folder):
                continue
            if language is None:
                folders.append((path, above))
            elif entry.is_file():
                try:
                    status = os.stat(path)
                except OSError as error:
                    on_error(ScanError(path, _reason(error)))
                    continue
                yield SourceFile(path, language, named=False), (status.st_dev, status.st_ino)
        stack.extend(reversed(folders))


def _is_ignored(path: str, ignores: tuple[_Ignores, ...], *, folder: bool) -> bool:
    # The closest .gitignore that says anything decides.
    for one in reversed(ignores):
        verdict = one.match(path, folder=folder)
        if verdict is not None:
            return verdict
    return False


def _ignores_above(path: str) -> tuple[_Ignores, ...]:
    """Collect the .gitignore files from the root of the repository down to above ``path``."""
    named = os.path.abspath(path)
    chain: list[str] = []
    folder = named
    while not os.path.exists(os.path.join(folder, ".git")):
        parent = os.path.dirname(folder)
        if parent == folder:
            return ()  # not in a repository
        folder = parent
        chain.append(folder)
    found: list[_Ignores] = []
    for above in reversed(chain):
        if os.path.isfile(os.path.join(above, ".gitignore")):
            own = _read_gitignore(above, lambda _: None)
            # Patterns that ignore the named folder itself would ignore all that is in it.
            if own is not None and not own.match(named, folder=True):
                found.append(own)
    return tuple(found)


def _read_gitignore(folder: str, on_error: Callable[[ScanError], None]) -> _Ignores | None:
    path = os.path.join(folder, ".gitignore")
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
        return _Ignores(os.path.abspath(folder), pathspec.GitIgnoreSpec.from_lines(lines))
    except (OSError, ValueError) as error:
        on_error(ScanError(path, str(error) or type(error).__name__))
        return None


def _reason(error: OSError) -> str:
    return f"cannot be read: {error.strerror or error}"
