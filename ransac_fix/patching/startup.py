"""Patches in processes that are started from a patched one.

Threads and forked processes share or copy what is patched. A fresh interpreter (joblib's loky,
multiprocessing's spawn, a subprocess) has only its environment: `environment` puts a folder with
a ``sitecustomize`` module on ``PYTHONPATH`` and the modules to wait for in ``RANSAC_FIX_WATCH``,
and `begin`, called from there, installs the import hook. It imports next to nothing until one of
those modules is imported. A ``sitecustomize`` that was there before still runs.

``ransac-fix site enable`` (`ransac_fix.patching.site`) reaches every program of an environment
instead: a ``.pth`` file calls `begin` with the modules to wait for.

``RANSAC_FIX=0`` in the environment switches everything off.
"""

from __future__ import annotations

import os
import sys

from ransac_fix.patching import finder

TYPE_CHECKING = False  # what type checkers take for true; `typing` takes too long to import
if TYPE_CHECKING:
    from collections.abc import Mapping, MutableMapping
    from types import ModuleType

__all__ = [
    "begin",
    "environment",
    "is_enabled_for_site",
    "is_inherited",
    "listed",
    "off",
    "parsed",
    "watched",
]

SWITCH = "RANSAC_FIX"
WATCH = "RANSAC_FIX_WATCH"
TRACE = "RANSAC_FIX_TRACE"
_FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "_site")  # noqa: PTH118, PTH120, PTH100 -- pathlib is slow to import


# What the environment's .pth file asked for, in the form of the variable WATCH.
_site = ""


def off() -> bool:
    """Return whether ``RANSAC_FIX=0`` is set."""
    return os.environ.get(SWITCH) == "0"


def is_enabled_for_site() -> bool:
    """Return whether this process was started to be patched by the environment's .pth file."""
    return bool(_site)


def is_inherited() -> bool:
    """Return whether processes started now are patched from their start."""
    return WATCH in os.environ and not off()


def watched() -> dict[str, tuple[str, ...]]:
    """Return the systems that this process was started to patch, with their modules."""
    return parsed(f"{_site};{os.environ.get(WATCH, '')}")


def parsed(text: str) -> dict[str, tuple[str, ...]]:
    """Return systems and their modules from a line of text, as `listed` writes it."""
    systems = {}
    for entry in text.split(";"):
        system, _, modules = entry.partition("=")
        if system and modules:
            systems[system] = tuple(modules.split(","))
    return systems


def trace_folder() -> str:
    """Return the folder for records of RANSAC calls, empty where this process is not traced."""
    return os.environ.get(TRACE, "").partition(";")[0]


def environment(environ: MutableMapping[str, str], systems: Mapping[str, tuple[str, ...]]) -> None:
    """Change an environment so that processes started with it patch the given systems.

    Parameters
    ----------
    environ : mutable mapping
        ``os.environ`` or a copy.
    systems : mapping
        System -> modules to wait for. Where it is empty the environment is cleaned.
    """
    before = environ.get("PYTHONPATH")
    path = [entry for entry in before.split(os.pathsep) if entry != _FOLDER] if before else []
    if systems:
        environ[WATCH] = listed(systems)
    else:
        environ.pop(WATCH, None)
    if systems or TRACE in environ:
        path.insert(0, _FOLDER)
    if path:
        environ["PYTHONPATH"] = os.pathsep.join(path)
    else:
        environ.pop("PYTHONPATH", None)


def listed(systems: Mapping[str, tuple[str, ...]]) -> str:
    """Return systems and their modules as one line of text, as `watched` reads it."""
    return ";".join(f"{name}={','.join(systems[name])}" for name in sorted(systems))


def begin(site: str = "") -> None:
    """Start waiting for the modules of `watched`.

    Parameters
    ----------
    site : str
        More of them, as `listed` gives them. ``sitecustomize`` calls without, a .pth file with.
    """
    global _site
    if off():
        return
    if site:
        _site = site
    traced = parsed(os.environ.get(TRACE, "").partition(";")[2])
    for modules in [*watched().values(), *traced.values()]:
        finder.watch(modules, _imported)


def _imported(module: ModuleType) -> None:
    # The engine takes over what `watched` names when it is loaded.
    try:
        from ransac_fix.patching import engine
    except Exception as error:  # noqa: BLE001 -- never an exception in the user's import
        print(f"ransac-fix: {module.__name__} is left as it is: {error}", file=sys.stderr)
    else:
        engine.imported(module)
