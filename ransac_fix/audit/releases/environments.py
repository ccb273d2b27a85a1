"""Environments for single releases, which share what they have in common.

Every wheel lies in a folder of its own, and an environment is a list of such folders. So the
releases of a library that needs PyTorch share one copy of it.
"""

import shutil
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ransac_fix.audit.releases.folders import INCOMPLETE
from ransac_fix.audit.releases.packages import Packages, Wheel


class Environments:
    """Makes environments under one folder.

    Parameters
    ----------
    packages : Packages
        Where the wheels come from.
    folder : Path
        Where they go.
    keep : bool, optional
        Leave each environment where it is, for use by hand.
    """

    def __init__(self, packages: Packages, folder: Path, *, keep: bool = False) -> None:
        self._packages = packages
        self._folder = folder
        self._keep = keep
        self._lock = threading.Lock()

    @contextmanager
    def holding(self, wheels: Sequence[Wheel]) -> Iterator[str]:
        """Give the interpreter of an environment that holds these wheels.

        The first is the release that is measured: it is shared with no other environment, and
        gone when this one is.

        Raises
        ------
        Unavailable
            If a wheel cannot be had.
        """
        release = wheels[0]
        folder = self._folder / f"{release.name}-{release.version}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        unfinished = folder / INCOMPLETE
        unfinished.touch()
        try:
            self._packages.unpack(release, folder / "release")
            shared = [self._shared(wheel) for wheel in wheels[1:]]
            paths = [folder / "release", *shared]
            python = self._packages.environment(folder / "environment", paths)
            unfinished.unlink()
            yield python
        finally:
            if not self._keep or unfinished.exists():
                shutil.rmtree(folder, ignore_errors=True)

    def _shared(self, wheel: Wheel) -> Path:
        folder = self._folder / "shared" / wheel.file.removesuffix(".whl")
        with self._lock:
            if not folder.exists():
                half = folder.with_name(f"{folder.name}.part")
                shutil.rmtree(half, ignore_errors=True)
                self._packages.unpack(wheel, half)
                half.rename(folder)
        return folder
