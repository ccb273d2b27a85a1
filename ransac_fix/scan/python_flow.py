"""The statements of a Python module: where values still hold, and where nodes stand."""

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ransac_fix.scan.form import Span
from ransac_fix.scan.reading import Text

# Methods that change how many entries their object has.
_CHANGES = frozenset(
    ("append", "extend", "insert", "pop", "remove", "clear", "add", "discard", "update", "resize")
)


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """A statement, and the block it stands in."""

    node: ast.stmt
    block: int
    index: int
    parent: "_Step | None"


class Flow:
    """The statements of a module, to see whether a value still holds somewhere else."""

    def __init__(self, module: ast.Module, text: Text) -> None:
        self.module = module
        self._text = text
        self._steps: list[_Step] = []
        self._read(module.body, None)

    def _read(self, body: Sequence[ast.stmt], parent: _Step | None) -> None:
        for index, node in enumerate(body):
            step = _Step(node, id(body), index, parent)
            self._steps.append(step)
            for name in ("body", "orelse", "finalbody"):
                self._read(getattr(node, name, []), step)
            for handler in getattr(node, "handlers", []):
                self._read(handler.body, step)
            for case in getattr(node, "cases", []):
                self._read(case.body, step)

    def functions(self) -> Iterator[tuple[str, ast.stmt]]:
        """Yield the functions of the module itself."""
        for node in self.module.body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield node.name, node

    def function_at(self, span: Span) -> ast.stmt | None:
        """Give the function that a place stands in."""
        step = self._at(span)
        return None if step is None else _function(step)

    def may_go(self, node: ast.stmt) -> bool:
        """Whether a block is left with something in it without a statement."""
        own = next(step for step in self._steps if step.node is node)
        return any(step.block == own.block and step is not own for step in self._steps)

    def is_known_at(self, names_in: str, span: Span) -> bool:
        """Whether the names in a text have a value at a place, by what stands before it."""
        step = self._at(span)
        if step is None:
            return False
        function = _function(step)
        known = {name for name, _ in self.functions()} | {"len"}
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = function.args
            every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
            known |= {argument.arg for argument in every}
        start = function.lineno if function is not None else 0
        for node in ast.walk(self.module):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                inside = start <= node.lineno < span.line
                if inside and self._dominates_line(node.lineno, step):
                    known.add(node.id)
        bare = re.sub(r"\.\s*\w+", "", names_in)  # attributes belong to what they are of
        return set(re.findall(r"[A-Za-z_]\w*", bare)) <= known

    def _dominates_line(self, line: int, last: "_Step") -> bool:
        return any(
            step.node.lineno <= line <= (step.node.end_lineno or line) and _dominates(step, last)
            for step in self._steps
            if not isinstance(step.node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        )

    def holds_until(self, names_in: str, start: Span, end: Span, *, anywhere: bool = False) -> bool:
        """Whether the names in a text mean the same at ``end`` as at ``start``.

        With ``anywhere`` the end may also be in a branch or loop that is not always reached.
        """
        if (start.line, start.column) >= (end.line, end.column) and (
            start.end_line,
            start.end_column,
        ) <= (end.end_line, end.end_column):
            return True  # the one stands inside the other
        first, last = self._at(start), self._at(end)
        if first is None or last is None or _function(first) is not _function(last):
            return False
        if not anywhere and not _dominates(first, last):
            return False
        names = set(re.findall(r"[A-Za-z_]\w*", names_in))
        loops = [
            step.node
            for step in _ancestors(last)
            if isinstance(step.node, ast.For | ast.While) and step not in _ancestors(first)
        ]
        for node, line, column in self._writes(names):
            between = (start.line, start.column) < (line, column) < (end.line, end.column)
            looped = any(loop.lineno <= line <= (loop.end_lineno or line) for loop in loops)
            own = first.node.lineno <= line <= (first.node.end_lineno or line)
            if (between or looped) and not own and node is not first.node:
                return False
        return True

    def _writes(self, names: set[str]) -> Iterator[tuple[ast.AST, int, int]]:
        for node in ast.walk(self.module):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr in _CHANGES
                and _last_name(node.func.value) in names
            ):
                yield node, node.lineno, node.col_offset
            written = (isinstance(node, ast.Name) and node.id in names) or (
                isinstance(node, ast.Attribute) and node.attr in names
            )
            if written and isinstance(node.ctx, ast.Store | ast.Del):  # type: ignore[attr-defined]
                yield node, node.lineno, node.col_offset  # type: ignore[attr-defined]

    def _at(self, span: Span) -> _Step | None:
        """Find the innermost statement that holds a span."""
        best: _Step | None = None
        for step in self._steps:
            line, column, end_line, end_column = span_of(step.node, self._text)
            starts = (line, column) <= (span.line, span.column)
            if starts and (span.end_line, span.end_column) <= (end_line, end_column):
                best = step  # inner statements come after the one they stand in
        return best


def _ancestors(step: _Step) -> list[_Step]:
    found: list[_Step] = []
    current: _Step | None = step
    while current is not None:
        found.append(current)
        current = current.parent
    return found


def _last_name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def _function(step: _Step) -> ast.stmt | None:
    for above in _ancestors(step):
        if isinstance(above.node, ast.FunctionDef | ast.AsyncFunctionDef):
            return above.node
    return None


def _dominates(first: _Step, last: _Step) -> bool:
    """Whether ``first`` has always run, in the same run of its block, when ``last`` does."""
    return any(
        above.block == first.block and above.index >= first.index for above in _ancestors(last)
    )


def span_of(node: ast.expr | ast.stmt | ast.arg, text: Text) -> Span:
    """Give the place of a node."""
    end = node.end_lineno or node.lineno
    return Span(
        node.lineno,
        character(text, node.lineno, node.col_offset),
        end,
        character(text, end, node.end_col_offset or 0),
    )


def character(text: Text, line: int, column: int) -> int:
    """Turn a column in bytes, as ``ast`` counts, into one in characters."""
    own = text.lines[line - 1]
    return column if own.isascii() else len(own.encode()[:column].decode("utf-8", "replace"))
