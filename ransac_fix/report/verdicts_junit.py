"""An audit as JUnit XML: one test case an entry point."""

from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ransac_fix.audit.expectations import Surprises
from ransac_fix.audit.model import Control, Judgement, Report, Verdict
from ransac_fix.report.outcomes_text import outcome_summary
from ransac_fix.report.xml_text import cleaned

_FAILURE: Judgement = "undersamples"


def verdicts_junit(report: Report, surprises: Surprises | None = None) -> str:
    """Return the audit as a JUnit test suite.

    What undersamples is a failure, or, where verdicts are expected, what differs from them. What
    was not measured is skipped with its reason, and a control that was not identified is an
    error.
    """
    suite = Element("testsuite", name="ransac-fix audit", time=f"{report.seconds:.2f}")
    if surprises is None:
        for verdict in report.verdicts:
            verdict_case(suite, verdict)
    else:
        compared_cases(suite, report.verdicts, surprises)
        unmet_cases(suite, surprises)
    for control in report.controls:
        control_case(suite, control)
    count_cases(suite)
    indent(suite)
    return tostring(suite, encoding="unicode", xml_declaration=True)


def compared_cases(suite: Element, verdicts: Iterable[Verdict], surprises: Surprises) -> None:
    """Add entry points to a test suite; what fails is what was not expected."""
    unexpected = {id(one.verdict): one.what for one in surprises.unexpected}
    for verdict in verdicts:
        verdict_case(suite, verdict, failure=unexpected.get(id(verdict)))


def unmet_cases(suite: Element, surprises: Surprises) -> None:
    """Add what was expected and not seen to a test suite, as failures."""
    for unmet in surprises.unmet:
        name = f"{unmet.entry_point}{f' in {unmet.releases}' if unmet.releases else ''}"
        case = SubElement(suite, "testcase", classname=unmet.system, name=name)
        message = f"expected but not seen: {unmet.verdict}"
        SubElement(case, "failure", message=cleaned(message)).text = cleaned(unmet.reason)


_JUDGED = "judged"


def verdict_case(suite: Element, verdict: Verdict, failure: str | None = _JUDGED) -> None:
    """Add one entry point to a test suite; what fails is what undersamples, unless it is said."""
    case = SubElement(
        suite,
        "testcase",
        classname=verdict.system,
        name=cleaned(verdict.entry_point),
        time=f"{verdict.seconds:.2f}",
    )
    found = f"{verdict.verdict}: {verdict.reason}"
    if failure is _JUDGED:
        failure = found if verdict.verdict == _FAILURE else None
    if failure is not None:
        evidence = "" if verdict.outcomes is None else outcome_summary(verdict.outcomes)
        text = " ".join(filter(None, (verdict.advice, evidence)))
        SubElement(case, "failure", message=cleaned(failure)).text = cleaned(text)
    elif verdict.verdict == "not measured":
        SubElement(case, "skipped", message=cleaned(verdict.reason))
    elif verdict.verdict != "exact":
        SubElement(case, "system-out").text = cleaned(found)


def control_case(suite: Element, control: Control) -> None:
    """Add one known law to a test suite."""
    case = SubElement(suite, "testcase", classname="control", name=control.name)
    if not control.passed:
        message = f"put in {control.expected}, found {control.identified}"
        SubElement(case, "error", message=cleaned(message))


def count_cases(suite: Element) -> None:
    """Write the counts of a test suite's cases on it."""
    suite.set("tests", str(len(suite)))
    for attribute, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(attribute, str(sum(case.find(tag) is not None for case in suite)))
