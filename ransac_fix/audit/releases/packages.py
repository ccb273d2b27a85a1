"""What the package index offers for one interpreter, asked through pip.

pip knows the user's indexes, proxies, credentials and constraints. The pip installed beside
ransac-fix is used for every interpreter, which need not have one.
"""

import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from ransac_fix.errors import RansacFixError

# The first whose `index versions --json` leaves out releases without a wheel.
_PIP = "pip>=26"


class Unavailable(Exception):  # noqa: N818 -- what happened, in the words of a report
    """A release cannot be had here; the text says why, in one line."""


@dataclass(frozen=True, slots=True)
class Wheel:
    """One file that an environment needs.

    Parameters
    ----------
    name, version : str
        The release.
    file : str
        Name of the file.
    sha256 : str or None
        Its hash, where the index tells it.
    """

    name: str
    version: str
    file: str
    sha256: str | None


class Packages:
    """The releases that pip finds for one interpreter.

    Parameters
    ----------
    python : str
        The interpreter.
    constraint : Path, optional
        A constraints file for every environment.

    Raises
    ------
    RansacFixError
        If there is no pip, or it is too old, or the interpreter does not start.
    """

    def __init__(self, python: str, constraint: Path | None = None) -> None:
        self._python = python
        self._constraint = [] if constraint is None else ["--constraint", str(constraint.resolve())]
        _check_pip()
        said = _run(python, "-c", _DESCRIBE)
        described = json.loads(said.stdout)
        self.python: str = described["python"]
        self._where: str = described["where"]

    def versions(self, distribution: str, *, pre: bool = False) -> list[str]:
        """Return the releases of a distribution with a wheel for the interpreter, oldest first.

        Parameters
        ----------
        distribution : str
            Its name.
        pre : bool, optional
            Pre-releases too.

        Raises
        ------
        RansacFixError
            If there are none, or the index cannot be asked.
        """
        return self._listed(distribution, "--only-binary", ":all:", *(["--pre"] if pre else []))

    def _listed(self, distribution: str, *options: str) -> list[str]:
        done = self._run_pip(["index", "versions", "--json", distribution, *options])
        if done.returncode:
            if _unreachable(done.stderr):
                raise RansacFixError(f"{distribution}: {_unreachable(done.stderr)}")
            if "No matching distribution found" in done.stderr:
                raise RansacFixError(f"{distribution}: the index has nothing for {self._where}")
            raise RansacFixError(f"{distribution}: {_last_error(done.stderr)}")
        return sorted(json.loads(done.stdout)["versions"], key=Version)

    def resolve(self, requirements: list[str], *, dependencies: bool = True) -> list[Wheel]:
        """Return the wheels that an environment needs.

        Parameters
        ----------
        requirements : list of str
            What it must hold; the first is the release that is asked for.
        dependencies : bool, optional
            What these require, too.

        Raises
        ------
        Unavailable
            If there is no such environment.
        """
        asked = ["install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-"]
        asked += [] if dependencies else ["--no-deps"]
        done = self._run_pip([*asked, "--only-binary", ":all:", *self._constraint, *requirements])
        if done.returncode:
            raise Unavailable(self._why_not(done.stderr, requirements[0]))
        return [_wheel(one) for one in json.loads(done.stdout)["install"]]

    def unpack(self, wheel: Wheel, folder: Path) -> None:
        """Install one wheel, and nothing that it requires, into a folder of its own.

        Raises
        ------
        Unavailable
            If it cannot be had.
        """
        with tempfile.TemporaryDirectory() as scratch:
            wanted = Path(scratch, "requirements.txt")
            known = f" --hash=sha256:{wheel.sha256}" if wheel.sha256 else ""
            wanted.write_text(f"{wheel.name}=={wheel.version}{known}\n", "utf-8")
            asked = ["install", "--quiet", "--no-deps", "--no-compile", "--only-binary", ":all:"]
            asked += ["--requirement", str(wanted), "--target", str(folder)]
            done = self._run_pip(asked)
        if done.returncode:
            raise Unavailable(f"{wheel.file}: {_last_error(done.stderr)}")

    def environment(self, folder: Path, paths: list[Path]) -> str:
        """Make an environment that imports from these folders; return its interpreter.

        Parameters
        ----------
        folder : Path
            Where to; it must not exist.
        paths : list of Path
            The folders, by precedence.
        """
        try:
            _run(self._python, "-m", "venv", "--without-pip", str(folder))
        except RansacFixError as error:
            raise RansacFixError(f"cannot make an environment in {folder}: {error}") from None
        python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        said = _run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))")
        # addsitedir, so that the folders' own .pth files are read, too.
        lines = [f"import site; site.addsitedir({str(path)!r})\n" for path in paths]
        Path(said.stdout.strip(), "ransac_fix_release.pth").write_text("".join(lines), "utf-8")
        return str(python)

    def _run_pip(self, arguments: list[str]) -> subprocess.CompletedProcess[str]:
        elsewhere = [] if self._python == sys.executable else ["--python", self._python]
        common = [*elsewhere, "--disable-pip-version-check", "--no-input"]
        return _run(sys.executable, "-m", "pip", *common, *arguments, check=False)

    def _why_not(self, stderr: str, requirement: str) -> str:
        """Say in one line why pip found no environment."""
        name, _, version = requirement.partition("==")
        if _unreachable(stderr):
            return _unreachable(stderr)
        missing = re.search(r"No matching distribution found for ([^\n]+)", stderr)
        if missing is None:
            if "ResolutionImpossible" in stderr:
                return "its dependencies contradict each other or the constraints"
            return _last_error(stderr)
        wanted = missing[1].partition(" (from ")[0]
        if canonicalize_name(re.split(r"[^\w.-]", wanted)[0]) != canonicalize_name(name):
            return f"its dependency {wanted} has no wheel for {self._where}"
        wanted_version = Version(version)
        if wanted_version not in map(Version, self._listed(name, "--pre", _ANY_PYTHON)):
            return "there is no such release"
        if wanted_version not in map(Version, self._listed(name, "--pre")):
            return f"is not for Python {self.python.rpartition('.')[0]}"
        return f"has no wheel for {self._where}, and building it needs a compiler"


_ANY_PYTHON = "--ignore-requires-python"
_DESCRIBE = """
import json, platform, sysconfig
implementation, version = platform.python_implementation(), platform.python_version()
where = f"{implementation} {version.rpartition('.')[0]} on {sysconfig.get_platform()}"
print(json.dumps({"python": version, "where": where}))
"""


def _check_pip() -> None:
    needed = Requirement(_PIP)
    try:
        found = importlib.metadata.version("pip")
    except importlib.metadata.PackageNotFoundError:
        found = ""
    if not found or not needed.specifier.contains(found, prereleases=True):
        here = f"pip {found} is installed" if found else "there is none"
        raise RansacFixError(
            f"releases are measured with {_PIP} beside ransac-fix, and {here}: "
            f'run {sys.executable} -m pip install "{_PIP}"'
        )


def _run(
    python: str | Path, *arguments: str, check: bool = True
) -> subprocess.CompletedProcess[str]:
    try:
        done = subprocess.run(  # noqa: S603 -- the interpreter the user named
            [str(python), *arguments],
            capture_output=True,
            text=True,
            encoding="utf-8",
            errors="replace",
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except OSError as error:
        raise RansacFixError(f"{python} did not start: {error.strerror}") from None
    if check and done.returncode:
        raise RansacFixError(f"{python}: {_last_error(done.stderr or done.stdout)}")
    return done


def _wheel(installed: dict[str, Any]) -> Wheel:
    download = installed["download_info"]
    file = unquote(str(download["url"]).partition("#")[0].rpartition("/")[2])
    metadata = installed["metadata"]
    hashes = download["archive_info"].get("hashes", {})
    return Wheel(metadata["name"], metadata["version"], file, hashes.get("sha256"))


def _unreachable(said: str) -> str:
    """Say that the index did not answer; nothing where it did. To pip it is an empty index then."""
    last = re.search(r"Retry\(total=0,.*connection broken by (.*)", said)
    if last is None:
        return ""
    why = re.search(r"\[Errno -?\d+\] ([\w ]+)", last[1])
    return f"the index cannot be reached{f': {why[1]}' if why else ''}"


def _last_error(said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("ERROR: ")]
    last = (errors or lines or ["no reason given"])[-1]
    return last.removeprefix("ERROR: ")[:300]
