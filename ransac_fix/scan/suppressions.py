"""Comments that set a finding aside: ``ransac-fix: ignore[RFX001] -- reason``, ``noqa: RFX001``.

A comment holds for the findings that touch its line; behind a string of several lines, for those in
the string. A bare ``noqa`` is another tool's.
"""

import io
import re
import tokenize
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from ransac_fix.scan.findings import Finding
from ransac_fix.scan.form import Span

_IGNORE = re.compile(
    r"ransac-fix:\s*ignore(?:\[(?P<codes>[^\]]*)\]|(?!\[))(?:\s*--\s*(?P<reason>.*\S))?"
)
_NOQA = re.compile(r"noqa\s*:\s*(?P<codes>[A-Z]+[0-9]+(?:[,\s]+[A-Z]+[0-9]+)*)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment of a file.

    Attributes
    ----------
    text : str
    span : Span
    first_line : int or None
        Where the string of several lines begins that it stands behind; None where it does not.
    """

    text: str
    span: Span
    first_line: int | None = None


@dataclass(frozen=True, slots=True)
class Suppression:
    """A comment that sets findings aside.

    Attributes
    ----------
    codes : tuple of str
        The rules it names; empty means every rule.
    reason : str
        Why, as it says itself.
    span : Span
    first_line : int or None
        As in :class:`Comment`.
    """

    codes: tuple[str, ...]
    reason: str
    span: Span
    first_line: int | None = None


def python_comments(source: str) -> Iterator[Comment]:
    """Yield the comments of a Python module, as far as it can be read."""
    string: tokenize.TokenInfo | None = None
    try:
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type == tokenize.STRING:
                string = token
            elif token.type == tokenize.COMMENT:
                (line, column), (end_line, end_column) = token.start, token.end
                behind = string is not None and string.start[0] < string.end[0] == line
                first = string.start[0] if string is not None and behind else None
                yield Comment(token.string, Span(line, column, end_line, end_column), first)
    except (tokenize.TokenError, SyntaxError):
        return


def suppressions(comments: Iterable[Comment]) -> list[Suppression]:
    """Read the comments that set findings aside."""
    found: list[Suppression] = []
    for comment in comments:
        own = _IGNORE.search(comment.text)
        if own:
            # What is no code sets nothing aside, and is reported as unused.
            codes = tuple(code.upper() for code in re.findall(r"[^\s,]+", own["codes"] or ""))
            reason = own["reason"] or ""
            found.append(Suppression(codes, reason, comment.span, comment.first_line))
            continue
        foreign = _NOQA.search(comment.text)
        if foreign:
            codes = tuple(
                code.upper()
                for code in re.findall(r"\w+", foreign["codes"])
                if code.upper().startswith("RFX")
            )
            if codes:
                found.append(Suppression(codes, "", comment.span, comment.first_line))
    return found


def apply(
    findings: Sequence[Finding], known: Sequence[Suppression]
) -> tuple[list[Finding], list[Finding], list[Suppression]]:
    """Set findings aside.

    Returns
    -------
    kept : list of Finding
    suppressed : list of Finding
        With the reason in ``suppression``.
    unused : list of Suppression
        Those that set nothing aside.
    """
    kept: list[Finding] = []
    suppressed: list[Finding] = []
    used: set[Suppression] = set()
    for finding in findings:
        match = next((one for one in known if _holds(one, finding)), None)
        if match is None:
            kept.append(finding)
        else:
            used.add(match)
            suppressed.append(replace(finding, suppression=match.reason))
    return kept, suppressed, [one for one in known if one not in used]


def _holds(suppression: Suppression, finding: Finding) -> bool:
    place = finding.location
    last = suppression.span.end_line  # a comment may have several lines, in C
    first = suppression.span.line if suppression.first_line is None else suppression.first_line
    touches = place.start_line <= last and first <= place.end_line
    return touches and (not suppression.codes or finding.code in suppression.codes)


def has_any(source: str) -> bool:
    """Whether a text could hold a suppression at all."""
    return "ransac-fix:" in source or "RFX" in source
