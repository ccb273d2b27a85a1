"""The pytest plugin: a fixture for a project's own RANSAC, and an audit of what it installs.

It is loaded by every pytest session of an environment with ransac-fix, so it imports nothing but
pytest until it is used, and does nothing unless a test asks for its fixture or the project's
configuration sets ``ransac_fix_audit``. `docs/testing.md` shows both.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from ransac_fix.audit.expectations import Expectation
    from ransac_fix.audit.model import Judgement, Report, Verdict

_EVERY = "all"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare what a project can configure."""
    parser.addini(
        "ransac_fix_audit",
        "systems whose installed release is audited, or 'all' (ransac-fix)",
        type="args",
    )
    parser.addini(
        "ransac_fix_fail_on",
        "verdicts that fail, one a line; 'undersamples' if left out (ransac-fix)",
        type="linelist",
        default=["undersamples"],
    )
    parser.addini("ransac_fix_expect", "file of verdicts that are expected (ransac-fix)")
    parser.addini(
        "ransac_fix_every_entry_point",
        "audit every entry point of a system, not just its first (ransac-fix)",
        type="bool",
        default=False,
    )


@pytest.fixture(scope="session")
def assert_stopping_rule() -> Callable[..., None]:
    """Fail unless a RANSAC's stopping rule is what it should be.

    This is `ransac_fix.testing.assert_stopping_rule`.
    """
    from ransac_fix.extras import need

    need("numpy", extra="audit")
    from ransac_fix.testing import assert_stopping_rule

    return assert_stopping_rule


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Add the audit to a session, unless single tests were named."""
    if config.getini("ransac_fix_audit") and not any("::" in one for one in config.args):
        items += session.genitems(
            _Audits.from_parent(session, name="ransac-fix", asked=_asked(config))
        )


@dataclass(frozen=True)
class _Asked:
    """What a project configured; no systems mean all of them."""

    systems: tuple[str, ...]
    fail_on: "frozenset[Judgement]"
    expectations: "tuple[Expectation, ...]"


def _asked(config: pytest.Config) -> _Asked:
    from ransac_fix.errors import RansacFixError
    from ransac_fix.extras import need

    try:
        need("numpy", extra="audit")
    except RansacFixError as error:
        raise pytest.UsageError(f"ransac-fix: {error}") from None
    from ransac_fix.audit.expectations import load_expectations
    from ransac_fix.audit.model import JUDGEMENTS
    from ransac_fix.audit.session import chosen_probes

    systems = config.getini("ransac_fix_audit")
    expect = config.getini("ransac_fix_expect")
    beside = config.rootpath if config.inipath is None else config.inipath.parent
    try:
        chosen = () if systems == [_EVERY] else tuple(chosen_probes(systems))
        expectations = load_expectations(beside / expect) if expect else ()
    except RansacFixError as error:
        raise pytest.UsageError(f"ransac-fix: {error}") from None
    fail_on = frozenset(config.getini("ransac_fix_fail_on"))
    unknown = sorted(fail_on - set(JUDGEMENTS))
    if unknown:
        known = ", ".join(JUDGEMENTS)
        raise pytest.UsageError(
            f"ransac_fix_fail_on: there is no verdict {unknown[0]!r}; they are {known}"
        )
    return _Asked(chosen, fail_on, expectations)


class _Audits(pytest.Collector):
    """The place of the audit among the tests."""

    def __init__(self, asked: _Asked, **given: Any) -> None:
        super().__init__(nodeid="ransac-fix", **given)
        self._asked = asked

    def collect(self) -> list[pytest.Item]:
        return [_Audit.from_parent(self, name="audit", asked=self._asked)]


class _Audit(pytest.Item):
    """The audit of the installed libraries, as one test."""

    def __init__(self, asked: _Asked, **given: Any) -> None:
        super().__init__(**given)
        self._asked = asked

    def runtest(self) -> None:
        from ransac_fix.audit.session import Options, audit

        quick = not self.config.getini("ransac_fix_every_entry_point")
        report = audit(Options(self._asked.systems, sys.executable, quick=quick))
        complaints = list(_complaints(report, self._asked))
        if complaints:
            pytest.fail("\n".join(complaints), pytrace=False)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.config.rootpath, None, "ransac-fix audit"


def _complaints(report: "Report", asked: _Asked) -> Iterator[str]:
    """Say what is wrong with an audit, a line each."""
    from ransac_fix.audit.expectations import compare

    for control in report.controls:
        if not control.passed:
            yield f"ransac-fix: control {control.name} was not identified: no verdict is given"
            return
    surprises = compare(report.verdicts, asked.expectations, asked.fail_on)
    for unexpected in surprises.unexpected:
        yield f"{_name(unexpected.verdict)}: {unexpected.what}"
        if unexpected.verdict.advice:
            yield f"  {unexpected.verdict.advice}"
    for one in surprises.unmet:
        yield f"expected but not seen: {one.name}: {one.verdict}"
    # What was named is to be measured, at least in part.
    accepted = {one.system for one in asked.expectations if one.verdict == "not measured"}
    for system in asked.systems:
        of_system = [verdict for verdict in report.verdicts if verdict.system == system]
        if system not in accepted and all(one.verdict == "not measured" for one in of_system):
            reasons = [one.reason for one in of_system]
            yield f"{system}: nothing could be measured: {(reasons or ['no entry point'])[0]}"


def _name(verdict: "Verdict") -> str:
    return " ".join(filter(None, (verdict.system, verdict.version, verdict.entry_point)))
