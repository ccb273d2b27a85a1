"""C++ libraries: a small driver of ours is compiled against what is installed, and then asked.

A driver is one C++ file beside the probes that includes ``driver.hpp``. It is compiled on first
use with the machine's own compiler into a cache of the user's, and runs as a process of its own:
one process serves many runs, and a crash of the library ends that process only.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from ransac_fix.audit.worker.interface import Outcome
from ransac_fix.folders import cache_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ransac_fix.audit.worker.interface import Settings

# Optimised enough to run, not so much that compiling takes long.
_FLAGS = ("-std=c++17", "-O1", "-w")
_COMPILERS = ("c++", "g++", "clang++")
_COMPILE_SECONDS = 240
_PROTOCOL = Path("driver.hpp")


class Unusable(Exception):  # noqa: N818 -- why nothing can be measured, in the words of a verdict
    """The driver could not be compiled or started; the text says why and what to do."""


class DriverError(RuntimeError):
    """The library raised or crashed in a run."""


@dataclass(frozen=True)
class Header:
    """A header that a driver includes.

    Attributes
    ----------
    path : str
        As included, e.g. ``"Eigen/Core"``.
    package : str
        The Debian package that brings it.
    folders : tuple of str
        Glob patterns of the folders that it may lie in, below an include directory.
    """

    path: str
    package: str
    folders: tuple[str, ...] = ()

    def find(self) -> Path | None:
        """Return the include directory that has the header, or None."""
        for root in _include_directories():
            # Of several releases side by side the newest.
            below = [f for pattern in self.folders for f in sorted(root.glob(pattern))[::-1]]
            for folder in (root, *below):
                if (folder / self.path).is_file():
                    return folder
        return None


@dataclass(frozen=True)
class Library:
    """A C++ library and the driver that runs it.

    Attributes
    ----------
    title : str
        As it is written, e.g. ``"OpenGV"``.
    source : Path
        The driver.
    header : Header
        Its absence means that the library is not installed.
    needs : tuple of Header
        What the driver includes besides.
    links : tuple of str
        Libraries to link.
    version_macro : tuple of str or None
        Header and macro that hold the release, for an installation that no package made.
    shared : bool
        Compile a shared library in place of a program.
    """

    title: str
    source: Path
    header: Header
    needs: tuple[Header, ...] = ()
    links: tuple[str, ...] = ()
    version_macro: tuple[str, str] | None = None
    shared: bool = False

    def installed(self) -> bool:
        """Whether the library is there to compile against. Takes no process and no import."""
        return self.header.find() is not None

    def find(self) -> SimpleNamespace | None:
        """Return what stands for the library as a `Probe` wants it, or None if not installed."""
        return SimpleNamespace(__version__=self.version()) if self.installed() else None

    def version(self) -> str:
        """Return the release compiled against: the package's, or what the headers say."""
        include = self.header.find()
        assert include is not None
        return (
            package_version(self.header.package, include / self.header.path)
            or self._stated_version(include)
            or "unknown"
        )

    def _stated_version(self, include: Path) -> str | None:
        if self.version_macro is None:
            return None
        path, macro = self.version_macro
        text = (include / path).read_text("utf-8", "replace")
        found = re.search(rf"#\s*define\s+{macro}\s+\"?([^\s\"]+)", text)
        return found[1] if found else None

    def start(self) -> Driver:
        """Compile the driver, if that has not been done, and start it.

        Raises
        ------
        Unusable
            If a header or the compiler is missing, or the driver does not compile or start.
        """
        with contextlib.suppress(Unusable):
            return Driver(self, self.build())
        # A kept one may have been linked against what is no longer there.
        return Driver(self, self.build(again=True))

    def build(self, *, again: bool = False) -> Path:
        """Return the compiled driver, compiled now if it is not kept or is wanted again.

        Raises
        ------
        Unusable
            If a header or the compiler is missing, or the driver does not compile.
        """
        includes = []
        missing = []
        for header in (self.header, *self.needs):
            found = header.find()
            if found is None:
                missing.append(header.package)
            elif found not in includes:
                includes.append(found)
        compiler = _compiler()
        if missing or compiler is None:
            wanted = [*missing, *(() if compiler else ("a C++ compiler",))]
            raise Unusable(
                f"{self.title} is there, but not what its driver is compiled with: install "
                + " and ".join(wanted)
            )
        command = [
            *compiler,
            *_FLAGS,
            *(("-shared", "-fPIC") if self.shared else ()),
            *(
                part
                for include in includes
                # Naming the system's own directories again would change their order.
                if include not in (Path("/usr/include"), Path("/usr/local/include"))
                for part in ("-isystem", str(include))
            ),
            f"-I{self.source.parent}",
            str(self.source),
            *_link_directories(includes),
            *(f"-l{name}" for name in self.links),
        ]
        binary = cache_folder() / "drivers" / f"{self.source.stem}-{self._key(command, compiler)}"
        if again or not binary.exists():
            _compile(command, binary, self.title)
        return binary

    def _key(self, command: Sequence[str], compiler: Sequence[str]) -> str:
        """Return what a compiled driver depends on, as a short hash."""
        include = self.header.find()
        assert include is not None
        state = (include / self.header.path).stat()
        parts = [
            *command,
            _first_line([*compiler, "--version"]),
            self.version(),
            f"{state.st_size} {state.st_mtime_ns}",
            self.source.read_text("utf-8"),
            (self.source.parent / _PROTOCOL).read_text("utf-8"),
        ]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:24]


class Driver:
    """A running driver; started again after a crash.

    Parameters
    ----------
    library : Library
        What it runs.
    binary : Path
        The compiled driver.

    Raises
    ------
    Unusable
        If it does not start.
    """

    def __init__(self, library: Library, binary: Path) -> None:
        self._library = library
        self._binary = binary
        self._process = self._begin()

    def run(
        self,
        entry: str,
        data: NDArray[np.float64],
        threshold: float,
        settings: Settings | None,
        seed: int,
    ) -> Outcome:
        """Run the library once.

        Parameters
        ----------
        entry : str
            Which function, in the driver's words.
        data : ndarray, shape (n, width)
            One measurement a row; what the columns mean is between the probe and the driver.
        threshold : float
            Residual below which a measurement agrees, in the library's units.
        settings : Settings or None
            None for a run with nothing set.
        seed : int
            Of the random stream.

        Returns
        -------
        Outcome

        Raises
        ------
        DriverError
            If the library raised or crashed.
        """
        if self._process.poll() is not None:
            self._process = self._begin()
        trials, confidence = (-1, 0.0) if settings is None else vars(settings).values()
        rows = np.ascontiguousarray(data, dtype="<f8")
        request = (
            f"{entry} {trials} {confidence.hex()} {seed % 2**31} {float(threshold).hex()} "
            f"{rows.shape[0]} {rows.shape[1]}\n"
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(request.encode() + rows.tobytes())
            self._process.stdin.flush()
            answer = self._process.stdout.readline().decode().split(maxsplit=1)
        except OSError:
            answer = []
        if not answer:
            raise DriverError(f"{self._library.title} {self._death()}")
        if answer[0] == "error":
            raise DriverError(answer[1].strip())
        mask = answer[1].strip()
        inliers = None if mask == "-" else np.frombuffer(mask.encode(), np.uint8) == ord("1")
        return Outcome(inliers, int(answer[0]))

    def _begin(self) -> subprocess.Popen[bytes]:
        try:
            process = subprocess.Popen(  # noqa: S603 -- our own program, from the user's cache
                [str(self._binary)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        except OSError as error:
            why = f"the {self._library.title} driver does not start: {error.strerror}"
            raise Unusable(why) from None
        assert process.stdout is not None
        if process.stdout.readline() != b"ready\n":
            process.wait()
            raise Unusable(f"the {self._library.title} driver does not start")
        return process

    def _death(self) -> str:
        code = self._process.wait()
        return f"crashed with {signal.Signals(-code).name}" if code < 0 else f"exited with {code}"


def _include_directories() -> list[Path]:
    """Return where headers are looked for, without asking the compiler."""
    named = os.environ.get("CPATH", "").split(os.pathsep)
    named += os.environ.get("CPLUS_INCLUDE_PATH", "").split(os.pathsep)
    # conda keeps headers beside the interpreter.
    prefixes = (sys.prefix, "/usr/local", "/opt/homebrew", "/usr")
    return [Path(entry) for entry in named if entry] + [Path(p, "include") for p in prefixes]


def _link_directories(includes: Sequence[Path]) -> list[str]:
    """Return flags to find the libraries that belong to headers outside the system's places."""
    flags = []
    for include in includes:
        for parent in include.parents:
            library = parent / "lib"
            if parent in (Path("/usr"), Path("/")):
                break
            if library.is_dir():
                flags += [f"-L{library}", f"-Wl,-rpath,{library}"]
                break
    return list(dict.fromkeys(flags))


def _compiler() -> list[str] | None:
    """Return the command of the C++ compiler: $CXX, else the system's."""
    named = shlex.split(os.environ.get("CXX", ""))
    if named:
        return named if shutil.which(named[0]) else None
    return next(([found] for name in _COMPILERS if (found := shutil.which(name))), None)


def package_version(package: str, file: Path) -> str | None:
    """Return the release of a Debian package, if it installed this file; else None.

    Parameters
    ----------
    package : str
        Its name.
    file : Path
        A file that it may have installed.
    """
    listed = sorted(Path("/var/lib/dpkg/info").glob(f"{package}*.list"))
    for one in listed:
        if one.stem.split(":")[0] == package and str(file) in one.read_text("utf-8").split("\n"):
            return _first_line(["dpkg-query", "-W", "-f", "${Version}", one.stem]) or None
    return None


def _first_line(command: Sequence[str]) -> str:
    try:
        done = subprocess.run(  # noqa: S603 -- a fixed command, or the user's own compiler
            command, capture_output=True, text=True, timeout=30, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.split("\n", 1)[0].strip()


def _compile(command: Sequence[str], binary: Path, title: str) -> None:
    """Compile a driver; the binary appears whole or not at all."""
    try:
        binary.parent.mkdir(parents=True, exist_ok=True)
        scratch = tempfile.TemporaryDirectory(dir=binary.parent)
    except OSError as error:
        raise Unusable(
            f"the {title} driver cannot be kept in {binary.parent}: {error.strerror}; "
            "set XDG_CACHE_HOME to a folder that can be written to"
        ) from None
    with scratch as folder:
        made = Path(folder) / binary.name
        try:
            done = subprocess.run(  # noqa: S603 -- the compiler on our own source
                [*command, "-o", str(made)],
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_COMPILE_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise Unusable(
                f"the {title} driver did not compile within {_COMPILE_SECONDS} s"
            ) from None
        if done.returncode:
            raise Unusable(f"the {title} driver does not compile: {_complaint(done.stderr)}")
        made.replace(binary)


def _complaint(said: str) -> str:
    """Return the line of a compiler's output that says what is wrong."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line or "undefined reference" in line]
    return (errors or lines or ["it says nothing"])[0][:200]
