"""The gate before the parser: whether a file's text has all that a stopping rule is made of.

A rule is made of a complement, ``1 - P``; of a power or a product for P; and

- of a logarithm (of that complement);
- or, without logarithms, of a power of the complement whose exponent is no number, or of a product
  that takes it once more in each run of a loop, and of a comparison;
- or, solved for the inliers, of two such powers and a product.

Everything here errs towards reading too much.
"""

import re
from collections.abc import Iterator
from functools import cache

from ransac_fix.scan import functions

# A comment or a string, as the language reads them: in Python those of three marks first.
_MARKED = {
    "python": re.compile(
        r"#[^\n]*+"
        r'|"""(?:[^"\\]++|\\.|"(?!""))*+"""'
        r"|'''(?:[^'\\]++|\\.|'(?!''))*+'''"
        r'|"[^"\\\n]*+(?:\\.[^"\\\n]*+)*+"'
        r"|'[^'\\\n]*+(?:\\.[^'\\\n]*+)*+'",
        re.DOTALL,
    ),
    "c++": re.compile(
        r"//[^\n]*+|/\*.*?\*/|\"[^\"\\\n]*+(?:\\.[^\"\\\n]*+)*+\"|'(?:[^'\\\n]|\\.)'", re.DOTALL
    ),
}

# What a word says of a text that it stands in.
_LOG, _POWER, _OPEN, _COMPLEMENT, _LOOP, _COMPARISON = 1, 2, 4, 8, 16, 32
_KINDS = {**functions.UNARY, **functions.BINARY}
_LOGS = ("logn", "LogX", *(name for name, kind in _KINDS.items() if kind in ("log", "log1p")))
_SAID = {
    **dict.fromkeys(("log1p", "sub", "rsub"), _COMPLEMENT),
    **dict.fromkeys(
        ("exp", "square", "factorial", "gamma", "lgamma", "comb", "mul"),
        _POWER,
    ),
    "expm1": _POWER | _COMPLEMENT,
    "pow": _POWER | _OPEN,
}
_SAYS = {
    **{name: _SAID.get(kind, 0) for name, kind in _KINDS.items()},
    "hypergeom": _POWER,
    "geom": _COMPLEMENT | _POWER | _OPEN | _LOG,
    "binom": _COMPLEMENT | _POWER | _OPEN,
    **dict.fromkeys((*functions.PRODUCTS, "reduce"), _POWER | _OPEN),
    **dict.fromkeys((*functions.ONES, "one", "One", "ONE"), _COMPLEMENT),
    **dict.fromkeys(functions.COMPARISONS, _COMPARISON),
    "for": _LOOP,
    "while": _LOOP,
    "do": _LOOP,
}

_FORMATTED = re.compile(r"[fFtT][rR]?$|[rR][fFtT]$")
_WORD = re.compile(r"[A-Za-z_]\w*")
_LOG_CALL = re.compile(
    rf"(?:{'|'.join(sorted(_LOGS, key=len, reverse=True))})_?\s*(?:<[^<>()]*>)?\s*\("
)
# Another name for one of them, or for a power: `log as ln`, `ln = math.log`.
_ALIAS = re.compile(
    rf"(?:{'|'.join((*_LOGS, 'pow', 'power', 'prod'))})(?:\s+as\s|[ \t]*;?[ \t]*$)", re.MULTILINE
)
_MAPPED = re.compile(rf"map\s*\(\s*[\w.]*(?:{'|'.join(_LOGS)})\s*,")
_STARS = re.compile(r"\*\*?=?")
_LITERAL = re.compile(r"(?<![\w.])[\d.]+$")
_LITERAL_EXPONENT = re.compile(r"[\s\-]*[\d.]")
_ASSIGNED = re.compile(r"[^=\n]*?(\w+)\s*(?::[^=\n]*)?=(?!=)")
# 1 - p, 1.0f - p, T(1) - p
_ONE_LESS = re.compile(r"1(?:\.0*)?[fFlL]?[\s)\]}\"']*-")
# (-p + 1), 1 + -p, -(p - 1)
_PLUS_ONE = re.compile(r"\+\s*(?:-|1(?![\d.]*[1-9]))")
_LESS_ONE = re.compile(r"-\s*1(?:\.0*)?\s*\)")
_MINUS_GROUP = re.compile(r"-\s*\(")
# (a - b) / a, log(a - b) - log(a)
_OF_WHOLE = re.compile(r"-[^;=\n]*\)\s*(?:/|-[^;=\n]*log)")
_IS_ONE = re.compile(r"=\s*(?:[\w.]+[(\[{])*1(?:\.0*)?[fFlL]?(?![\w.])")
_NAME = re.compile(r"(\w+)\s*(?::[^=\n]*)?$")


def could_hold_a_rule(code: str) -> bool:
    """Whether a file's text could hold a rule at all: its code, as :func:`split` gives it."""
    says = 0
    for word in set(_WORD.findall(code)):
        says |= _said_by(word)
    powers, opened, grows = _signs(code)
    powers += 2 * bool(says & _POWER)
    if not powers or not (says & _COMPLEMENT or _complements(code)):
        return False
    if says & _LOG or _takes_log(code):
        return True
    opened += 2 * bool(says & _OPEN)
    if opened > 1 and powers > 2:
        return True
    compares = says & _COMPARISON or "<" in code or ">" in code.replace("->", "")
    return powers > 1 and bool(compares and (opened or (grows and says & _LOOP)))


def split(source: str, language: str = "python") -> tuple[str, str]:
    """Tell the code of a file from what is written in it.

    Parameters
    ----------
    source : str
    language : {"python", "c++"}

    Returns
    -------
    code : str
        The file without its comments and strings, with the lines that it had. An f-string stays,
        because it holds code.
    prose : str
        The comments and strings, one after the other.
    """
    prose: list[str] = []

    def kept(found: re.Match[str]) -> str:
        text = found[0]
        if text[0] in "#/":
            prose.append(text)
            return "\n" * text.count("\n")
        start = found.start()
        if language == "python" and _FORMATTED.search(source, max(0, start - 2), start):
            return text
        prose.append(text)
        return '""' + "\n" * text.count("\n") if "\n" in text else '""'

    source = source.replace("\r\n", "\n").replace("\r", "\n")
    return _MARKED[language].sub(kept, source), "\n".join(prose)


def comments(source: str) -> Iterator[tuple[int, str]]:
    """Yield the comments of a Python file, each with the place where it begins."""
    for found in _MARKED["python"].finditer(source):
        if found[0][0] == "#":
            yield found.start(), found[0]


@cache
def _said_by(word: str) -> int:
    said = _SAYS.get(word, 0) | _SAYS.get(word.removesuffix("_"), 0)
    if functions.is_power(word):
        said |= _POWER | _OPEN
    if functions.fixed_power(word) is not None:
        said |= _POWER
    if functions.own_logarithm(word) == "log1p":
        said |= _COMPLEMENT
    return said


def _takes_log(code: str) -> bool:
    """Whether a logarithm is called, or gets another name."""
    for found in _LOG_CALL.finditer(code):
        if not code[found.start() - 1 : found.start()].isalpha():
            return True
    return bool(_ALIAS.search(code) or _MAPPED.search(code))


def _signs(code: str) -> tuple[int, int, bool]:
    """Count the powers and products that stars spell, and the open powers; say if one grows."""
    powers = opened = 0
    grows = False
    for found in _STARS.finditer(code):
        start, sign = found.start(), found[0]
        before = code[max(0, start - 30) : start].rstrip(" \t\n\\")
        # Not f(*values), f(**options), import *
        if not before or not (before[-1].isalnum() or before[-1] in "_)]}\"'"):
            continue
        if before.endswith("import"):
            continue
        powers += 1
        if sign[:2] == "**":
            literal = _LITERAL.search(before) or _LITERAL_EXPONENT.match(code, found.end())
            opened += not literal
        elif not grows:
            grows = sign == "*=" or _multiplies_itself(code, start)
        if grows and opened > 1 and powers > 2:
            break
    return powers, opened, grows


def _multiplies_itself(code: str, star: int) -> bool:
    """Whether the statement around a sign assigns to a name that it also has a use for."""
    end = code.find("\n", star)
    end = len(code) if end < 0 else end
    start = star
    for _ in range(6):  # lines of one statement
        start = code.rfind("\n", 0, start)
        assigned = _ASSIGNED.match(code, start + 1, end)
        if assigned:
            return bool(re.search(rf"\b{assigned[1]}\b", code[assigned.end() : end]))
        if start < 0:
            break
    return False


def _complements(code: str) -> bool:
    """Whether something is taken from one."""
    if _PLUS_ONE.search(code):
        return True
    for found in _ONE_LESS.finditer(code):
        before = code[found.start() - 1 : found.start()]
        if not (before.isalnum() or before in ("_", ".")):
            return True
    if _LESS_ONE.search(code) and _MINUS_GROUP.search(code):
        return True
    if _OF_WHOLE.search(code):
        return True
    ones: set[str] = set()
    for found in _IS_ONE.finditer(code):
        named = _NAME.search(code[max(0, found.start() - 60) : found.start()])
        if named:
            ones.add(named[1])
    return bool(ones) and bool(re.search(rf"(?:{'|'.join(ones)})\b[\s)\]}}]*-", code))
