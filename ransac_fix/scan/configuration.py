"""The scan's configuration: ``[tool.ransac-fix]`` of pyproject.toml, or ransac-fix.toml.

The closest file to a named path wins, whole: nothing is merged. What the command line says goes
over it.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from ransac_fix.errors import RansacFixError


class Configuration(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="kebab", kw_only=True
):
    """What a project says about its scan.

    Attributes
    ----------
    select : tuple of str
        Rules to check, by code or by the start of one; empty means all.
    ignore : tuple of str
        Rules to leave out, spelled likewise.
    extend_exclude : tuple of str
        gitignore patterns of what to leave out, besides the defaults.
    respect_gitignore : bool
        Whether ``.gitignore`` files hold.
    """

    select: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    extend_exclude: tuple[str, ...] = ()
    respect_gitignore: bool = True


def find_configuration(paths: Sequence[str]) -> Configuration:
    """Find the configuration of a scan: the closest to the first named path.

    Raises
    ------
    RansacFixError
        The file is no TOML, or holds a key or a value that does not belong there.
    """
    folder = Path(paths[0] if paths else ".").absolute()
    if not folder.is_dir():
        folder = folder.parent
    for above in (folder, *folder.parents):
        own = above / "ransac-fix.toml"
        if own.is_file():
            return _convert(_load(own), own)
        project = above / "pyproject.toml"
        if project.is_file():
            table = _load(project).get("tool", {}).get("ransac-fix")
            if table is not None:
                return _convert(table, project)
    return Configuration()


def _load(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RansacFixError(f"cannot read the configuration {path}: {error}") from None


def _convert(table: object, path: Path) -> Configuration:
    try:
        return msgspec.convert(table, Configuration)
    except msgspec.ValidationError as error:
        raise RansacFixError(f"cannot use the configuration {path}: {error}") from None
