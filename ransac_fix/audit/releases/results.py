"""Results kept from one run to the next: a release is measured once by one set of sources."""

import hashlib
from functools import cache
from pathlib import Path

import msgspec

from ransac_fix import criterion
from ransac_fix.audit.host import NO_ANSWER
from ransac_fix.audit.releases.model import Release
from ransac_fix.digests import digest_of_files

_AUDIT = Path(__file__).parent.parent


class Results:
    """A folder of results.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, key: str) -> Release | None:
        """Return the result kept under a key; None where there is none."""
        try:
            return msgspec.json.decode((self._folder / f"{key}.json").read_bytes(), type=Release)
        except (OSError, msgspec.DecodeError):
            return None

    def put(self, key: str, release: Release) -> None:
        """Keep a result, unless it may be another tomorrow: nothing measured, or out of time."""
        verdicts = release.verdicts
        if all(verdict.verdict == "not measured" for verdict in verdicts) or any(
            verdict.reason.startswith(NO_ANSWER) for verdict in verdicts
        ):
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        half = self._folder / f"{key}.part"
        half.write_bytes(msgspec.json.encode(release))
        half.replace(self._folder / f"{key}.json")


def key_of(release: Release, *choice: str) -> str:
    """Return the key of a result: the file measured, what measured it, and what was asked.

    Parameters
    ----------
    release : Release
        With everything but verdicts.
    *choice : str
        What else it depends on.
    """
    parts = (release.sha256, release.wheel, release.python, release.probe_version, *choice)
    digest = hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()
    return f"{release.distribution}-{release.version}-{digest[:16]}"


@cache
def probe_version(probe_file: Path) -> str:
    """Digest a probe and the sources that measure with it."""
    sources = [*_AUDIT.glob("*.py"), *(_AUDIT / "worker").glob("*.py")]
    return digest_of_files([probe_file, *sorted(sources), Path(criterion.__file__)])
