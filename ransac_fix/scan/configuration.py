"""The scan's configuration: ``[tool.ransac-fix]`` of pyproject.toml, or ransac-fix.toml.

The closest file to a named path wins, whole: nothing is merged. What the command line says goes
over it.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from ransac_fix.errors import RansacFixError
from ransac_fix.scan.findings import FixStyle
from ransac_fix.scan.rules import choose


class Configuration(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="kebab", kw_only=True
):
    """What a project says about its scan. The JSON schema is `report/schemas/configuration.json`.

    Attributes
    ----------
    select : tuple of str
        Rules to check, by code or by the start of one; empty means the default ones.
    ignore : tuple of str
        Rules to leave out, spelled likewise.
    extend_exclude : tuple of str
        gitignore patterns of what to leave out, besides the defaults.
    respect_gitignore : bool
        Whether ``.gitignore`` files hold.
    fix_style : {"self-contained", "import"}
        Whether fixes add a function to the file, or import this package's.
    """

    select: Annotated[
        tuple[str, ...],
        Meta(
            description="Rules to check, by code or by the start of one; by default all but RFX101."
        ),
    ] = ()
    ignore: Annotated[
        tuple[str, ...], Meta(description="Rules to leave out, by code or by the start of one.")
    ] = ()
    extend_exclude: Annotated[
        tuple[str, ...],
        Meta(description="gitignore patterns of what to leave out, besides the defaults."),
    ] = ()
    respect_gitignore: Annotated[bool, Meta(description="Whether .gitignore files hold.")] = True
    fix_style: Annotated[
        FixStyle,
        Meta(description="Whether fixes add a function to the file, or import ransac_fix."),
    ] = "self-contained"


def configuration_schema() -> dict[str, Any]:
    """Return the JSON schema of ``[tool.ransac-fix]`` and of ransac-fix.toml."""
    schema = msgspec.json.schema(Configuration)
    own = schema["$defs"]["Configuration"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **own,
        "title": "ransac-fix configuration",
        "description": "[tool.ransac-fix] of pyproject.toml, or ransac-fix.toml",
    }


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
        found = msgspec.convert(table, Configuration)
        choose(found.select, found.ignore)
    except (msgspec.ValidationError, RansacFixError) as error:
        raise RansacFixError(f"cannot use the configuration {path}: {error}") from None
    return found
