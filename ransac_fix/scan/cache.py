"""What is known to hold nothing, by content: so that a file that did not change is not read twice.

The cache holds digests of files in which nothing was found, and nothing else: no paths, no
findings. A file with a finding is scanned each time; there are few. A digest covers the content,
the language, the rules checked and this package's own source, so a cache never outlives any.
"""

import hashlib
import os
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from ransac_fix.folders import cache_folder
from ransac_fix.scan import words
from ransac_fix.scan.files import SourceFile

_SIZE = 16
_MOST = 2_000_000  # digests, 32 MB


def default_cache() -> Path:
    """Give the file of the user's own cache."""
    return cache_folder() / "scanned"


@cache
def _own_source() -> bytes:
    """Digest the scanner itself, by the state of its files."""
    digest = hashlib.blake2b(digest_size=_SIZE)
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        status = path.stat()
        digest.update(f"{path.name} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.digest()


def digest_of(file: SourceFile, data: bytes, codes: tuple[str, ...]) -> bytes:
    """Digest all that the outcome for a file depends on."""
    # Of a path only its kind and its words count.
    path = file.path
    speaks = words.speaks_strongly(path), words.speaks_weakly(path)
    digest = hashlib.blake2b(data, digest_size=_SIZE)
    digest.update(_context(file.language, file.named, path.endswith(".pyi"), speaks, codes))
    return digest.digest()


@cache
def _context(
    language: str, named: bool, stub: bool, speaks: tuple[bool, bool], codes: tuple[str, ...]
) -> bytes:
    text = f"\0{language} {named} {stub} {speaks} {','.join(codes)}"
    return text.encode() + _own_source()


def load(path: Path) -> frozenset[bytes]:
    """Read a cache; one that is missing or damaged is an empty one."""
    try:
        data = path.read_bytes()
    except OSError:
        return frozenset()
    whole = len(data) // _SIZE * _SIZE
    return frozenset(data[start : start + _SIZE] for start in range(0, whole, _SIZE))


def save(path: Path, digests: Iterable[bytes]) -> None:
    """Write a cache, all at once; a folder that cannot be written to is left alone."""
    kept = sorted(digests)[:_MOST]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(prefix=".scanned.", dir=path.parent)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(b"".join(kept))
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError:
        return
