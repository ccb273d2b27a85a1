"""Which definitions of a Python file could take part in a stopping rule.

Turning source into the small form and following its definitions costs far more than searching it,
and most files with a logarithm and the word "outlier" hold no rule. So a body is only read when it
could: it divides and takes logarithms, or raises powers to powers, or it calls, is called by or
shares attributes with one that does. The rest of the file keeps its names and loses its bodies.
"""

import ast
import re
from functools import cached_property
from typing import TypeAlias

from ransac_fix.scan.python import split_lines

Definition: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef

_LOG = r"(?:[lL]og(?:2|10|1p|[fl])?|ln)"
_LOG_CALL = re.compile(rf"(?<![A-Za-z]){_LOG}\s*\(")
_LOG_ALIAS = re.compile(
    rf"(?<![A-Za-z]){_LOG}\s+as\s+(\w+)|(\w+)\s*=\s*[\w.]*\b{_LOG}[ \t]*(?:$|#)",
    re.MULTILINE,
)
_LOG_HOLDER = re.compile(r"(\w+)\s*(?::[^=\n]+)?=(?!=)[^\n]*(?<![A-Za-z])[lL]og", re.MULTILINE)
_POWER_SIGN = re.compile(r"[\w)\]}]\s*\*\*")  # not f(**options)
# w * w, and f = f * x: what a loop makes a power of
_SQUARE = re.compile(
    r"(?<![\w.])([A-Za-z_][\w.]*)\s*\*\s*\1(?![\w.(])"
    r"|(?<![\w.])([A-Za-z_][\w.]*) *=(?: *\2 *\*|[^=\n]*\* *\2\b)"
)
_POWER_WORDS = ("pow", "Pow", "POW", "square", "cube", "prod(", "exp(", "*=")
_DIVIDE = re.compile(r"/|divide|\bdiv\(|reciprocal|\blog\s*\([^\n]*,|-\s*1\b")
_COMPARE = re.compile(r"[<>]")
_CALL = re.compile(r"(\w+)\s*\(")
_READ = re.compile(r"\b(?:self|cls)\.(\w+)")
_WRITTEN = re.compile(r"\b(?:self|cls)\.(\w+)\s*(?::[^=\n]+)?(?:[-+*/]|\*\*|//)?=(?!=)")
_WORD = re.compile(r"\w+")
# 1 - p, 1.0f - p, T(1) - p, one - p, ones_like(p) - p, log1p(-p), -expm1(x), (-p + 1)
_COMPLEMENT = re.compile(
    r"(?<![\w.])1(?:\.0*)?f?\s*[)}]*\s*-|log1p|expm1|\bones?\b|ones_like|\+\s*-|\+\s*1\b"
)
_CALLERS = 3


class _Body:
    """A definition, or the statements outside of any, and what its text says of it."""

    def __init__(self, node: Definition | None, text: str, aliases: set[str]) -> None:
        self.node = node
        self.text = text
        self.logs = _takes_log(text)
        if not self.logs and aliases:
            self.logs = not aliases.isdisjoint(self.calls)
        self.powers = _powers(text)

    @cached_property
    def calls(self) -> set[str]:
        return set(_CALL.findall(self.text))

    @cached_property
    def divides(self) -> bool:
        return bool(_DIVIDE.search(self.text))

    @cached_property
    def compares(self) -> bool:
        return bool(_COMPARE.search(self.text))

    @cached_property
    def reads(self) -> set[str]:
        return set(_READ.findall(self.text)) if "self." in self.text else set()

    @cached_property
    def writes(self) -> set[str]:
        return set(_WRITTEN.findall(self.text)) if "self." in self.text else set()


def relevant(tree: ast.Module, source: str) -> set[int] | None:
    """Choose the definitions to read.

    Parameters
    ----------
    tree : ast.Module
    source : str
        The text that ``tree`` was parsed from.

    Returns
    -------
    set of int or None
        ``id`` of the function definitions whose bodies count; None when nothing in the file can
        be a rule.
    """
    lines = split_lines(source)
    aliases = _aliases(source)
    bodies: dict[str, list[_Body]] = {}
    top = list(lines)
    for node in _definitions(tree.body):
        start, end = node.lineno - 1, node.end_lineno or node.lineno
        body = _Body(node, "\n".join(lines[start:end]), aliases)
        bodies.setdefault(node.name, []).append(body)
        top[start:end] = [""] * (end - start)
    module = _Body(None, "\n".join(top), aliases)
    every = [body for same in bodies.values() for body in same]
    logging = [body for body in (module, *every) if body.logs]
    if not logging and sum(body.powers for body in (module, *every)) < 2:
        return None
    holds_log = _holders(logging)
    chosen: dict[int, _Body] = {
        id(body.node): body for body in every if _is_seed(body, bodies, holds_log)
    }
    if not chosen and not _is_seed(module, bodies, holds_log):
        return None
    _with_callers(chosen, every)
    _with_what_they_use(chosen, every, bodies, module)
    if not any(_COMPLEMENT.search(body.text) for body in (module, *chosen.values())):
        return None
    return set(chosen)


def could_hold_a_rule(source: str) -> bool:
    """Whether a file's text could hold one at all; asked before it is parsed.

    Every rule takes the complement of a probability, and either logarithms or a power of a power.
    """
    if not _COMPLEMENT.search(source):
        return False
    if _takes_log(source):
        return True
    return _powers(source) > 1 or bool(_aliases(source))


def _powers(text: str) -> int:
    signs = len(_POWER_SIGN.findall(text)) if "**" in text else 0
    found = signs + sum(text.count(word) for word in _POWER_WORDS)
    # What makes two powers of one may be written out: pow(1 - w*w, n).
    return found + bool(_SQUARE.search(text)) if found == 1 else found


def _takes_log(text: str) -> bool:
    return ("log" in text or "ln" in text or "Log" in text) and bool(_LOG_CALL.search(text))


def _about_logs(text: str) -> str:
    """Give the lines of a text that say anything of logarithms."""
    if "log" not in text and "Log" not in text and "ln" not in text:
        return ""
    lines = (line for line in text.split("\n") if "log" in line or "Log" in line or "ln" in line)
    return "\n".join(lines)


def _aliases(source: str) -> set[str]:
    """Find the other names that a file gives to logarithms."""
    return {name for pair in _LOG_ALIAS.findall(_about_logs(source)) for name in pair if name}


def _holders(logging: list[_Body]) -> re.Pattern[str] | None:
    """Match the names that hold a logarithm for others: functions, attributes, module names."""
    names: set[str] = set()
    for body in logging:
        if body.node is not None:
            names.add(body.node.name)
            held = _LOG_HOLDER.findall(_about_logs(body.text))
            names |= {name for name in held if name in body.writes}
        else:
            names |= set(_LOG_HOLDER.findall(_about_logs(body.text)))
    return re.compile(rf"\b(?:{'|'.join(map(re.escape, sorted(names)))})\b") if names else None


def _definitions(body: list[ast.stmt]) -> list[Definition]:
    """Collect functions and methods; what is defined inside one belongs to it."""
    found: list[Definition] = []
    for node in body:
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                found.append(node)
            case ast.ClassDef():
                found += _definitions(node.body)
            case ast.If() | ast.Try() | ast.TryStar() | ast.With() | ast.For() | ast.While():
                for name in ("body", "orelse", "finalbody"):
                    found += _definitions(getattr(node, name, []))
                for handler in getattr(node, "handlers", []):
                    found += _definitions(handler.body)
            case _:
                pass
    return found


def _is_seed(
    body: _Body, bodies: dict[str, list[_Body]], holds_log: re.Pattern[str] | None
) -> bool:
    """Whether a body divides or compares logarithms, or compares powers of powers."""
    if body.logs or (holds_log is not None and holds_log.search(body.text)):
        return body.divides or body.compares
    if not body.powers or not body.compares:
        return False
    if body.powers > 1:
        return True
    return any(one.powers for name in body.calls & bodies.keys() for one in bodies[name])


def _with_callers(chosen: dict[int, _Body], every: list[_Body]) -> None:
    """Add what calls a chosen function: it says what the parameters are, and in which loop."""
    for _ in range(_CALLERS):
        names = {body.node.name for body in chosen.values() if body.node is not None}
        new = [body for body in every if id(body.node) not in chosen and body.calls & names]
        if not new:
            return
        chosen.update((id(body.node), body) for body in new)


def _with_what_they_use(
    chosen: dict[int, _Body], every: list[_Body], bodies: dict[str, list[_Body]], module: _Body
) -> None:
    """Add what chosen functions call, and what sets the attributes they read."""
    queue = [*chosen.values(), module]
    while queue:
        body = queue.pop()
        # A ratio may be made of counts in a function that does no other mathematics.
        used = (body.calls | body.reads) & bodies.keys()  # a property is read like an attribute
        new = [one for name in used for one in bodies[name]]
        if body.reads:
            new += [one for one in every if not body.reads.isdisjoint(one.writes)]
        for one in new:
            if id(one.node) not in chosen:
                chosen[id(one.node)] = one
                queue.append(one)
