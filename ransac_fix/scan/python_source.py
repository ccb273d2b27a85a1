"""Python source as fixes see it: what is written into it, and what changes with it."""

import ast
import re
from collections.abc import Iterator, Sequence

from ransac_fix.scan.findings import Edit, FixStyle
from ransac_fix.scan.form import Expr, Name, Op, Span
from ransac_fix.scan.python import tree
from ransac_fix.scan.python_arrays import Arrays
from ransac_fix.scan.python_flow import Flow, character, span_of
from ransac_fix.scan.python_sampler import distinct, distinct_list, population_of
from ransac_fix.scan.reading import Text
from ransac_fix.scan.sampler import Draw
from ransac_fix.scan.source import (
    Argument,
    CallSite,
    Signature,
    Source,
    Standing,
)

HELPER = "_all_inlier_probability"
_HELPER_SOURCE = f'''\
def {HELPER}(n_inliers, n_samples, sample_size):
    """Return the probability that all of sample_size distinct samples are inliers.

    With fewer inliers than a sample takes there is none; the factors stop at one then, so that
    the number of trials made of this stays finite; and 1 - p is less than 1 in a float.
    """
    p = 1.0 if n_inliers > 0 else 0.0
    for i in range(int(sample_size)):
        p *= max(n_inliers - i, 1) / max(n_samples - i, 1)
    return max(p, 2.0**-53) if n_inliers > 0 else p
'''
_IMPORT = "from ransac_fix import all_inlier_probability\n"
_WORD = re.compile(r"[A-Za-z_]\w*")
_COMPILED = re.compile(r"jit|njit|vectorize|cuda|kernel|torch\.compile|tf\.function|numba")
# Calls that only look: made twice they cost little and change nothing.
_LOOKS = frozenset(
    ("len", "int", "float", "abs", "round", "sum", "count_nonzero", "size", "numel", "item")
)

_Definition = ast.FunctionDef | ast.AsyncFunctionDef


class PythonSource(Source):
    """A Python module, or the cells of a notebook."""

    comment_marks = ("#",)

    def __init__(
        self, text: Text, *, style: FixStyle = "self-contained", cells: Sequence[int] | None = None
    ) -> None:
        super().__init__(text)
        self._module = tree(text.source)
        self._flow = Flow(self._module, text)
        self._style = style
        self._cells = cells

    # ---- values ---------------------------------------------------------------------------

    def standing(
        self, exprs: Sequence[Expr], start: Span, end: Span, *, anywhere: bool = False
    ) -> Standing:
        """Say whether expressions mean the same at ``end`` as they did at ``start``."""
        names = " ".join(self.spell(expr) or "" for expr in exprs)
        holds = self._flow.holds_until(names, start, end, anywhere=anywhere)
        return "same" if holds else "changed"

    def is_repeatable(self, expr: Expr) -> bool:
        """Whether every call in an expression only looks at something."""
        if expr.span is None:
            return isinstance(expr, Name) or (
                isinstance(expr, Op) and all(map(self.is_repeatable, expr.args))
            )
        text = self.text.at(expr.span)
        try:
            return _only_looks(ast.parse(text, mode="eval"))
        except SyntaxError:
            return False

    def is_array(self, expr: Expr, place: Span) -> bool:
        """Whether an expression is an array, or a list, by what the file says of it."""
        text = self.spell(expr)
        if not text:
            return False
        function = self._flow.function_at(place)
        inside = [function] if isinstance(function, _Definition) else []
        try:
            node = ast.parse(text, mode="eval").body
        except SyntaxError:
            return False
        return Arrays([*inside, self._module]).has(node)

    def quotient(self, n_inliers: str, n_samples: str) -> str:
        """Spell a true division."""
        return f"{n_inliers} / {n_samples}"

    # ---- what is written ------------------------------------------------------------------

    def probability(self, n_inliers: str, n_samples: str, sample_size: str, power: Span) -> str:
        """Spell the call that takes the place of a power."""
        del power
        if self._style == "import":
            whole = ", ".join(_integer(one) for one in (n_inliers, n_samples, sample_size))
            return f"max(all_inlier_probability({whole}), 2.0**-53)"
        return f"{HELPER}({n_inliers}, {n_samples}, {sample_size})"

    def support(self, power: Span, path: str) -> tuple[Edit, ...] | str:
        """Give the edit that adds the function, or its import, where the file has none yet."""
        for node in ast.walk(self._module):
            if isinstance(node, _Definition) and _spans(node, power):
                compiled = [
                    one for one in node.decorator_list if _COMPILED.search(ast.unparse(one))
                ]
                if compiled:
                    name = ast.unparse(compiled[0])
                    return f"{node.name} is compiled by @{name}, which must compile what it calls"
        name = "all_inlier_probability" if self._style == "import" else HELPER
        cell = self._cells[power.line - 1] if self._cells else None
        for known, statement in self._known():
            if known == name and (cell is None or self._cell(statement) == cell):
                return ()
        return (self._insertion(path, cell),)

    def _known(self) -> Iterator[tuple[str, ast.stmt]]:
        for node in self._module.body:
            if isinstance(node, _Definition):
                yield node.name, node
            elif isinstance(node, ast.ImportFrom) and node.module == "ransac_fix":
                yield from ((alias.asname or alias.name, node) for alias in node.names)

    def _cell(self, node: ast.stmt) -> int:
        return self._cells[node.lineno - 1] if self._cells else 0

    def _insertion(self, path: str, cell: int | None) -> Edit:
        """Put it after the imports that open the module, or the cell, once for all that use it."""
        body = self._module.body
        if cell is not None:
            # Cells run in any order: each has what it needs.
            body = [node for node in body if self._cell(node) == cell]
        # A magic was read as `pass`, and stays first in its cell.
        opening = (one for one in body if _opens(one) or (cell and isinstance(one, ast.Pass)))
        opens = set(map(id, opening))
        node = next((one for one in body if id(one) not in opens), body[-1])
        lines = self.text.lines
        decorators = [one.lineno for one in getattr(node, "decorator_list", [])]
        line = first = min([node.lineno, *decorators])
        top = 1 + (self._cells.index(cell) if self._cells and cell is not None else 0)
        while line > top and lines[line - 2].startswith("#"):
            line -= 1  # comments above belong to what they stand above
        if line == top:
            line = first  # ... but a coding line or a licence opens the file
        if self._style == "import":
            above = _import_above(lines, line, top)
            line = above + 1 if above else line
            return self.edit(Span(line, 0, line, 0), _IMPORT + ("" if above else "\n\n"), path)
        blank = "" if line == top or not lines[line - 2].strip() else "\n\n"
        return self.edit(Span(line, 0, line, 0), f"{blank}{_HELPER_SOURCE}\n\n", path)

    def sole_definition(self, name: str, place: Span) -> tuple[Span, tuple[Span, ...]] | None:
        """Find the one assignment to a variable of the function around ``place``."""
        function = self._flow.function_at(place)
        if function is None:
            return None  # a name of the module may be used anywhere
        written = [
            node
            for node in ast.walk(function)
            if isinstance(node, ast.Assign | ast.AnnAssign)
            and any(isinstance(one, ast.Name) and one.id == name for one in _targets(node))
        ]
        if len(written) != 1 or len(_targets(written[0])) != 1:
            return None
        (statement,) = written
        if not self._flow.may_go(statement) or not _only_looks(statement.value):
            return None
        uses = tuple(
            self._span(node)
            for node in ast.walk(function)
            if isinstance(node, ast.Name) and node.id == name
        )
        return self._span(statement), uses

    # ---- signatures -----------------------------------------------------------------------

    def signature(self, function: Span, parameter: str) -> Signature | str:
        """Find what changes with a parameter of a function."""
        definition = self._definition(function)
        if definition is None:
            return "its function is not a plain one"
        arguments = definition.args
        positional = (*arguments.posonlyargs, *arguments.args)
        every = (*positional, *arguments.kwonlyargs)
        own = next((one for one in every if one.arg == parameter), None)
        if own is None:
            return f"{parameter} is not a plain parameter of {definition.name}"
        if _default_of(arguments, own) is not None:
            return f"{parameter} has a default in {definition.name}"
        method = self._is_method(definition)
        same_name = [
            node
            for node in ast.walk(self._module)
            if isinstance(node, _Definition) and node.name == definition.name
        ]
        if len(same_name) > 1:
            return f"there are {len(same_name)} functions named {definition.name}"
        place = positional.index(own) if own in positional else None
        if place is not None and method:
            place -= 1
        calls: list[CallSite] = []
        functions: set[int] = set()
        for node in ast.walk(self._module):
            if isinstance(node, ast.Call) and _names(node.func, definition.name):
                functions.add(id(node.func))
                starred = any(isinstance(one, ast.Starred) for one in node.args)
                if starred or any(word.arg is None for word in node.keywords):
                    return f"the call in line {node.lineno} unpacks its arguments"
                calls.append(CallSite(self._span(node), self._argument(node, place, parameter)))
        for node in ast.walk(self._module):
            if _names(node, definition.name) and id(node) not in functions:
                return f"{definition.name} is used in line {node.lineno} without a call"  # type: ignore[attr-defined]
            if isinstance(node, ast.Constant) and node.value == definition.name:
                return f"{definition.name} is named in line {node.lineno}"
        nested = definition not in self._module.body and not method
        first = next((one for one in definition.body if not _is_docstring(one)), None)
        if first is None or first.lineno == definition.lineno:
            return f"{definition.name} is written on one line"
        lead = self.text.lines[first.lineno - 1][: first.col_offset]
        if lead.strip():
            return f"{definition.name} is written on one line"
        names = {node.id for node in ast.walk(definition) if isinstance(node, ast.Name)}
        names |= {one.arg for one in every}
        return Signature(
            parameters=(self._span(own),),
            calls=tuple(calls),
            private=nested or definition.name.startswith("_"),
            declared="{}" if own.annotation is None else "{}: int",
            body=Span(first.lineno, 0, first.lineno, 0),
            statement=f"{lead}{{name}} = {{value}}\n",
            names=frozenset(names),
            uses=tuple(
                self._span(node)
                for node in ast.walk(definition)
                if isinstance(node, ast.Name) and node.id == parameter
            ),
        )

    def _definition(self, span: Span) -> ast.FunctionDef | ast.AsyncFunctionDef | None:
        for node in ast.walk(self._module):
            if isinstance(node, _Definition) and self._span(node) == span:
                return node
        return None

    def _is_method(self, definition: ast.stmt) -> bool:
        for node in ast.walk(self._module):
            if isinstance(node, ast.ClassDef) and definition in node.body:
                decorators = getattr(definition, "decorator_list", [])
                return not any(ast.unparse(one) == "staticmethod" for one in decorators)
        return False

    def _argument(self, call: ast.Call, place: int | None, parameter: str) -> Argument | None:
        for word in call.keywords:
            if word.arg == parameter:
                value = self._span(word.value)
                column = character(self.text, word.lineno, word.col_offset)
                span = Span(word.lineno, column, value.end_line, value.end_column)
                return Argument(span, value, parameter)
        if place is not None and place < len(call.args):
            value = self._span(call.args[place])
            return Argument(value, value)
        return None

    def _span(self, node: ast.expr | ast.stmt | ast.arg) -> Span:
        return span_of(node, self.text)

    # ---- samplers -------------------------------------------------------------------------

    def population(self, draw: Draw, place: Span) -> tuple[str, bool] | None:
        """Spell the number of data that a sampler draws from; say whether ``place`` knows it."""
        call = self._call_at(draw.span)
        spelled = None if call is None else population_of(call)
        if spelled is None:
            return None
        known = self._flow.is_known_at(spelled, place)
        return spelled, known and self._flow.holds_until(spelled, place, draw.span, anywhere=True)

    def distinct_draw(self, draw: Draw, path: str) -> tuple[Edit, ...] | str:
        """Give the edit that makes a call draw distinct samples."""
        call = self._call_at(draw.span)
        if call is not None:
            spelled = distinct(call)
            if spelled is not None:
                return (self.edit(draw.span, spelled, path),)
            for node in ast.walk(self._module):
                if isinstance(node, ast.ListComp):
                    spelled = distinct_list(node, call)
                    if spelled is not None:
                        return (self.edit(self._span(node), spelled, path),)
        return super().distinct_draw(draw, path)

    def _call_at(self, span: Span) -> ast.Call | None:
        for node in ast.walk(self._module):
            if isinstance(node, ast.Call) and self._span(node) == span:
                return node
        return None


def _integer(text: str) -> str:
    return text if re.fullmatch(r"\d+|len\([\w.\[\]]*\)", text) else f"int({text})"


def _import_above(lines: Sequence[str], line: int, top: int) -> int:
    """Give the last line above that imports, past blank lines only; 0 if there is none."""
    above = line - 1
    while above >= top and not lines[above - 1].strip():
        above -= 1
    return above if above >= top and re.match(r"(?:from|import)\s", lines[above - 1]) else 0


def _targets(node: ast.Assign | ast.AnnAssign) -> list[ast.expr]:
    return node.targets if isinstance(node, ast.Assign) else [node.target]


def _only_looks(parsed: ast.AST | None) -> bool:
    """Whether every call in an expression only looks at something."""
    for node in ast.walk(parsed) if parsed is not None else ():
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            name = node.func.id if isinstance(node.func, ast.Name) else name
            if name not in _LOOKS:
                return False
        elif isinstance(node, ast.Await | ast.Yield | ast.YieldFrom | ast.NamedExpr):
            return False
    return True


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _default_of(arguments: ast.arguments, own: ast.arg) -> ast.expr | None:
    positional = [*arguments.posonlyargs, *arguments.args]
    if own in positional:
        place = positional.index(own) - len(positional)
        return arguments.defaults[place] if -place <= len(arguments.defaults) else None
    return arguments.kw_defaults[arguments.kwonlyargs.index(own)]


def _names(node: ast.AST, name: str) -> bool:
    return (isinstance(node, ast.Name) and node.id == name) or (
        isinstance(node, ast.Attribute) and node.attr == name
    )


def _spans(node: ast.stmt, span: Span) -> bool:
    return node.lineno <= span.line and span.end_line <= (node.end_lineno or node.lineno)


def _opens(node: ast.stmt) -> bool:
    """Whether a statement belongs to the opening of a module: docstring, imports, their guards."""
    match node:
        case ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant(value=str())):
            return True
        case ast.Try(body=body) | ast.If(body=body):
            return all(isinstance(one, ast.Import | ast.ImportFrom) for one in body)
    return False
