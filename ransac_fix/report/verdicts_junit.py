"""An audit as JUnit XML: one test case an entry point."""

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ransac_fix.audit.model import Control, Judgement, Report, Verdict

_FAILURE: Judgement = "undersamples"


def verdicts_junit(report: Report) -> str:
    """Return the audit as a JUnit test suite.

    What undersamples is a failure, what was not measured is skipped with its reason, and a
    control that was not identified is an error.
    """
    counts = [verdict.verdict for verdict in report.verdicts]
    failed = [control for control in report.controls if not control.passed]
    suite = Element(
        "testsuite",
        name="ransac-fix audit",
        tests=str(len(counts) + len(report.controls)),
        failures=str(counts.count(_FAILURE)),
        errors=str(len(failed)),
        skipped=str(counts.count("not measured")),
        time=f"{report.seconds:.2f}",
    )
    for verdict in report.verdicts:
        verdict_case(suite, verdict)
    for control in report.controls:
        control_case(suite, control)
    indent(suite)
    return tostring(suite, encoding="unicode", xml_declaration=True)


def verdict_case(suite: Element, verdict: Verdict) -> None:
    """Add one entry point to a test suite."""
    case = SubElement(
        suite,
        "testcase",
        classname=verdict.system,
        name=verdict.entry_point,
        time=f"{verdict.seconds:.2f}",
    )
    if verdict.verdict == _FAILURE:
        message = f"{verdict.verdict}: {verdict.reason}"
        SubElement(case, "failure", message=message).text = verdict.advice
    elif verdict.verdict == "not measured":
        SubElement(case, "skipped", message=verdict.reason)
    elif verdict.verdict != "exact":
        SubElement(case, "system-out").text = f"{verdict.verdict}: {verdict.reason}"


def control_case(suite: Element, control: Control) -> None:
    """Add one known law to a test suite."""
    case = SubElement(suite, "testcase", classname="control", name=control.name)
    if not control.passed:
        message = f"put in {control.expected}, found {control.identified}"
        SubElement(case, "error", message=message)
