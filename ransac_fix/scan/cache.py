"""What is known to hold nothing, by content: so that a file that did not change is not read twice.

The cache holds digests of files in which nothing was found, and nothing else: no paths, no
findings. A file with a finding is scanned each time; there are few. A digest covers the content,
the language, the rules checked and this package's own source, so a cache never outlives any.
"""

import hashlib
import os
import tempfile
from collections.abc import Iterable, Sequence
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


def digest_of(file: SourceFile, data: bytes, codes: Sequence[str]) -> bytes:
    """Digest all that the outcome for a file depends on."""
    digest = hashlib.blake2b(data, digest_size=_SIZE)
    # Of a path only its kind and its words count.
    speaks = words.speaks_strongly(file.path), words.speaks_weakly(file.path)
    stub = file.path.endswith(".pyi")
    digest.update(f"\0{file.language} {speaks} {stub} {','.join(codes)}".encode())
    digest.update(_own_source())
    return digest.digest()


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
