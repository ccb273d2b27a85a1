"""Formulas in comments and docstrings.

What is written about a stopping rule is read by the same recogniser as the rule itself: a formula
is spelled as an expression of Python, whatever it is written in (plain text, LaTeX, the syntax of
the language around it, a fraction on three lines), and its algebra says what it is.
"""

import ast
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

from ransac_fix.scan import evaluate, python, triage
from ransac_fix.scan.form import Span
from ransac_fix.scan.nodes import TooComplex
from ransac_fix.scan.reading import Text, roles_of
from ransac_fix.scan.recogniser import recognise
from ransac_fix.scan.suppressions import Comment

_DASHES = "\N{MINUS SIGN}\N{EN DASH}"
_TIMES = "\N{MULTIPLICATION SIGN}\N{MIDDLE DOT}"
_RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹ⁿᵏᵐˢ"
# The logarithm of the complement of a power, as far as a search can say.
_STATED = re.compile(
    r"(?:log|Log|\bln\()[\w\s\\.(\[{]{0,16}?"
    rf"(?<![\d.])1(?:\.0*)?f?[\s)}}]*[-{_DASHES}][^\"';]{{0,120}}?(?:\^|\*|pow|[{_RAISED}])"
)
# A power of the complement of a power.
_POWERED = re.compile(
    rf"\(\s*1(?:\.0*)?\s*[-{_DASHES}][^\"';]{{1,60}}?(?:\^|\*\*)[^\"';]{{1,40}}?\)[\s}}]*(?:\^|\*\*)"
)
_LEAD = re.compile(r"[ \t]*(?:#+[:|!]?|//+[/!]?<?|/\*+[*!]?<?|\*+(?!/)|%+)?")
_NAME = rf"[^\W\d{_RAISED}][^\W{_RAISED}]*"
_TOKEN = re.compile(
    r"(?P<space>\s+)"
    r"|(?P<bar>(?:-{3,}|_{3,}|─{2,}|—{2,}|={4,}))"
    r"|(?P<number>\d+(?:\.\d*)?(?:[eE]-?\d+)?f?|\.\d+)"
    r"|(?P<command>\\+[a-zA-Z]+)"
    rf"|(?P<raised>[{_RAISED}]+)"
    rf"|(?P<name>{_NAME}(?:(?:\.|::){_NAME})*)"
    rf"|(?P<sign>\*\*|[-{_DASHES}{_TIMES}+*/÷^(){{}}\[\],=])"
    r"|(?P<other>\\.|.)",
    re.DOTALL,
)
_LOGS = frozenset(("log", "ln", "log10", "log2", "loge", "log_e", "logf", "log_2", "log_10"))
_SIGNS = {"^": "**", "÷": "/", "{": "(", "}": ")", "[": "(", "]": ")"}
_SIGNS |= dict.fromkeys(_DASHES, "-") | dict.fromkeys(_TIMES, "*")
_COMMANDS = {"cdot": "*", "times": "*", "ast": "*", "div": "/"}
_QUIET_COMMANDS = frozenset(
    (
        *("left", "right", "big", "Big", "bigg", "Bigg", "bigl", "bigr", "Bigl", "Bigr"),
        *("mathrm", "mathit", "mathbf", "text", "textit", "operatorname"),
        *("displaystyle", "quad", "qquad"),
    )
)
_FRACTIONS = frozenset(("frac", "dfrac", "tfrac", "cfrac"))
_LOWERED = str.maketrans(_RAISED, "0123456789nkms")
_OPEN, _CLOSE = "(", ")"
_WORDS_OF_DIVISION = frozenset(("over", "by"))
_NAMES = re.compile(r"[^\W\d]\w*")
_MAX_TOKENS = 120
_MAX_WORDS = 6


@dataclass(frozen=True, slots=True)
class Prose:
    """A docstring, or comments that follow each other.

    Attributes
    ----------
    text : str
        As it stands in the file, signs of comments included.
    span : Span
    """

    text: str
    span: Span


@dataclass(frozen=True, slots=True)
class Formula:
    """A stopping rule that prose states.

    Attributes
    ----------
    kind : {"approximate", "exact", "replacement"}
        The probability that it assumes.
    spelled : str
        The formula as an expression of Python.
    roles : mapping
        What was recognised, as in a finding.
    span : Span
        Where it stands in the file.
    """

    kind: str
    spelled: str
    roles: Mapping[str, str]
    span: Span


def may_state_a_rule(source: str, written: str) -> bool:
    """Whether a text could state a stopping rule in what is written in it, which may be all."""
    logarithms = "log" in source or "Log" in source or "ln(" in source
    return logarithms and _states_something(written)


def _states_something(text: str) -> bool:
    return bool(_STATED.search(text) or _POWERED.search(text))


def python_prose(source: str, tree: ast.Module) -> Iterator[Prose]:
    """Yield the docstrings of a Python module and other strings that stand alone, then comments."""
    lines = python.split_lines(source)
    left: list[ast.AST] = [tree]
    found: list[Prose] = []
    while left:
        for node in ast.iter_child_nodes(left.pop()):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                if isinstance(node.value.value, str):
                    span = _span_of(node.value, lines)
                    block = lines[span.line - 1 : span.end_line]
                    block[-1] = block[-1][: span.end_column]
                    block[0] = block[0][span.column :]
                    found.append(Prose("\n".join(block), span))
            elif isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case):
                left.append(node)
    yield from sorted(found, key=lambda one: one.span)
    comments: list[Comment] = []
    starts = list(accumulate((len(line) + 1 for line in lines), initial=0))
    for offset, comment in triage.comments("\n".join(lines)):
        line = bisect_right(starts, offset)
        column = offset - starts[line - 1]
        comments.append(Comment(comment, Span(line, column, line, column + len(comment))))
    yield from blocks(comments, lines)


def blocks(comments: Iterable[Comment], lines: Sequence[str]) -> Iterator[Prose]:
    """Join the comments with nothing but blank lines between; ``lines`` are those of the file."""
    block: list[Comment] = []
    for comment in comments:
        alone = not lines[comment.span.line - 1][: comment.span.column].strip()
        follows = (
            bool(block)
            and alone
            and comment.span.column == block[0].span.column
            and not any(
                line.strip() for line in lines[block[-1].span.end_line : comment.span.line - 1]
            )
        )
        if block and not follows:
            yield _joined(block, lines)
            block = []
        block.append(comment)
    if block:
        yield _joined(block, lines)


def _joined(block: Sequence[Comment], lines: Sequence[str]) -> Prose:
    first, last = block[0].span, block[-1].span
    if len(block) == 1:
        return Prose(block[0].text, first)
    between = lines[first.line : last.end_line - 1]
    head, tail = lines[first.line - 1][first.column :], lines[last.end_line - 1][: last.end_column]
    text = "\n".join((head, *between, tail))
    return Prose(text, Span(first.line, first.column, last.end_line, last.end_column))


def _span_of(node: ast.expr, lines: Sequence[str]) -> Span:
    """Give the place of an expression, by characters and not by bytes as ``ast`` has it."""

    def characters(line: int, column: int) -> int:
        return len(lines[line - 1].encode()[:column].decode("utf-8", "replace"))

    end = node.end_lineno or node.lineno
    return Span(
        node.lineno,
        characters(node.lineno, node.col_offset),
        end,
        characters(end, node.end_col_offset or 0),
    )


def _span(start: tuple[int, int], end: tuple[int, int]) -> Span:
    return Span(start[0], start[1], end[0], end[1])


# ---- formulas -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    start: int
    end: int


def formulas(prose: Prose) -> Iterator[Formula]:
    """Yield the stopping rules that a text states, in order."""
    if not _states_something(prose.text):
        return
    tokens = _tokens(prose.text)
    place = 0
    while place < len(tokens):
        found = None
        if _is_log(tokens[place]):
            found = _quotient(tokens, place)
        elif tokens[place].text == _OPEN:
            found = _missed(tokens, place)
        if found is None:
            place += 1
            continue
        spelled, end = found
        span = _place(prose, tokens[place].start, tokens[end - 1].end)
        formula = _read(spelled, span)
        if formula is not None:
            yield formula
        place = end


def _place(prose: Prose, start: int, end: int) -> Span:
    def at(offset: int) -> tuple[int, int]:
        before = prose.text[:offset].replace("\r\n", "\n")
        line = before.count("\n")
        column = len(before) - (before.rfind("\n") + 1)
        return prose.span.line + line, column + (prose.span.column if line == 0 else 0)

    return _span(at(start), at(end))


def _tokens(text: str) -> list[_Token]:
    found: list[_Token] = []
    offset = 0
    for line in text.split("\n"):
        lead = _LEAD.match(line)
        place = 0 if lead is None else lead.end()
        for match in _TOKEN.finditer(line, place):
            kind = match.lastgroup or "other"
            if kind != "space":
                start, end = match.span()
                found += _translated(kind, match[0], offset + start, offset + end)
        offset += len(line) + 1
    return _without_fractions(found)


def _translated(kind: str, text: str, start: int, end: int) -> list[_Token]:
    def one(kind: str, text: str) -> _Token:
        return _Token(kind, text, start, end)

    match kind:
        case "bar":
            return [one("sign", "/")]
        case "number":
            return [one("number", text.rstrip("f"))]
        case "raised":
            raised = text.translate(_LOWERED)
            inner = one("number" if raised.isdigit() else "name", raised)
            return [one("sign", "**"), inner]
        case "command":
            name = text.lstrip("\\")
            if name in _QUIET_COMMANDS:
                return []
            if name in _COMMANDS:
                return [one("sign", _COMMANDS[name])]
            return [one("fraction" if name in _FRACTIONS else "name", name)]
        case "name":
            return [one("name", re.split(r"\.|::", text)[-1])]
        case "sign":
            return [one("sign", _SIGNS.get(text, text))]
        case _ if text in "$`\\" or (text.startswith("\\") and text[1:] in ",;:!  {}()[]"):
            return []
        case _:
            return [one("other", text)]


def _without_fractions(tokens: list[_Token]) -> list[_Token]:
    r"""Spell ``\frac{a}{b}`` as a division."""
    out: list[_Token] = []
    divide_before: set[int] = set()
    for place, token in enumerate(tokens):
        if token.kind == "fraction":
            end = _closing(tokens, place + 1)
            if end is not None and end < len(tokens) and tokens[end].text == _OPEN:
                divide_before.add(end)
            continue
        if place in divide_before:
            out.append(_Token("sign", "/", token.start, token.start))
        out.append(token)
    return out


def _closing(tokens: list[_Token], opening: int) -> int | None:
    """Give the place behind what closes a parenthesis."""
    depth = 0
    for place in range(opening, min(len(tokens), opening + _MAX_TOKENS)):
        text = tokens[place].text
        if text == _OPEN:
            depth += 1
        elif text == _CLOSE:
            depth -= 1
        if depth == 0:
            return place + 1 if place > opening else None
    return None


def _is_log(token: _Token) -> bool:
    return token.kind == "name" and token.text.lower() in _LOGS


def _argument(tokens: list[_Token], log: int) -> tuple[str, int] | None:
    """Spell what a logarithm is taken of, and give the place behind it."""
    opening = log + 1
    if opening >= len(tokens) or tokens[opening].text != _OPEN:
        return None
    end = _closing(tokens, opening)
    if end is None:
        return None
    spelled = _spelled(tokens[opening + 1 : end - 1])
    return None if spelled is None else (spelled, end)


def _quotient(tokens: list[_Token], place: int) -> tuple[str, int] | None:
    """Spell the quotient of logarithms that begins at a token, and give the place behind it."""
    top = _argument(tokens, place)
    if top is None:
        return None
    at = _behind(tokens, top[1], _CLOSE)
    # In a fraction on three lines the left side of the equation stands before the bar.
    name = at + 1 < len(tokens) and tokens[at].kind == "name" and tokens[at + 1].text == "="
    at += 2 if name else 0
    divided = at < len(tokens) and tokens[at].text == "divided"
    at += divided
    if at >= len(tokens) or not (tokens[at].text == "/" or (tokens[at].text in _WORDS_OF_DIVISION)):
        return None
    while at < len(tokens) and (tokens[at].text == "/" or tokens[at].text in _WORDS_OF_DIVISION):
        at += 1
    at = _behind(tokens, at, _OPEN)
    if at >= len(tokens) or not _is_log(tokens[at]):
        return None
    bottom = _argument(tokens, at)
    if bottom is None:
        return None
    return f"log({top[0]}) / log({bottom[0]})", bottom[1]


def _missed(tokens: list[_Token], place: int) -> tuple[str, int] | None:
    """Spell N powers of 1 - w**k, the chance of N samples with outliers, as the test it makes."""
    end = _closing(tokens, place)
    inner = None if end is None else tokens[place + 1 : end - 1]
    if end is None or inner is None or end + 1 >= len(tokens) or tokens[end].text != "**":
        return None
    if not inner or inner[0].text.rstrip(".0") != "1" or all(one.text != "**" for one in inner):
        return None
    last = end + 2
    if tokens[end + 1].text == _OPEN:
        last = _closing(tokens, end + 1) or 0
    base, exponent = _spelled(inner), _spelled(tokens[end + 1 : last])
    if not base or not exponent:
        return None
    return f"1 - ({base}) ** {exponent}", last


def _behind(tokens: list[_Token], place: int, text: str) -> int:
    while place < len(tokens) and tokens[place].text == text:
        place += 1
    return place


def _spelled(tokens: list[_Token]) -> str | None:
    """Spell tokens as an expression of Python; several words are one name."""
    out: list[str] = []
    words = 0
    for place, token in enumerate(tokens):
        if token.kind == "other":
            return None
        before = tokens[place - 1] if place else None
        if token.kind == "name" and before is not None and before.kind == "name":
            words += 1
            if words > _MAX_WORDS:
                return None
            out[-1] += f"_{token.text}"
            continue
        words = 0
        value = before is not None and (before.kind in ("name", "number") or before.text == _CLOSE)
        begins = token.kind in ("name", "number") or token.text == _OPEN
        called = before is not None and before.kind == "name" and before.end == token.start
        if value and begins and not (called and token.text == _OPEN):
            out.append("*")  # side by side
        out.append(token.text)
    return " ".join(out)


def _read(spelled: str, span: Span) -> Formula | None:
    """Read a formula as the recogniser does."""
    quotient = spelled.startswith("log")
    try:
        spelled = ast.unparse(ast.parse(spelled, mode="eval"))
        source = f"trials = {spelled}" if quotient else f"found = {spelled} > s"
        sites = recognise(evaluate.candidates(python.parse(source)))
    except (SyntaxError, ValueError, RecursionError, MemoryError, TooComplex):
        return None
    for site in sites:
        if site.form != "inverse":
            roles = roles_of(site, Text(source))
            size, tail = roles.get("sample_size", ""), roles.get("confidence", "")
            if size.startswith("-") or (size.isidentifier() and size in _NAMES.findall(tail)):
                return None  # log(u) / log(1 - p**u) draws a random number
            if not quotient:
                del roles["confidence"]  # ours
            return Formula(site.probability.kind, spelled, roles, span)
    return None
