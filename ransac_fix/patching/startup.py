"""Patches in processes that are started from a patched one.

Threads and forked processes share or copy what is patched. A fresh interpreter (joblib's loky,
multiprocessing's spawn, a subprocess) has only its environment: `environment` puts a folder with
a ``sitecustomize`` module on ``PYTHONPATH`` and the modules to wait for in ``RANSAC_FIX_WATCH``,
and `begin`, called from there, installs the import hook. It imports next to nothing until one of
those modules is imported. A ``sitecustomize`` that was there before still runs.

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

__all__ = ["begin", "environment", "is_inherited", "off", "watched"]

SWITCH = "RANSAC_FIX"
WATCH = "RANSAC_FIX_WATCH"
_FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "_site")  # noqa: PTH118, PTH120, PTH100 -- pathlib is slow to import


def off() -> bool:
    """Return whether ``RANSAC_FIX=0`` is set."""
    return os.environ.get(SWITCH) == "0"


def is_inherited() -> bool:
    """Return whether processes started now are patched from their start."""
    return WATCH in os.environ and not off()


def watched() -> dict[str, tuple[str, ...]]:
    """Return the systems that this process was started to patch, with their modules."""
    systems = {}
    for entry in os.environ.get(WATCH, "").split(";"):
        system, _, modules = entry.partition("=")
        if system and modules:
            systems[system] = tuple(modules.split(","))
    return systems


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
        environ[WATCH] = ";".join(f"{name}={','.join(systems[name])}" for name in sorted(systems))
        path.insert(0, _FOLDER)
    else:
        environ.pop(WATCH, None)
    if path:
        environ["PYTHONPATH"] = os.pathsep.join(path)
    else:
        environ.pop("PYTHONPATH", None)


def begin() -> None:
    """Start waiting for the modules named in the environment. Called by ``sitecustomize``."""
    if off():
        return
    for modules in watched().values():
        finder.watch(modules, _imported)


def _imported(module: ModuleType) -> None:
    # The engine takes over what `watched` names when it is loaded.
    try:
        from ransac_fix.patching import engine
    except Exception as error:  # noqa: BLE001 -- never an exception in the user's import
        print(f"ransac-fix: {module.__name__} is left as it is: {error}", file=sys.stderr)
    else:
        engine.imported(module)
