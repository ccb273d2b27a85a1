"""Patch every program of one environment, through a ``.pth`` file among its packages.

The interpreter runs a line of such a file at its start when the line begins with ``import``. Ours
calls `ransac_fix.patching.startup.begin`, as ``ransac-fix run`` does for a single program, and
nothing more: the start imports nothing heavy, and a library is patched when it is imported. The
line cannot raise: where the package is gone, in part or whole, nothing happens. It stays out of
the way under ``RANSAC_FIX=0`` and in an isolated interpreter (``python -I``); ``-S`` runs no
such file at all.
"""

import os
import re
import site as standard_site
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from ransac_fix.errors import RansacFixError
from ransac_fix.patching import plugins, startup

__all__ = ["SiteStatus", "disable", "enable", "status"]

# The last in the alphabet: every folder and import hook of other .pth files is there before it.
FILE = "zzz_ransac_fix.pth"

# One line, for the interpreter runs each line by itself.
_LINE = (
    'import os, sys; exec("try:\\n if not sys.flags.isolated and os.environ.get({switch!r})'
    " != '0':\\n  from ransac_fix.patching.startup import begin\\n  begin({listed!r})"
    '\\nexcept Exception: pass")\n'
)
_LISTED = re.compile(r"begin\('([^']*)'\)")


@dataclass(frozen=True, slots=True)
class SiteStatus:
    """Whether programs of this environment are patched from their start.

    Attributes
    ----------
    enabled : bool
        The file is there.
    path : str
        The ``.pth`` file, there or not.
    systems : tuple of str
        Systems whose libraries it waits for.
    missing : tuple of str
        Systems that have a patch now which the file does not know: enable again.
    switched_off : bool
        ``RANSAC_FIX=0`` is set here.
    """

    enabled: bool
    path: str
    systems: tuple[str, ...]
    missing: tuple[str, ...]
    switched_off: bool


def enable() -> SiteStatus:
    """Write the file, or write it anew.

    It waits for every library there is a patch for, also those that are not installed yet.

    Returns
    -------
    SiteStatus
        What holds for programs started from now on.

    Raises
    ------
    RansacFixError
        If the environment's folder of packages cannot be written, or is not looked at by its
        interpreter.
    """
    path = _path()
    line = _LINE.format(switch=startup.SWITCH, listed=startup.listed(_watchable()))
    new = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        # Whole or not at all: a program may start while it is written.
        new.write_text(line, encoding="utf-8")
        new.replace(path)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise _refused(path, error) from error
    return status()


def disable() -> SiteStatus:
    """Remove the file, if it is there.

    Returns
    -------
    SiteStatus
        What holds for programs started from now on.

    Raises
    ------
    RansacFixError
        If it cannot be removed.
    """
    path = _path()
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from error
    return status()


def status() -> SiteStatus:
    """Return whether the file is there, and what it waits for."""
    path = _path()
    try:
        found = _LISTED.search(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return SiteStatus(False, str(path), (), (), startup.off())
    except OSError as error:
        raise _refused(path, error) from error
    known = startup.parsed(found.group(1)) if found else {}
    missing = tuple(name for name, modules in _watchable().items() if known.get(name) != modules)
    return SiteStatus(True, str(path), tuple(known), missing, startup.off())


def _watchable() -> dict[str, tuple[str, ...]]:
    patches = plugins.discover().patches
    return {name: patches[name].modules for name in sorted(patches)}


def _path() -> Path:
    """Return where the file stands in the environment of this interpreter."""
    folder = Path(sysconfig.get_path("purelib"))
    if folder not in map(Path, standard_site.getsitepackages()):
        raise RansacFixError(
            f"{sys.executable} does not read {folder} at its start: make a virtual environment"
            " and install ransac-fix there"
        )
    return folder / FILE


def _refused(path: Path, error: OSError) -> RansacFixError:
    return RansacFixError(
        f"{path} cannot be changed: {error.strerror or error}; use a virtual environment, or"
        " `ransac-fix run` for single programs"
    )
