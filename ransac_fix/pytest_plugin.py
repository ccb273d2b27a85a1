"""The pytest plugin: a fixture for a project's own RANSAC, and an audit of what it installs.

It is loaded by every pytest session of an environment with ransac-fix, so it imports nothing but
pytest until it is used, and does nothing unless a test asks for its fixture or the project's
configuration sets ``ransac_fix_audit``. `docs/testing.md` shows both.
"""

import sys
from collections.abc import Callable, Iterator
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
    from ransac_fix.testing import assert_stopping_rule

    return assert_stopping_rule


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Add the audit to a session, unless single tests were named."""
    systems = tuple(config.getini("ransac_fix_audit"))
    if systems and not any("::" in argument for argument in config.args):
        items += _Audits.from_parent(session, name="ransac-fix", systems=systems).collect()


class _Audits(pytest.Collector):
    """The place of the audit among the tests."""

    def __init__(self, systems: tuple[str, ...], **given: Any) -> None:
        super().__init__(nodeid="ransac-fix", **given)
        self._systems = systems

    def collect(self) -> list[pytest.Item]:
        from ransac_fix.audit.expectations import load_expectations
        from ransac_fix.audit.model import JUDGEMENTS
        from ransac_fix.audit.session import chosen_probes
        from ransac_fix.errors import RansacFixError

        config = self.config
        try:
            chosen = () if self._systems == (_EVERY,) else tuple(chosen_probes(self._systems))
            expect = config.getini("ransac_fix_expect")
            expectations = load_expectations(_beside_ini(config) / expect) if expect else ()
        except RansacFixError as error:
            raise pytest.UsageError(f"ransac-fix: {error}") from None
        fail_on = frozenset(config.getini("ransac_fix_fail_on"))
        unknown = sorted(fail_on - set(JUDGEMENTS))
        if unknown:
            known = ", ".join(JUDGEMENTS)
            raise pytest.UsageError(
                f"ransac_fix_fail_on: there is no verdict {unknown[0]!r}; they are {known}"
            )
        item = _Audit.from_parent(
            self, name="audit", systems=chosen, fail_on=fail_on, expectations=expectations
        )
        return [item]


class _Audit(pytest.Item):
    """The audit of the installed libraries, as one test."""

    def __init__(
        self,
        systems: tuple[str, ...],
        fail_on: "frozenset[Judgement]",
        expectations: "tuple[Expectation, ...]",
        **given: Any,
    ) -> None:
        super().__init__(**given)
        self._systems = systems
        self._fail_on = fail_on
        self._expectations = expectations

    def runtest(self) -> None:
        from ransac_fix.audit.session import Options, audit

        quick = not self.config.getini("ransac_fix_every_entry_point")
        report = audit(Options(self._systems, sys.executable, quick=quick))
        complaints = list(_complaints(report, self._fail_on, self._expectations))
        if complaints:
            pytest.fail("\n".join(complaints), pytrace=False)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.config.rootpath, None, "ransac-fix audit"


def _beside_ini(config: pytest.Config) -> Path:
    return config.rootpath if config.inipath is None else config.inipath.parent


def _complaints(
    report: "Report", fail_on: "frozenset[Judgement]", expectations: "tuple[Expectation, ...]"
) -> Iterator[str]:
    """Say what is wrong with an audit, a line each."""
    from ransac_fix.audit.expectations import compare

    for control in report.controls:
        if not control.passed:
            yield f"ransac-fix: control {control.name} was not identified: no verdict is given"
            return
    surprises = compare(report, expectations, fail_on)
    for unexpected in surprises.unexpected:
        yield f"{_name(unexpected.verdict)}: {unexpected.what}"
        if unexpected.verdict.advice:
            yield f"  {unexpected.verdict.advice}"
    for one in surprises.unmet:
        yield f"expected but not seen: {one.system} {one.entry_point}: {one.verdict}"
    accepted = {(one.system, one.verdict) for one in expectations}
    for system in dict.fromkeys(verdict.system for verdict in report.verdicts):
        of_system = [verdict for verdict in report.verdicts if verdict.system == system]
        if (system, "not measured") not in accepted and all(
            verdict.verdict == "not measured" for verdict in of_system
        ):
            yield f"{system}: nothing could be measured: {of_system[0].reason}"


def _name(verdict: "Verdict") -> str:
    return " ".join(filter(None, (verdict.system, verdict.version, verdict.entry_point)))
