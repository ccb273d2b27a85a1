"""Findings as JUnit XML: one failed test case a finding, one passed where there is none."""

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ransac_fix.report.findings_text import place
from ransac_fix.report.xml_text import cleaned
from ransac_fix.scan import ScanResult


def findings_junit(result: ScanResult) -> str:
    """Return the scan as a test suite.

    A finding is a failure, a note is the output of a test that passes, one set aside by a comment
    is skipped with its reason, and a file that could not be read is an error.
    """
    total = len(result.findings) + len(result.suppressed) + len(result.errors)
    suite = Element(
        "testsuite",
        name="ransac-fix scan",
        tests=str(max(total, 1)),
        failures=str(len(result.warnings)),
        errors=str(len(result.errors)),
        skipped=str(len(result.suppressed)),
    )
    for finding in result.findings:
        case = _case(suite, finding.location.path, finding.code, finding.location.start_line)
        text = f"{place(finding.location)}\n{finding.expression}"
        if finding.severity == "note":
            SubElement(case, "system-out").text = cleaned(f"{finding.message}\n{text}")
            continue
        failure = SubElement(case, "failure", message=cleaned(finding.message))
        failure.text = cleaned(text)
    for finding in result.suppressed:
        case = _case(suite, finding.location.path, finding.code, finding.location.start_line)
        SubElement(case, "skipped", message=cleaned(finding.suppression or "no reason given"))
    for error in result.errors:
        case = _case(suite, error.path, error.code, error.line or 1)
        SubElement(case, "error", message=cleaned(error.message))
    if not total:
        SubElement(suite, "testcase", classname="ransac-fix", name="scan")
    indent(suite)
    return f"{tostring(suite, encoding='unicode', xml_declaration=True)}\n"


def _case(suite: Element, path: str, code: str, line: int) -> Element:
    path = cleaned(path)
    name = f"{code} line {line}"
    return SubElement(suite, "testcase", classname=path, name=name, file=path, line=str(line))
