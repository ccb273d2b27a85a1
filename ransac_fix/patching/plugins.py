"""Find the patches: entry points of the group ``ransac_fix.patches``, and the names users type."""

import re
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType

from packaging.requirements import Requirement

from ransac_fix.errors import RansacFixError
from ransac_fix.patching.interface import LibraryPatch

__all__ = ["GROUP", "Plugins", "discover", "resolve"]

GROUP = "ransac_fix.patches"


@dataclass(frozen=True, slots=True)
class Plugins:
    """The patches found, and the reasons why others could not be loaded, both by system."""

    patches: dict[str, LibraryPatch]
    broken: dict[str, str]


@cache
def discover() -> Plugins:
    """Load every patch that is installed. One that cannot be loaded does not disturb others."""
    patches: dict[str, LibraryPatch] = {}
    broken: dict[str, str] = {}
    # Our own first: another package cannot take a name from us by accident.
    points = sorted(entry_points(group=GROUP), key=lambda point: not _is_own(point))
    for point in points:
        try:
            patch = _load(point)
        except (Exception, SystemExit) as error:  # noqa: BLE001 -- a stranger's code
            broken[point.name] = f"{point.value} cannot be loaded: {_line(error)}"
            continue
        if patch.system not in patches:
            patches[patch.system] = patch
        elif patches[patch.system] is not patch and not _is_own(point):
            broken[point.value] = f"there is another patch for {patch.system}"
    return Plugins(patches, broken)


def resolve(name: str) -> str:
    """Return the system that a system, distribution or import name stands for.

    Raises
    ------
    RansacFixError
        If there is no patch of that name.
    """
    plugins = discover()
    wanted = _normal(name)
    for system, patch in plugins.patches.items():
        if wanted in _names(patch):
            return system
    for system in plugins.broken:
        if wanted == _normal(system):
            return system
    alias = _known_system(name)
    if alias in plugins.patches:
        return alias
    known = ", ".join(sorted(plugins.patches))
    raise RansacFixError(f"there is no patch for {name!r}; there are patches for {known}")


def distributions(patch: LibraryPatch) -> tuple[str, ...]:
    """Return the distribution names in the requirements of a patch."""
    return tuple(dict.fromkeys(Requirement(text).name for text in patch.requirements))


def imports(patch: LibraryPatch) -> tuple[str, ...]:
    """Return the top-level import names of a patch."""
    return tuple(dict.fromkeys(module.partition(".")[0] for module in patch.modules))


def _names(patch: LibraryPatch) -> set[str]:
    return {_normal(name) for name in (patch.system, *distributions(patch), *imports(patch))}


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _known_system(name: str) -> str:
    """Return the system of a name that only the table of systems knows."""
    from ransac_fix.systems import find_system

    try:
        return find_system(name).name
    except RansacFixError:
        return name


def _is_own(point: EntryPoint) -> bool:
    return point.value.startswith("ransac_fix.")


def _load(point: EntryPoint) -> LibraryPatch:
    value = point.load()
    patch = getattr(value, "PATCH", None) if isinstance(value, ModuleType) else value
    if not isinstance(patch, LibraryPatch):
        raise TypeError("it has no LibraryPatch named PATCH")
    if not patch.system or not patch.modules or not patch.requirements:
        raise ValueError("its LibraryPatch lacks a system, a module or a requirement")
    for module in patch.modules:
        if not all(part.isidentifier() for part in module.split(".")):
            raise ValueError(f"{module!r} is not the name of a module")
    for requirement in patch.requirements:
        Requirement(requirement)
    return patch


def _line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
