"""Digests of sources, by which what was measured with other code is told apart."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

__all__ = ["digest_of_files"]


def digest_of_files(paths: Iterable[Path]) -> str:
    """Return a short digest of the names and the contents of files.

    Parameters
    ----------
    paths : iterable of Path
        The files; their order matters, their folders do not.

    Returns
    -------
    str
        Twelve hexadecimal digits.

    Raises
    ------
    OSError
        If one of them cannot be read.
    """
    digest = hashlib.sha256()
    for path in paths:
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:12]
