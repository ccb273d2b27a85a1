"""Measure releases that are not installed, each in an environment of its own."""

import hashlib
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from ransac_fix.audit.proof import Controls
from ransac_fix.audit.releases.bisect import bisect
from ransac_fix.audit.releases.environments import Environments
from ransac_fix.audit.releases.folders import kept_folder, scratch_folder
from ransac_fix.audit.releases.model import Release, ReleaseReport, report_on
from ransac_fix.audit.releases.packages import Packages, Unavailable, Wheel
from ransac_fix.audit.releases.results import Results, key_of, probe_version
from ransac_fix.audit.session import (
    Options,
    audit_system,
    chosen_probes,
    probe_files,
)
from ransac_fix.errors import RansacFixError
from ransac_fix.systems import find_system

# The worker's own need.
_WORKER_NEEDS = "numpy"
_OLD_NUMPY = "numpy<2"
_EXAMPLES = "write for example kornia==0.8.2,0.9.0 or kornia>=0.8"


@dataclass(frozen=True, slots=True)
class Asked:
    """Releases of one distribution.

    Parameters
    ----------
    system : str
        The system it provides.
    distribution : str
        Its name.
    versions : tuple of str
        The releases named; empty for those that `specifier` admits.
    specifier : str
        E.g. ``">=0.8"``; empty for all.
    """

    system: str
    distribution: str
    versions: tuple[str, ...] = ()
    specifier: str = ""


@dataclass(frozen=True, slots=True)
class MatrixOptions:
    """How releases are measured.

    Parameters
    ----------
    options : Options
        As for an audit; its interpreter is the one that the environments are made from.
    cache : Path
        Where results are kept, and environments while they are needed.
    constraint : Path or None
        A constraints file for every environment.
    keep_environments : bool
        Leave the environments in the cache.
    pre : bool
        Consider pre-releases that were not named.
    """

    options: Options
    cache: Path
    constraint: Path | None = None
    keep_environments: bool = False
    pre: bool = False


def read_request(text: str) -> Asked:
    """Read ``"kornia==0.8.2,0.8.3"``, ``"kornia>=0.8"`` or ``"kornia"``.

    Parameters
    ----------
    text : str
        A system, distribution or import name and, optionally, which releases of it.

    Returns
    -------
    Asked

    Raises
    ------
    RansacFixError
        If it cannot be read, or the system is unknown or has no probe.
    """
    listed = re.fullmatch(r"\s*([\w.-]+)\s*==\s*([^=<>!~*]+)", text)
    versions: tuple[str, ...] = ()
    specifier = ""
    if listed is not None:
        name = listed[1]
        versions = tuple(part.strip() for part in listed[2].split(","))
        for version in versions:
            try:
                Version(version)
            except InvalidVersion:
                raise RansacFixError(f"{text!r}: {version!r} is not a version") from None
    else:
        try:
            requirement = Requirement(text)
        except InvalidRequirement as error:
            what = str(error).partition("\n")[0]
            raise RansacFixError(f"{text!r}: {what}; {_EXAMPLES}") from None
        if requirement.url or requirement.extras or requirement.marker:
            raise RansacFixError(f"{text!r}: only a name and versions are read; {_EXAMPLES}")
        name, specifier = requirement.name, str(requirement.specifier)
    system = find_system(name)
    chosen_probes([system.name])
    if not system.distributions:
        raise RansacFixError(f"{system.name} is in no package index")
    known = {canonicalize_name(one): one for one in system.distributions}
    distribution = known.get(canonicalize_name(name), system.distributions[0])
    return Asked(system.name, distribution, versions, specifier)


def measure_releases(
    requests: Iterable[Asked],
    options: MatrixOptions,
    progress: Callable[[str], object] = lambda _: None,
) -> ReleaseReport:
    """Measure every release asked for.

    Parameters
    ----------
    requests : iterable of Asked
        Which.
    options : MatrixOptions
        How.
    progress : callable, optional
        Called with a line on what was just done, from several threads.

    Returns
    -------
    ReleaseReport

    Raises
    ------
    RansacFixError
        If pip cannot be set up, or a distribution is in no index.
    """
    started = time.monotonic()
    with _Bench(options, progress) as bench:
        wanted = [(one, version) for one in requests for version in bench.releases(one)]
        with _pool() as pool:
            waiting = [pool.submit(bench.measure, *one) for one in dict.fromkeys(wanted)]
            releases = [one.result() for one in waiting]
        return bench.report(releases, started)


def find_changes(
    requests: Iterable[Asked],
    options: MatrixOptions,
    progress: Callable[[str], object] = lambda _: None,
) -> ReleaseReport:
    """Find the releases where a verdict changes, by bisection.

    Parameters
    ----------
    requests : iterable of Asked
        The histories to search.
    options, progress
        As in `measure_releases`.

    Returns
    -------
    ReleaseReport
        Of the releases measured on the way.

    Raises
    ------
    RansacFixError
        As `measure_releases`.
    """
    started = time.monotonic()
    with _Bench(options, progress) as bench:
        histories = [(one, bench.releases(one)) for one in requests]
        with _pool() as pool:
            waiting = [
                pool.submit(bisect, versions, partial(bench.measure, one))
                for one, versions in histories
            ]
            found = [one.result() for one in waiting]
        not_tried = [
            f"{one.distribution}=={version}"
            for (one, versions), releases in zip(histories, found, strict=True)
            for version in versions
            if version not in {release.version for release in releases}
        ]
        releases = [release for of_one in found for release in of_one]
        return bench.report(releases, started, not_tried)


class _Bench:
    """What the measurements of one run share: pip, the environments, the results, the controls."""

    def __init__(self, options: MatrixOptions, progress: Callable[[str], object]) -> None:
        self._options = options
        self._progress = progress
        self._results = Results(options.cache / "releases")
        # A constraint can change what is measured.
        constraint = options.constraint
        self._constraint = "" if constraint is None else _digest(constraint.read_bytes())
        self._controls = Controls(options.options.seconds, quick=options.options.quick)
        self._stack = ExitStack()

    def __enter__(self) -> "_Bench":
        options = self._options
        with ExitStack() as stack:
            self._packages = Packages(options.options.python, options.constraint)
            try:
                options.cache.mkdir(parents=True, exist_ok=True)
                folder = stack.enter_context(
                    kept_folder(options.cache / "environments")
                    if options.keep_environments
                    else scratch_folder(options.cache, "environments-")
                )
            except OSError as error:
                raise RansacFixError(
                    f"{options.cache}: cannot be used as cache folder: {error.strerror}; "
                    "name another with --cache-dir"
                ) from None
            self._environments = Environments(
                self._packages, folder, keep=options.keep_environments
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def releases(self, asked: Asked) -> list[str]:
        """Return the releases that a request means, oldest first."""
        if asked.versions:
            return sorted(asked.versions, key=Version)
        admitted = SpecifierSet(asked.specifier, prereleases=True)
        found = self._packages.versions(asked.distribution, pre=self._options.pre)
        chosen = [version for version in found if version in admitted]
        if not chosen:
            raise RansacFixError(
                f"{asked.distribution}{asked.specifier}: the index has {found[0]} to {found[-1]}"
            )
        return chosen

    def measure(self, asked: Asked, version: str) -> Release:
        """Measure one release, or look up what was measured of it."""
        release = Release(
            asked.system,
            asked.distribution,
            version,
            self._packages.python,
            None,
            None,
            (),
            probe_version(probe_files()[asked.system]),
            datetime.now(UTC).date().isoformat(),
            "",
            "",
            (),
        )
        named = f"{asked.distribution}=={version}"
        try:
            (wheel,) = self._packages.resolve([named], dependencies=False)
            release = self._known_or_tried(replace(release, wheel=wheel.file, sha256=wheel.sha256))
        except Unavailable as why:
            release = replace(release, unmeasured=str(why))
        if not release.unmeasured and not _has_entry_points(release):
            release = replace(release, unmeasured=_first_reason(release), verdicts=())
        self._progress(named)
        return release

    def report(
        self, releases: Sequence[Release], started: float, not_tried: Sequence[str] = ()
    ) -> ReleaseReport:
        """Report what was found since then, proved by the controls that it rests on."""
        verdicts = [verdict for release in releases for verdict in release.verdicts]
        controls = self._controls.measured(verdicts)
        return report_on(releases, controls, time.monotonic() - started, not_tried)

    def _known_or_tried(self, release: Release) -> Release:
        chosen = self._options.options
        choice = (*chosen.entry_points, str(chosen.quick), str(chosen.problems), self._constraint)
        key = key_of(release, *choice)
        known = self._results.get(key)
        if known is not None:
            return known
        release = self._tried(release)
        self._results.put(key, release)
        return release

    def _tried(self, release: Release) -> Release:
        """Measure a release, with an old NumPy if nothing works with the one that it gets."""
        found = self._measured(release, _WORKER_NEEDS)
        if _ran(found) or not _has_new_numpy(found):
            return found
        try:
            # Old wheels are compiled for NumPy 1; some crash with 2 without saying why.
            older = self._measured(release, _OLD_NUMPY)
        except Unavailable:
            return found
        if not _ran(older):
            return found
        return replace(older, remark=f"with {_OLD_NUMPY}; with NumPy 2: {_first_reason(found)}")

    def _measured(self, release: Release, numpy: str) -> Release:
        named = f"{release.distribution}=={release.version}"
        wheels = self._packages.resolve([named, numpy])
        others = [one for one in wheels if not _is(one, release.distribution)]
        wheels = [one for one in wheels if _is(one, release.distribution)] + others
        with self._environments.holding(wheels) as python:
            options = replace(self._options.options, systems=(release.system,), python=python)
            verdicts = audit_system(release.system, options, self._controls, self._progress)
        return replace(
            release,
            dependencies=tuple(sorted(f"{one.name}=={one.version}" for one in others)),
            verdicts=tuple(verdicts),
        )


def _ran(release: Release) -> bool:
    return any(verdict.runs > 0 for verdict in release.verdicts)


def _has_entry_points(release: Release) -> bool:
    return any(verdict.entry_point != "-" for verdict in release.verdicts)


def _first_reason(release: Release) -> str:
    reason = next(
        (verdict.reason for verdict in release.verdicts),
        "it does not hold the module that the probe imports",
    )
    # The file that an ImportError names lies in an environment that is gone by then.
    return re.sub(r" \(/[^()]*\)$", "", reason)


def _has_new_numpy(release: Release) -> bool:
    found = dict(one.split("==") for one in release.dependencies)
    return "numpy" in found and Version(found["numpy"]).major >= 2


def _is(wheel: Wheel, distribution: str) -> bool:
    return canonicalize_name(wheel.name) == canonicalize_name(distribution)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


@contextmanager
def _pool() -> Iterator[ThreadPoolExecutor]:
    """Give threads for the CPUs there are; what has not begun when one fails is left out."""
    # Fewer than there are where the user says so, as with taskset.
    limited = hasattr(os, "sched_getaffinity")
    cpus = len(os.sched_getaffinity(0)) if limited else os.cpu_count()
    with ThreadPoolExecutor(cpus) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
