"""Which code makes a library exact, for results that are kept: another code, another result."""

from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

from ransac_fix import criterion
from ransac_fix.digests import digest_of_files
from ransac_fix.patching.plugins import GROUP, resolve

__all__ = ["sources_digest"]


@cache
def sources_digest(name: str) -> str:
    """Digest the sources that a patched library runs: its patch, what it is made with, the rule.

    Parameters
    ----------
    name : str
        A system, distribution or import name.

    Returns
    -------
    str
        Another one whenever one of these files changes.

    Raises
    ------
    RansacFixError
        If there is no patch of that name.
    """
    system = resolve(name)
    files = [
        Path(spec.origin)
        for point in sorted(entry_points(group=GROUP), key=lambda point: point.value)
        if point.name == system and (spec := find_spec(point.module)) and spec.origin
    ]
    shared = sorted(Path(__file__).parent.glob("*.py"))
    return digest_of_files([*files, *shared, Path(criterion.__file__)])
