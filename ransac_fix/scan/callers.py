"""Calls from other files of functions that take a ratio: the counts are there, if anywhere."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from ransac_fix.scan import cpp, python
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.findings import Finding, Location, Related, ScanError
from ransac_fix.scan.form import Call, Name
from ransac_fix.scan.reading import Text
from ransac_fix.scan.scanner import decode, read_file
from ransac_fix.scan.walk import expressions

_SHOWN = 5
_WIDTH = 100


def with_callers(findings: Iterable[Finding], files: Sequence[SourceFile]) -> list[Finding]:
    """Add to findings without a fix where other files call their function.

    Parameters
    ----------
    findings : iterable of Finding
    files : sequence of SourceFile
        Those that were scanned.
    """
    findings = list(findings)
    wanted = {finding.callee for finding in findings if finding.callee}
    if not wanted:
        return findings
    calls: dict[tuple[str, str], list[Related]] = {}
    for file in files:
        for name, call in _calls(file, wanted):
            calls.setdefault((file.language, name), []).append(call)
    languages = {file.path: file.language for file in files}
    return [_with(finding, calls, languages) for finding in findings]


def _with(
    finding: Finding,
    calls: dict[tuple[str, str], list[Related]],
    languages: dict[str, str],
) -> Finding:
    language = languages.get(finding.location.path, "")
    found = [
        one
        for one in calls.get((language, finding.callee), [])
        if one.location.path != finding.location.path
    ]
    if not finding.callee or not found:
        return finding
    shown = found[:_SHOWN]
    if len(found) > _SHOWN:
        more = f"{shown[-1].message}, and {len(found) - _SHOWN} more"
        shown[-1] = Related(shown[-1].location, more)
    return replace(finding, related=(*finding.related, *shown))


def _calls(file: SourceFile, wanted: set[str]) -> Iterator[tuple[str, Related]]:
    """Yield the calls of the wanted functions in a file, with the name that is called."""
    if file.language not in ("python", "c++"):
        return
    data = read_file(file)
    listed = "|".join(map(re.escape, sorted(wanted))).encode()
    if isinstance(data, ScanError) or not re.search(
        rb"\b(?:" + listed + rb")\s*(?:<[^;(){}]*>)?\s*\(", data
    ):
        return
    try:
        source = decode(data, file.language)
        module = cpp.parse(source) if file.language == "c++" else python.parse(source)
    except (SyntaxError, UnicodeError, LookupError, ValueError, RecursionError):
        return  # said of it already, where it was scanned
    text = Text(source)
    for expr, _, _ in expressions(module.body, None, 0):
        if isinstance(expr, Call) and expr.name in wanted and (expr.args or expr.keywords):
            span = expr.span
            if span is None:
                continue
            place = Location(
                file.path, span.line, span.column + 1, span.end_line, span.end_column + 1
            )
            spelled = " ".join(text.at(span).split())
            shown = spelled if len(spelled) <= _WIDTH else f"{spelled[: _WIDTH - 3]}..."
            yield expr.name, Related(place, f"called here{_made(expr, source)}: {shown}")


def _made(call: Call, source: str) -> str:
    """Say where a file makes a quotient of counts of what a call passes."""
    given = (*call.args, *(value for _, value in call.keywords))
    for name in (one.name for one in given if isinstance(one, Name)):
        last = re.escape(name.rpartition(".")[2])
        divided = re.search(rf"\b{last}\s*=(?!=)[^;{{}}=]{{0,200}}?[^/*]/[^/*]", source)
        if divided:
            line = source.count("\n", 0, divided.start()) + 1
            return f", with {name.removeprefix('this.')} of line {line}"
    return ""
