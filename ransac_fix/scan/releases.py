"""Which release of a distribution a file runs with: installed, locked or required.

Nothing is imported: installed releases are read from their metadata, and of the files of a project
only the text. The closest folder that names the distribution decides; in it a lock file goes before
requirements, and those before ``pyproject.toml``.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from ransac_fix.errors import RansacFixError

_LOCKS = ("uv.lock", "poetry.lock", "pdm.lock", "pylock.toml", "Pipfile.lock")
_INCLUDE = re.compile(r"^(?:-r|--requirement|-c|--constraint)[ =]?\s*(\S+)")
_CARET = re.compile(r"^\^\s*(\d+)(?:\.(\d+))?(?:\.(\d+))?")
_MAX_FILES = 50


@dataclass(frozen=True, slots=True)
class Release:
    """What is said of the release of a distribution.

    Attributes
    ----------
    distribution : str
        Its name, as it is written there.
    version : str or None
        The release, where there is one.
    range : str or None
        Else what it must satisfy, such as ``>=4.8,<5``; "" for any.
    path : str or None
        The file that says so; None for an environment.
    line : int
    """

    distribution: str
    version: str | None
    range: str | None = None
    path: str | None = None
    line: int = 1


def release_of(distributions: Sequence[str], path: str, python: str | None) -> Release | None:
    """Find the release of one of some distributions that a file runs with.

    Parameters
    ----------
    distributions : sequence of str
        Names of the same library.
    path : str
        The file.
    python : str or None
        The interpreter of the environment to look into first; this one by default.

    Returns
    -------
    Release or None
        None where neither the environment nor a file of the project names any of them.

    Raises
    ------
    RansacFixError
        ``python`` cannot be asked.
    """
    wanted = [canonicalize_name(name) for name in distributions]
    installed = _installed(python)
    for name in wanted:
        if name in installed:
            return Release(name, installed[name])
    folder = Path(path).absolute().parent
    for above in (folder, *folder.parents):
        stated = _stated_in(str(above))
        for name in wanted:
            if name in stated:
                return replace(stated[name], path=_seen_from_here(stated[name].path))
        if (above / ".git").exists():
            break
    return None


def _seen_from_here(path: str | None) -> str | None:
    """Spell a path as those of findings are where they are named from here."""
    here = Path.cwd()
    if path is None or not Path(path).is_relative_to(here):
        return path
    return str(Path(path).relative_to(here))


@lru_cache(maxsize=4)
def _installed(python: str | None) -> dict[str, str]:
    found: dict[str, str] = {}
    for one in metadata.distributions(path=_search_path(python)):
        name = one.metadata["Name"]
        if name:
            found.setdefault(canonicalize_name(name), one.version)
    return found


def _search_path(python: str | None) -> list[str]:
    if python is None:
        return sys.path
    command = [python, "-I", "-c", "import json, sys; print(json.dumps(sys.path))"]
    try:
        answer = subprocess.run(  # noqa: S603 -- an interpreter that the user named
            command, capture_output=True, text=True, timeout=60, check=True
        )
        return [str(one) for one in json.loads(answer.stdout)]
    except (OSError, subprocess.SubprocessError, ValueError) as error:
        raise RansacFixError(f"cannot ask {python} for its packages: {error}") from None


@lru_cache(maxsize=4096)
def _stated_in(folder: str) -> dict[str, Release]:
    """Read what the files of one folder say, the first to name a distribution first."""
    found: dict[str, Release] = {}
    try:
        names = sorted(os.listdir(folder))  # noqa: PTH208 -- names alone
    except OSError:
        return found
    locks = [name for name in _LOCKS if name in names]
    requirements = [
        name for name in names if re.fullmatch(r"(?:.*[-_.])?requirements?(?:[-_.].*)?\.txt", name)
    ]
    for name in locks:
        for release in _lock(Path(folder, name)):
            found.setdefault(canonicalize_name(release.distribution), release)
    for name in requirements:
        for release in _requirements(Path(folder, name), set()):
            found.setdefault(canonicalize_name(release.distribution), release)
    if "requirements" in names:
        for path in sorted(Path(folder, "requirements").glob("*.txt")):
            for release in _requirements(path, set()):
                found.setdefault(canonicalize_name(release.distribution), release)
    if "pyproject.toml" in names:
        for release in _project(Path(folder, "pyproject.toml")):
            found.setdefault(canonicalize_name(release.distribution), release)
    return found


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError:
        return ""


def _toml(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except ValueError:
        return {}


def _lock(path: Path) -> Iterator[Release]:
    text = _text(path)
    if path.name == "Pipfile.lock":
        try:
            document = json.loads(text)
        except ValueError:
            return
        for group in ("default", "develop"):
            listed = document.get(group) if isinstance(document, dict) else None
            for name, entry in listed.items() if isinstance(listed, dict) else ():
                version = entry.get("version") if isinstance(entry, dict) else None
                if isinstance(version, str) and version.startswith("=="):
                    line = _line(text, f'"{name}"')
                    yield Release(name, version[2:], path=str(path), line=line)
        return
    document = _toml(text)
    for key in ("package", "packages"):
        listed = document.get(key)
        for entry in listed if isinstance(listed, list) else ():
            name, version = entry.get("name"), entry.get("version")
            if isinstance(name, str) and isinstance(version, str):
                line = _line(text, f'name = "{name}"')
                yield Release(name, version, path=str(path), line=line)


def _requirements(path: Path, seen: set[Path]) -> Iterator[Release]:
    if path in seen or len(seen) > _MAX_FILES:
        return
    seen.add(path)
    text = _text(path)
    number = 0
    pending = ""
    start = 1
    for number, raw in enumerate(text.splitlines(), 1):
        if not pending:
            start = number
        line = pending + re.sub(r"(?:^|\s)#.*$", "", raw).strip()
        if line.endswith("\\"):
            pending = f"{line[:-1]} "
            continue
        pending = ""
        include = _INCLUDE.match(line)
        if include:
            yield from _requirements(Path(path.parent, include[1]), seen)
        elif line and not line.startswith("-"):
            release = _requirement(re.sub(r"\s--?\w[\w-]*[= ].*$", "", line), path, start)
            if release is not None:
                yield release


def _project(path: Path) -> Iterator[Release]:
    text = _text(path)
    document = _toml(text)
    project = _table(document.get("project"))
    lists = [project.get("dependencies")]
    lists += _table(project.get("optional-dependencies")).values()
    lists += _table(document.get("dependency-groups")).values()
    for listed in lists:
        for entry in listed if isinstance(listed, list) else ():
            if isinstance(entry, str):
                release = _requirement(entry, path, _line(text, entry))
                if release is not None:
                    yield release
    poetry = _table(_table(document.get("tool")).get("poetry"))
    tables = [poetry.get("dependencies"), poetry.get("dev-dependencies")]
    tables += [_table(group).get("dependencies") for group in _table(poetry.get("group")).values()]
    for table in tables:
        for name, entry in _table(table).items():
            spec = _table(entry).get("version") if isinstance(entry, dict) else entry
            if isinstance(spec, str) and name != "python":
                wanted = f"{name}{_from_poetry(spec)}"
                release = _requirement(wanted, path, _line(text, name))
                if release is not None:
                    yield release


def _table(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _from_poetry(spec: str) -> str:
    """Write ``^1.2`` and ``1.2`` as specifiers."""
    caret = _CARET.match(spec)
    if caret:
        parts = [int(part) for part in caret.groups() if part is not None]
        place = next((n for n, part in enumerate(parts) if part), len(parts) - 1)
        upper = [*parts[:place], parts[place] + 1]
        return f">={spec[1:].strip()},<{'.'.join(map(str, upper))}"
    if spec.strip() == "*":
        return ""
    if spec.startswith("~") and not spec.startswith("~="):
        return f"~={spec[1:].strip()}" if "." in spec else f"=={spec[1:].strip()}.*"
    return f"=={spec}" if spec[:1].isdigit() else spec


def _requirement(text: str, path: Path, line: int) -> Release | None:
    try:
        read = Requirement(text.strip())
    except InvalidRequirement:
        return None
    exact = [
        one for one in read.specifier if one.operator in ("==", "===") and "*" not in one.version
    ]
    version = exact[0].version if exact else None
    wanted = None if version else ",".join(sorted(map(str, read.specifier), reverse=True))
    return Release(read.name, version, wanted, str(path), line)


def _line(text: str, wanted: str) -> int:
    place = text.find(wanted)
    return 1 if place < 0 else text.count("\n", 0, place) + 1


def within(versions: Iterable[str], wanted: str) -> list[str]:
    """Keep the versions that satisfy a range."""
    return list(SpecifierSet(wanted).filter(versions, prereleases=True))
