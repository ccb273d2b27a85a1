"""Verdicts measured on releases, as stored with this version: read from ``verdicts.json``.

They say what the audit found of a release when it was measured, so that an advice or a scan can
speak of releases that are not installed. A release that was not measured has no verdict here, and
none is inferred from its neighbours. `docs/systems` shows the same measurements as pages.
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from packaging.version import Version

__all__ = [
    "StoredVerdict",
    "fixed_release",
    "load_verdicts",
    "nearest_releases",
    "verdicts_for",
]


@dataclass(frozen=True, slots=True)
class StoredVerdict:
    """What was measured of one entry point of one release.

    Parameters
    ----------
    system : str
        Name in ``systems.toml``.
    distribution, version : str
        The release measured. A system's other distributions hold the same code.
    entry_point : str
        As the audit prints it, e.g. ``"findHomography(RANSAC)"``.
    verdict : str
        ``exact``, ``undersamples``, ``oversamples``, ``other rule`` or ``not measured``.
    formula : str or None
        The stopping law; None where none was found.
    measured_on : str
        The day of the measurement, ``YYYY-MM-DD``.
    """

    system: str
    distribution: str
    version: str
    entry_point: str
    verdict: Literal["exact", "undersamples", "oversamples", "other rule", "not measured"]
    formula: str | None
    measured_on: str

    @property
    def function(self) -> str:
        """The name of the function or class called, without its module and its method."""
        return _function(self.entry_point)


@dataclass(frozen=True, slots=True)
class _Table:
    schema_version: Literal[1]
    verdicts: tuple[StoredVerdict, ...]


@lru_cache(maxsize=1)
def load_verdicts() -> tuple[StoredVerdict, ...]:
    """Return every stored verdict, by system and from the oldest release to the newest."""
    import msgspec

    text = files("ransac_fix").joinpath("verdicts.json").read_bytes()
    return msgspec.json.decode(text, type=_Table).verdicts


def verdicts_for(
    distribution: str, version: str | None, function: str | None = None
) -> tuple[StoredVerdict, ...]:
    """Return what was measured of a release.

    Parameters
    ----------
    distribution : str
        A distribution's name; the distributions of one system (``opencv-python``,
        ``opencv-contrib-python``, ...) are one.
    version : str or None
        The release; None for every release measured.
    function : str, optional
        Keep the entry points of this function or class; a module before it is ignored. Or one
        entry point as the audit prints it, with its method in parentheses.

    Returns
    -------
    tuple of StoredVerdict
        Empty where the release was not measured: nothing is inferred from others.
    """
    wanted = None if version is None else _version(version)
    if version is not None and wanted is None:
        return ()
    return tuple(
        one
        for one in _of_distribution(distribution)
        if (wanted is None or _version(one.version) == wanted)
        and (function is None or _is_of(one, function))
    )


def nearest_releases(
    distribution: str, version: str, function: str | None = None
) -> tuple[str | None, str | None]:
    """Return the nearest measured releases below and above one.

    Parameters
    ----------
    distribution, function : str
        As in `verdicts_for`.
    version : str
        The release asked about, whether or not it was measured.

    Returns
    -------
    tuple of (str or None, str or None)
        None where there is none on that side, or where ``version`` is no version.
    """
    wanted = _version(version)
    if wanted is None:
        return None, None
    measured = {
        known: one.version
        for one in verdicts_for(distribution, None, function)
        if (known := _version(one.version)) is not None
    }
    below = max((known for known in measured if known < wanted), default=None)
    above = min((known for known in measured if known > wanted), default=None)
    return (
        None if below is None else measured[below],
        None if above is None else measured[above],
    )


def fixed_release(distribution: str, version: str, function: str | None = None) -> str | None:
    """Return the release to upgrade to from one that undersamples.

    It is the first from which on everything measured is exact; failing that, the first from which
    on nothing undersamples.

    Parameters
    ----------
    distribution, function : str
        As in `verdicts_for`.
    version : str
        The release in use.

    Returns
    -------
    str or None
        None where no newer release measured is better, or ``version`` is no version.
    """
    wanted = _version(version)
    by_release: dict[Version, list[StoredVerdict]] = {}
    for one in verdicts_for(distribution, None, function):
        known = _version(one.version)
        if known is not None and one.verdict != "not measured":
            by_release.setdefault(known, []).append(one)
    for good in ({"exact"}, {"exact", "oversamples"}):
        since = None
        for known in sorted(by_release, reverse=True):
            if not all(one.verdict in good for one in by_release[known]):
                break
            since = known
        if since is not None and wanted is not None and since > wanted:
            return by_release[since][0].version
    return None


def _of_distribution(distribution: str) -> list[StoredVerdict]:
    from packaging.utils import canonicalize_name

    from ransac_fix.systems import load_systems

    wanted = canonicalize_name(distribution)
    for system in load_systems():
        if wanted in map(canonicalize_name, system.distributions):
            return [one for one in load_verdicts() if one.system == system.name]
    return []


def _is_of(one: StoredVerdict, function: str) -> bool:
    if "(" in function:
        return one.entry_point == function
    return one.function == _function(function)


def _function(name: str) -> str:
    return name.partition("(")[0].rpartition(".")[2]


@lru_cache(maxsize=4096)
def _version(text: str) -> "Version | None":
    from packaging.version import InvalidVersion, Version

    try:
        return Version(text)
    except InvalidVersion:
        return None
