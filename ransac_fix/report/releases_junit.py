"""An audit of releases as JUnit XML: one test suite a release, one test case an entry point."""

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ransac_fix.audit.expectations import Surprises
from ransac_fix.audit.releases.model import ReleaseReport
from ransac_fix.report.verdicts_junit import (
    compared_cases,
    control_case,
    count_cases,
    unmet_cases,
    verdict_case,
)
from ransac_fix.report.xml_text import cleaned


def releases_junit(report: ReleaseReport, surprises: Surprises | None = None) -> str:
    """Return the audit as JUnit test suites; see `verdicts_junit` for what fails."""
    suites = Element("testsuites", name="ransac-fix audit", time=f"{report.seconds:.2f}")
    for release in report.releases:
        suite = SubElement(suites, "testsuite", name=f"{release.distribution} {release.version}")
        if surprises is None:
            for verdict in release.verdicts:
                verdict_case(suite, verdict)
        else:
            compared_cases(suite, release.verdicts, surprises)
        if not release.verdicts:
            case = SubElement(suite, "testcase", classname=release.system, name="-")
            SubElement(case, "skipped", message=cleaned(release.unmeasured))
        count_cases(suite)
    if surprises is not None and surprises.unmet:
        suite = SubElement(suites, "testsuite", name="expected")
        unmet_cases(suite, surprises)
        count_cases(suite)
    controls = SubElement(suites, "testsuite", name="controls")
    for control in report.controls:
        control_case(controls, control)
    count_cases(controls)
    indent(suites)
    return tostring(suites, encoding="unicode", xml_declaration=True)
