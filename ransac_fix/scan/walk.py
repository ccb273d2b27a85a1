"""Walk over the small form as it was written, before anything is resolved."""

from collections.abc import Iterator

from ransac_fix.scan.form import (
    Assign,
    Call,
    Choice,
    Class,
    Each,
    Evaluate,
    Expr,
    Function,
    If,
    Item,
    Lambda,
    Leave,
    Loop,
    Op,
    Ref,
    Seq,
    Stmt,
    Unknown,
)


def expressions(
    body: tuple[Stmt, ...], function: Function | None, loops: int
) -> Iterator[tuple[Expr, Function | None, int]]:
    """Yield every expression of a body, with its function and how many loops it stands in."""
    for stmt in body:
        match stmt:
            case Assign(value=value) | Evaluate(value=value):
                yield from _nested(value, function, loops)
            case Leave(value=value) if value is not None:
                yield from _nested(value, function, loops)
            case If():
                yield from _nested(stmt.test, function, loops)
                yield from expressions(stmt.body, function, loops)
                yield from expressions(stmt.orelse, function, loops)
            case Loop():
                if stmt.source is not None:
                    yield from _nested(stmt.source, function, loops)
                if stmt.test is not None:
                    yield from _nested(stmt.test, function, loops + 1)
                yield from expressions(stmt.body, function, loops + 1)
            case Function():
                yield from expressions(stmt.body, stmt, 0)
            case Class():
                yield from expressions(stmt.body, None, 0)
            case _:
                pass


def _nested(
    expr: Expr, function: Function | None, loops: int
) -> Iterator[tuple[Expr, Function | None, int]]:
    yield expr, function, loops
    deeper = loops + 1 if isinstance(expr, Each) else loops
    for child in children(expr):
        yield from _nested(child, function, deeper)


def statements(body: tuple[Stmt, ...], *, definitions: bool = False) -> Iterator[Stmt]:
    """Yield every statement of a body, those in branches and loops too.

    With ``definitions`` also those of the functions and classes in it.
    """
    for stmt in body:
        yield stmt
        match stmt:
            case If():
                yield from statements(stmt.body, definitions=definitions)
                yield from statements(stmt.orelse, definitions=definitions)
            case Loop():
                yield from statements(stmt.body, definitions=definitions)
            case Function() | Class() if definitions:
                yield from statements(stmt.body, definitions=True)
            case _:
                pass


def inside(expr: Expr) -> Iterator[Expr]:
    """Yield an expression and every expression in it."""
    yield expr
    for child in children(expr):
        yield from inside(child)


def children(expr: Expr) -> tuple[Expr, ...]:
    """Give the expressions directly inside one."""
    match expr:
        case Call():
            values = tuple(value for _, value in expr.keywords)
            return (*((expr.base,) if expr.base is not None else ()), *expr.args, *values)
        case Op(args=args):
            return args
        case Choice(options=options, test=test):
            return options if test is None else (test, *options)
        case Ref(value=value):
            return (value,)
        case Each(body=inner, source=source, tests=tests):
            return (inner, source, *tests)
        case Seq(items=items):
            return items
        case Item(base=base, index=index):
            return (base, index)
        case Unknown(parts=parts):
            return parts
        case Lambda(function=function):
            return tuple(
                stmt.value
                for stmt in function.body
                if isinstance(stmt, Leave) and stmt.value is not None
            )
    return ()


def functions(body: tuple[Stmt, ...]) -> Iterator[Function]:
    """Yield every function and method, those inside others too."""
    for stmt in statements(body, definitions=True):
        if isinstance(stmt, Function):
            yield stmt
