"""Findings as one HTML file that needs nothing beside it; all that is scanned is escaped."""

from collections import Counter
from itertools import groupby

from ransac_fix._version import __version__
from ransac_fix.report.findings_text import summary, sure
from ransac_fix.scan import ScanResult
from ransac_fix.scan.rules import find_rule


def findings_html(result: ScanResult) -> str:
    """Return the whole scan as a page: findings by file, what was not read, what was set aside."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ransac_fix.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    counts = Counter(finding.code for finding in result.findings)
    files = groupby(result.findings, lambda finding: finding.location.path)
    page = environment.get_template("findings.html").render(
        result=result,
        summary=summary(result),
        sure=sure,
        counts=[(find_rule(code), count) for code, count in sorted(counts.items())],
        files=[(path, list(findings)) for path, findings in files],
        version=__version__,
    )
    return f"{page}\n"
