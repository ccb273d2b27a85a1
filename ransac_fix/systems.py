"""What is known of each RANSAC implementation: facts as data, read from ``systems.toml``.

They are hints about where to look and what to beware of. What a library does is measured.
"""

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

from ransac_fix.errors import RansacFixError

__all__ = ["Site", "System", "find_system", "load_systems"]


@dataclass(frozen=True, slots=True)
class Site:
    """A place in a system's source where a stopping rule stands.

    Parameters
    ----------
    path : str
        The file, relative to the root of the upstream repository.
    symbol : str
        The function, or a few words where it has no name of its own.
    """

    path: str
    symbol: str


@dataclass(frozen=True, slots=True)
class System:
    """One RANSAC implementation.

    Parameters
    ----------
    name : str
        The name used on the command line and in reports.
    upstream : str
        The source repository, ``owner/name``.
    language : str
        The language its rule is written in.
    sampler : str
        How a minimal sample is drawn: ``distinct``, ``replacement``, ``stratified`` or ``local``.
    stopping : str
        The probability its rule assumes: ``approximate``, ``exact`` or ``other``.
    evidence : str
        ``measured`` if the behaviour of a release was measured, else ``unmeasured``.
    note : str
        What to beware of.
    distributions, modules, debian : tuple of str
        Its names on PyPI, in Python, and in Debian.
    sites : tuple of Site
        Where the rules stand in source.
    """

    name: str
    upstream: str
    language: str
    sampler: str
    stopping: str
    evidence: str
    note: str
    distributions: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()
    debian: tuple[str, ...] = ()
    sites: tuple[Site, ...] = ()


@lru_cache(maxsize=1)
def load_systems() -> tuple[System, ...]:
    """Return every known system, in the order of ``systems.toml``."""
    tables = tomllib.loads(files("ransac_fix").joinpath("systems.toml").read_text("utf-8"))
    systems = []
    for name, table in tables.items():
        for key in ("distributions", "modules", "debian"):
            table[key] = tuple(table.get(key, ()))
        table["sites"] = tuple(Site(**site) for site in table.get("sites", ()))
        systems.append(System(name=name, **table))
    return tuple(systems)


def find_system(name: str) -> System:
    """Return the system with this system, distribution, import or Debian package name.

    Case does not matter, and ``-``, ``_`` and ``.`` are one, as in package names.

    Raises
    ------
    RansacFixError
        If no system has the name; the message lists those that exist.
    """
    wanted = _normalised(name)
    systems = load_systems()
    for of_system in (
        lambda system: (system.name,),
        lambda system: system.distributions,
        lambda system: system.modules,
        lambda system: system.debian,
    ):
        for system in systems:
            if wanted in map(_normalised, of_system(system)):
                return system
    known = ", ".join(system.name for system in systems)
    raise RansacFixError(f"unknown system {name!r}: use one of {known}")


def _normalised(name: str) -> str:
    return name.lower().replace("_", "-").replace(".", "-")
