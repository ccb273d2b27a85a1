"""The Python front end: the standard library's ``ast`` into the small form.

Nothing is imported or run. A definition inside an expression (lambda, comprehension) becomes an
expression of the form; decorators, annotations and docstrings are not code here.
"""

import ast
import warnings
from collections.abc import Collection, Iterable, Sequence

from ransac_fix.scan import form
from ransac_fix.scan.form import Expr, Span, Stmt

_BINARY: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "div",
    ast.FloorDiv: "floordiv",
    ast.Mod: "mod",
    ast.Pow: "pow",
}
_COMPARE: dict[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.In: "in",
    ast.NotIn: "in",
}


def parse(source: str) -> form.Module:
    """Read one Python module whole.

    Raises
    ------
    SyntaxError
        The source is not Python 3.
    ValueError
        The source holds a null character.
    RecursionError
        An expression is nested too deeply to parse.
    """
    return read(tree(source), source)


def tree(source: str) -> ast.Module:
    """Parse one Python module, quietly."""
    with warnings.catch_warnings():
        # "\d" in somebody else's string is not our user's concern.
        warnings.simplefilter("ignore")
        return ast.parse(source)


def read(parsed: ast.Module, source: str, bodies: Collection[int] | None = None) -> form.Module:
    """Turn a parsed module into the small form.

    Parameters
    ----------
    parsed : ast.Module
    source : str
        The text it was parsed from.
    bodies : collection of int, optional
        ``id`` of the function definitions to read; other functions get empty bodies. All by
        default.
    """
    return form.Module(_Reader(source, bodies).statements(parsed.body))


class _Reader:
    def __init__(self, source: str, bodies: Collection[int] | None) -> None:
        self._bodies = bodies
        # ast counts columns in UTF-8 bytes. Only lines that are not ASCII need translating.
        self._lines: list[bytes] | None = None
        if not source.isascii():
            self._lines = [line.encode() for line in split_lines(source)]

    def _column(self, line: int, column: int) -> int:
        if self._lines is None or line > len(self._lines):
            return column
        return len(self._lines[line - 1][:column].decode("utf-8", "replace"))

    def _span(self, node: ast.expr | ast.stmt) -> Span:
        line, column = node.lineno, node.col_offset
        end_line, end_column = node.end_lineno or line, node.end_col_offset or column
        if self._lines is not None:
            column, end_column = self._column(line, column), self._column(end_line, end_column)
        return Span(line, column, end_line, end_column)

    # ---- statements -----------------------------------------------------------------------

    def statements(self, body: Iterable[ast.stmt], owner: str | None = None) -> tuple[Stmt, ...]:
        out: list[Stmt] = []
        for node in body:
            self._statement(node, owner, out)
        return tuple(out)

    def _statement(self, node: ast.stmt, owner: str | None, out: list[Stmt]) -> None:
        match node:
            case ast.Assign():
                for target in node.targets:
                    self._assign(target, node.value, out)
            case ast.AnnAssign(value=ast.expr() as value):
                self._assign(node.target, value, out)
            case ast.AugAssign():
                self._augmented(node, out)
            case ast.Expr(value=ast.Constant(value=str())):
                pass  # a docstring is not code
            case ast.Expr():
                out.append(form.Evaluate(self.expr(node.value)))
            case ast.Return():
                out.append(form.Leave("return", self.expr(node.value) if node.value else None))
            case ast.Raise():
                out.append(form.Leave("raise"))
            case ast.Break():
                out.append(form.Leave("break"))
            case ast.Continue():
                out.append(form.Leave("continue"))
            case ast.If():
                out.append(
                    form.If(
                        self.expr(node.test),
                        self.statements(node.body),
                        self.statements(node.orelse),
                    )
                )
            case ast.While():
                out.append(
                    form.Loop(
                        (),
                        None,
                        self.expr(node.test),
                        self.statements(node.body),
                        self._span(node),
                    )
                )
                out.extend(self.statements(node.orelse))
            case ast.For() | ast.AsyncFor():
                variables = _targets(node.target)
                out.append(
                    form.Loop(
                        variables,
                        self.expr(node.iter),
                        None,
                        self.statements(node.body),
                        self._span(node),
                    )
                )
                out.extend(self.statements(node.orelse))
            case ast.With() | ast.AsyncWith():
                out.extend(form.Evaluate(self.expr(item.context_expr)) for item in node.items)
                out.extend(self.statements(node.body))
            case ast.Try() | ast.TryStar():
                out.extend(self.statements(node.body))
                out.extend(
                    form.If(form.Unknown(), self.statements(handler.body), ())
                    for handler in node.handlers
                )
                out.extend(self.statements(node.orelse))
                out.extend(self.statements(node.finalbody))
            case ast.Match():
                subject = self.expr(node.subject)
                out.append(form.Evaluate(subject))
                out.extend(
                    form.If(form.Unknown(), self.statements(arm.body), ()) for arm in node.cases
                )
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                out.append(self._function(node, owner))
            case ast.ClassDef():
                out.append(
                    form.Class(
                        node.name, self.statements(node.body, owner=node.name), self._span(node)
                    )
                )
            case ast.Import():
                for alias in node.names:
                    bound = alias.asname or alias.name.partition(".")[0]
                    out.append(form.Import(bound, alias.name if alias.asname else bound))
            case ast.ImportFrom():
                for alias in node.names:
                    module = "." * node.level + (node.module or "")
                    out.append(form.Import(alias.asname or alias.name, f"{module}.{alias.name}"))
            case ast.Assert():
                out.append(form.Evaluate(self.expr(node.test)))
            case _:
                pass  # pass, del, global, nonlocal, type aliases: no values

    def _assign(self, target: ast.expr, value: ast.expr, out: list[Stmt]) -> None:
        match target:
            case ast.Tuple(elts=targets) | ast.List(elts=targets):
                starred = [isinstance(item, ast.Starred) for item in targets]
                plain = not any(starred)
                if isinstance(value, ast.Tuple | ast.List) and (
                    not plain or len(value.elts) == len(targets)
                ):
                    # `a, b = b, a` reads both before it writes either; a swap of names is of no
                    # use to the recogniser, so the simpler order is kept.
                    for one, part, star in zip(targets, value.elts, starred, strict=False):
                        if star:
                            break  # what is after it, few ever ask for
                        self._assign(one, part, out)
                    return
                whole = self.expr(value)
                for number, one in enumerate(targets):
                    part_expr: Expr = form.Unknown((whole,))
                    if plain:
                        part_expr = form.Item(whole, form.Num(number), self._span(one))
                    out.append(form.Assign(dotted(one), part_expr))
            case ast.Starred():
                self._assign(target.value, value, out)
            case ast.Subscript() if dotted(target) is None:
                # Writing one entry: the array is then what it was, or this.
                array = dotted(target.value)
                new = self.expr(value)
                if array is not None:
                    new = form.Choice((form.Name(array), new), self._span(target))
                out.append(form.Assign(array, new))
            case _:
                out.append(form.Assign(dotted(target), self.expr(value)))

    def _augmented(self, node: ast.AugAssign, out: list[Stmt]) -> None:
        operator = _BINARY.get(type(node.op))
        span = self._span(node)
        value = self.expr(node.value)
        target = self.expr(node.target)
        new: Expr = form.Unknown((target, value), span)
        if operator is not None:
            new = form.Op(operator, (target, value), span)
        out.append(form.Assign(dotted(node.target), new))

    def _function(
        self, node: ast.FunctionDef | ast.AsyncFunctionDef, owner: str | None
    ) -> form.Function:
        outer = self._bodies
        body: tuple[Stmt, ...] = ()
        if outer is None or id(node) in outer:
            self._bodies = None  # what is defined inside is part of it
            body = self.statements(node.body)
            self._bodies = outer
        return form.Function(node.name, self._parameters(node.args), body, self._span(node), owner)

    def _name_span(self, argument: ast.arg) -> Span:
        column = self._column(argument.lineno, argument.col_offset)
        return Span(argument.lineno, column, argument.lineno, column + len(argument.arg))

    def _parameters(self, arguments: ast.arguments) -> tuple[form.Parameter, ...]:
        positional = [*arguments.posonlyargs, *arguments.args]
        defaults: Sequence[ast.expr | None] = [
            *[None] * (len(positional) - len(arguments.defaults)),
            *arguments.defaults,
        ]
        pairs: list[tuple[ast.arg, ast.expr | None]] = list(zip(positional, defaults, strict=True))
        pairs += list(zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True))
        return tuple(
            form.Parameter(
                argument.arg, self.expr(default) if default else None, self._name_span(argument)
            )
            for argument, default in pairs
        )

    # ---- expressions ----------------------------------------------------------------------

    def expr(self, node: ast.expr) -> Expr:
        span = self._span(node)
        match node:
            case ast.Constant(value=bool() as truth):
                return form.Name(str(truth), span)
            case ast.Constant(value=None):
                return form.Unknown((), span)
            case ast.Constant(value=int() | float() as number):
                return form.Num(_finite(number), span)
            case ast.Name(id=name):
                return form.Name(name, span)
            case ast.Attribute():
                path = dotted(node)
                if path is not None:
                    return form.Name(path, span)
                return form.Item(self.expr(node.value), form.Name(node.attr, span), span)
            case ast.BinOp() if type(node.op) in _BINARY:
                return form.Op(
                    _BINARY[type(node.op)], (self.expr(node.left), self.expr(node.right)), span
                )
            case ast.BinOp():
                return form.Unknown((self.expr(node.left), self.expr(node.right)), span)
            case ast.UnaryOp(op=ast.USub()):
                return form.Op("neg", (self.expr(node.operand),), span)
            case ast.UnaryOp(op=ast.UAdd()):
                return self.expr(node.operand)
            case ast.UnaryOp(op=ast.Not()):
                return form.Op("not", (self.expr(node.operand),), span)
            case ast.BoolOp():
                operator = "and" if isinstance(node.op, ast.And) else "or"
                return form.Op(operator, tuple(map(self.expr, node.values)), span)
            case ast.Compare():
                return self._compare(node, span)
            case ast.IfExp():
                return form.Choice(
                    (self.expr(node.body), self.expr(node.orelse)), span, self.expr(node.test)
                )
            case ast.Call():
                return self._call(node, span)
            case ast.Subscript():
                path, key = dotted(node), _key(node)
                if path is not None:
                    return form.Name(path, span)
                index = self.expr(node.slice) if key is None else form.Name(key, span)
                return form.Item(self.expr(node.value), index, span)
            case ast.Dict(keys=keys) if keys and all(map(_is_key, keys)):
                names = tuple(str(ast.literal_eval(key)) for key in keys if key is not None)
                return form.Seq(tuple(map(self.expr, node.values)), span, names)
            case ast.Tuple() | ast.List() | ast.Set():
                return form.Seq(tuple(map(self.expr, node.elts)), span)
            case ast.Starred() | ast.Await():
                return self.expr(node.value)
            case ast.NamedExpr():
                return form.Ref(node.target.id, self.expr(node.value), span)
            case ast.ListComp() | ast.GeneratorExp() | ast.SetComp():
                return self._comprehension(node, span)
            case ast.Lambda():
                body = (form.Leave("return", self.expr(node.body)),)
                return form.Lambda(
                    form.Function("<lambda>", self._parameters(node.args), body, span), span
                )
            case _:
                parts = [
                    self.expr(child)
                    for child in ast.iter_child_nodes(node)
                    if isinstance(child, ast.expr)
                ]
                return form.Unknown(tuple(parts), span)

    def _compare(self, node: ast.Compare, span: Span) -> Expr:
        operands = [self.expr(node.left), *map(self.expr, node.comparators)]
        parts: list[Expr] = []
        for operator, left, right in zip(node.ops, operands, operands[1:], strict=False):
            sign = _COMPARE.get(type(operator))
            parts.append(
                form.Op(sign, (left, right), span) if sign else form.Unknown((left, right), span)
            )
        return parts[0] if len(parts) == 1 else form.Op("and", tuple(parts), span)

    def _call(self, node: ast.Call, span: Span) -> Expr:
        arguments = tuple(map(self.expr, node.args))
        keywords = tuple((word.arg or "**", self.expr(word.value)) for word in node.keywords)
        match node.func:
            case ast.Name(id=name):
                return form.Call(None, name, arguments, keywords, span)
            case ast.Attribute():
                return form.Call(
                    self.expr(node.func.value), node.func.attr, arguments, keywords, span
                )
            case _:
                return form.Call(self.expr(node.func), "", arguments, keywords, span)

    def _comprehension(
        self, node: ast.ListComp | ast.GeneratorExp | ast.SetComp, span: Span
    ) -> Expr:
        if len(node.generators) != 1:
            parts = [self.expr(generator.iter) for generator in node.generators]
            return form.Unknown((self.expr(node.elt), *parts), span)
        generator = node.generators[0]
        return form.Each(
            self.expr(node.elt),
            _targets(generator.target),
            self.expr(generator.iter),
            span,
            tuple(map(self.expr, generator.ifs)),
        )


def dotted(node: ast.expr) -> str | None:
    """Spell a chain of attributes and named entries as ``a.b.c``; None for anything else."""
    parts: list[str] = []
    current = node
    while isinstance(current, ast.Attribute | ast.Subscript):
        part = current.attr if isinstance(current, ast.Attribute) else _key(current)
        if part is None:
            return None
        parts.append(part)
        current = current.value
    if not isinstance(current, ast.Name):
        return None
    parts.append(current.id)
    return ".".join(reversed(parts))


def _key(node: ast.Subscript) -> str | None:
    """Give the key of ``options["key"]``."""
    return str(ast.literal_eval(node.slice)) if _is_key(node.slice) else None


def _is_key(node: ast.expr | None) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and bool(node.value)
        and "." not in node.value
    )


def _targets(target: ast.expr) -> tuple[str, ...]:
    parts = target.elts if isinstance(target, ast.Tuple | ast.List) else [target]
    return tuple(dotted(part) or "" for part in parts)


def split_lines(source: str) -> list[str]:
    """Split as Python counts lines: at LF, CRLF and CR, never at form feeds."""
    return source.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _finite(number: float) -> float:
    try:
        return float(number)
    except OverflowError:
        return float("inf")
