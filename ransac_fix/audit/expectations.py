"""What a project expects of its libraries: a file of verdicts it knows of and accepts."""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.version import InvalidVersion

from ransac_fix.audit.model import JUDGEMENTS, Judgement, Verdict
from ransac_fix.errors import RansacFixError

_KEYS = {"system", "entry_point", "verdict", "reason"}
_OPTIONAL = {"releases"}


@dataclass(frozen=True, slots=True)
class Expectation:
    """One verdict that is expected.

    Parameters
    ----------
    system : str
        Name of the system.
    entry_point : str
        As the audit prints it; ``"*"`` for all of the system.
    verdict : str
        The verdict expected.
    reason : str
        Why it is accepted.
    releases : str
        The releases it speaks of, as a version specifier such as ``">=0.8,<0.9"``; empty for all.
    """

    system: str
    entry_point: str
    verdict: Judgement
    reason: str
    releases: str = ""

    @property
    def name(self) -> str:
        """What it speaks of, in words."""
        return f"{self.system}{self.releases} {self.entry_point}"

    def covers(self, verdict: Verdict) -> bool:
        """Whether it speaks of this entry point in this release."""
        if self.system != verdict.system or self.entry_point not in ("*", verdict.entry_point):
            return False
        if not self.releases:
            return True
        try:
            return SpecifierSet(self.releases).contains(verdict.version or "", prereleases=True)
        except InvalidVersion:
            return False


@dataclass(frozen=True, slots=True)
class Unexpected:
    """A verdict that was not expected.

    Parameters
    ----------
    verdict : Verdict
        What was measured.
    expected : str or None
        The verdict expected; None where none was.
    """

    verdict: Verdict
    expected: Judgement | None

    @property
    def what(self) -> str:
        """The difference in words."""
        if self.expected is None:
            return f"{self.verdict.verdict}: {self.verdict.reason}"
        return f"{self.verdict.verdict}, not {self.expected} as expected: {self.verdict.reason}"


@dataclass(frozen=True, slots=True)
class Surprises:
    """How an audit differs from what was expected.

    Parameters
    ----------
    unexpected : tuple of Unexpected
        Verdicts that fail and that no expectation covers, and those that differ from the one
        that does, for the better or the worse.
    unmet : tuple of Expectation
        Expectations that covered nothing measured.
    """

    unexpected: tuple[Unexpected, ...]
    unmet: tuple[Expectation, ...]


def load_expectations(path: Path) -> tuple[Expectation, ...]:
    """Read an expectations file.

    Parameters
    ----------
    path : Path
        TOML with ``[[expect]]`` tables of ``system``, ``entry_point``, ``verdict``, ``reason`` and,
        optionally, ``releases``.

    Returns
    -------
    tuple of Expectation

    Raises
    ------
    RansacFixError
        If the file cannot be read or says something else.
    """
    try:
        document = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise RansacFixError(f"{path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RansacFixError(f"{path}: not TOML: {error}") from None
    tables = document.get("expect", [])
    if set(document) - {"expect"} or not isinstance(tables, list):
        raise RansacFixError(f"{path}: must hold [[expect]] tables and nothing else")
    return tuple(_expectation(path, number, table) for number, table in enumerate(tables, 1))


def _expectation(path: Path, number: int, table: Any) -> Expectation:
    where = f"{path}: [[expect]] number {number}"
    if not isinstance(table, dict) or not all(isinstance(v, str) for v in table.values()):
        raise RansacFixError(f"{where} must be a table of strings")
    missing, unknown = _KEYS - set(table), set(table) - _KEYS - _OPTIONAL
    if missing or unknown:
        wrong = [*(f"lacks {key}" for key in sorted(missing)), *(f"has {k}" for k in unknown)]
        keys = ", ".join(sorted(_KEYS | _OPTIONAL))
        raise RansacFixError(f"{where} {', '.join(wrong)}; its keys are {keys}")
    if table["verdict"] not in JUDGEMENTS:
        raise RansacFixError(f"{where}: verdict must be one of {', '.join(JUDGEMENTS)}")
    try:
        SpecifierSet(table.get("releases", ""))
    except InvalidSpecifier:
        raise RansacFixError(
            f"{where}: releases must be a version specifier, as in '>=0.8,<0.9'"
        ) from None
    return Expectation(**table)


def compare(
    verdicts: Iterable[Verdict],
    expectations: tuple[Expectation, ...],
    fail_on: frozenset[Judgement] = frozenset({"undersamples"}),
) -> Surprises:
    """Compare an audit with what was expected.

    An expectation for one entry point goes before one for all of its system, and one for some
    releases before one for all. One for an entry point holds to the letter; one for all of a system
    is met when one of its entry points has the verdict, and the others may be better.

    Parameters
    ----------
    verdicts : iterable of Verdict
        What was measured, of one or more releases of each system.
    expectations : tuple of Expectation
        What was expected.
    fail_on : frozenset of str, optional
        The verdicts that fail where nothing is expected.

    Returns
    -------
    Surprises
    """
    unexpected = []
    met: set[int] = set()
    ordered = sorted(
        range(len(expectations)),
        key=lambda i: (expectations[i].entry_point == "*", not expectations[i].releases),
    )
    for verdict in verdicts:
        index = next((i for i in ordered if expectations[i].covers(verdict)), None)
        if index is None:
            if verdict.verdict in fail_on:
                unexpected.append(Unexpected(verdict, None))
            continue
        expected = expectations[index]
        for_all = expected.entry_point == "*"
        if expected.verdict == verdict.verdict:
            met.add(index)
        elif not for_all or verdict.verdict in fail_on:
            unexpected.append(Unexpected(verdict, expected.verdict))
        if not for_all:
            met.add(index)
    unmet = tuple(one for index, one in enumerate(expectations) if index not in met)
    return Surprises(tuple(unexpected), unmet)
