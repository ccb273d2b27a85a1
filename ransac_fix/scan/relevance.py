"""Which functions of a file could show a rule: those that have to do with logarithms and powers.

Most functions of a file that holds a rule do not. What to follow definitions through them costs is
saved where neither they nor anything that they name takes a logarithm, raises to a power or
multiplies in a loop: what such functions give to others is worked out when they are called.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ransac_fix.scan import functions
from ransac_fix.scan.form import (
    Assign,
    Call,
    Class,
    Evaluate,
    Expr,
    Function,
    If,
    Import,
    Item,
    Lambda,
    Leave,
    Loop,
    Name,
    Op,
    Ref,
    Stmt,
)
from ransac_fix.scan.shapes import says_log
from ransac_fix.scan.walk import children, statements
from ransac_fix.scan.walk import functions as functions_of

_KINDS = {**functions.UNARY, **functions.BINARY}
_PLAIN = frozenset(
    (
        *("same", "neg", "sqrt", "square", "reciprocal", "add", "sub", "rsub", "mul", "div"),
        *("floordiv", "mod", "and", "or", "not"),
    )
)
_OTHERS = frozenset(
    (*functions.PRODUCTS, *functions.DISTRIBUTED, "logn", "LogX", "map", "reduce", "hypergeom")
)


@dataclass(slots=True)
class _Part:
    """A function with all in it, or a statement outside of functions."""

    function: Function | None
    gives: set[str]
    names: set[str]
    computes: bool = False


@dataclass(frozen=True, slots=True)
class Relevance:
    """The functions of a module that matter.

    Attributes
    ----------
    showing : tuple of Function
        Those that could show a rule, in order, with the functions inside them.
    needed : tuple of Function
        Those, and the others that they call or that set what they name.
    """

    showing: tuple[Function, ...]
    needed: tuple[Function, ...]


def relevance(body: tuple[Stmt, ...]) -> Relevance:
    """Say which functions of a module matter."""
    parts = list(_parts(body))
    given: set[str] = set()
    showing: list[_Part] = []
    left = parts
    while new := [one for one in left if one.computes or not one.names.isdisjoint(given)]:
        given.update(*(one.gives for one in new))
        showing += new
        left = _without(left, new)
    # What stands outside of functions is walked in any case.
    needed = [*showing, *(one for one in left if one.function is None)]
    named: set[str] = set().union(*(one.names for one in needed))
    left = _without(left, needed)
    while new := [one for one in left if not one.gives.isdisjoint(named)]:
        named.update(*(one.names for one in new))
        needed += new
        left = _without(left, new)
    return Relevance(_functions(parts, showing), _functions(parts, needed))


def _without(parts: list[_Part], some: list[_Part]) -> list[_Part]:
    gone = set(map(id, some))
    return [one for one in parts if id(one) not in gone]


def _functions(parts: list[_Part], some: list[_Part]) -> tuple[Function, ...]:
    """Give the functions of some of the parts in the order of all, with those inside them."""
    chosen = set(map(id, some))
    found = [one.function for one in parts if id(one) in chosen and one.function is not None]
    return tuple(inner for one in found for inner in (one, *functions_of(one.body)))


def _parts(body: tuple[Stmt, ...]) -> Iterator[_Part]:
    for stmt in body:
        match stmt:
            case Function():
                part = _Part(stmt, {stmt.name}, set())
                _function(stmt, part)
                yield part
            case Class():
                yield from _parts(stmt.body)
            case Loop():
                yield _outside(None, stmt.source, stmt.test)
                yield from _parts(stmt.body)
            case If():
                yield _outside(None, stmt.test)
                yield from _parts(stmt.body)
                yield from _parts(stmt.orelse)
            case Assign(target=target, value=value):
                yield _outside(target, value)
            case Evaluate(value=value):
                yield _outside(None, value)
            case Import(name=name, target=target):
                yield _Part(None, {name}, set(), _computes(target.rpartition(".")[2]))
            case _:
                pass


def _outside(target: str | None, *exprs: Expr | None) -> _Part:
    part = _Part(None, set() if target is None else {target.rpartition(".")[2]}, set())
    for expr in exprs:
        if expr is not None:
            _expression(expr, part)
    return part


def _function(function: Function, part: _Part) -> None:
    for parameter in function.parameters:
        part.computes |= says_log(parameter.name)
        if parameter.default is not None:
            _expression(parameter.default, part)
    _block(function.body, part)


def _block(body: tuple[Stmt, ...], part: _Part) -> None:
    for stmt in body:
        match stmt:
            case Assign(target=target, value=value):
                if target is not None and "." in target:
                    part.gives.add(target.rpartition(".")[2])
                _expression(value, part)
            case Evaluate(value=value):
                _expression(value, part)
            case Leave(value=value) if value is not None:
                _expression(value, part)
            case If():
                _expression(stmt.test, part)
                _block(stmt.body, part)
                _block(stmt.orelse, part)
            case Loop():
                for expr in (stmt.source, stmt.test):
                    if expr is not None:
                        _expression(expr, part)
                part.computes |= _multiplies(stmt.body)
                _block(stmt.body, part)
            case Import(target=target):
                part.computes |= _computes(target.rpartition(".")[2])
            case Function():
                _function(stmt, part)
            case Class():
                _block(stmt.body, part)
            case _:
                pass


def _expression(expr: Expr, part: _Part) -> None:
    match expr:
        case Name(name=name):
            _named(name, part)
        case Call(name=name):
            part.names.add(name)
            part.computes |= _computes(name)
        case Op(op="pow"):
            part.computes = True
        case Lambda(function=function):
            _function(function, part)
            return
        case Ref(name=name):
            _named(name, part)
        case _:
            pass
    for child in children(expr):
        _expression(child, part)


def _named(name: str, part: _Part) -> None:
    path = name.split(".")
    part.names.update(path)
    part.computes |= _computes(path[-1])  # another name for a function, too


def _computes(name: str) -> bool:
    kind = _KINDS.get(name.removesuffix("_")) or _KINDS.get(name)
    return (
        (kind is not None and kind not in _PLAIN)
        or name in _OTHERS
        or says_log(name)
        or functions.is_power(name)
        or functions.own_logarithm(name) is not None
    )


def _multiplies(body: tuple[Stmt, ...]) -> bool:
    """Whether a loop may multiply a name in every run: p *= q, or q = p * r and p = q."""
    factors: dict[str, set[str]] = {}
    sources: dict[str, set[str]] = {}
    for target, value in _assignments(body):
        factors.setdefault(target, set()).update(_factors(value, within=False))
        sources.setdefault(target, set()).update(_factors(value, within=True))
    return any(
        name in factors[name]
        or any(name in factors[other] for other in sources[name] if other in factors)
        for name in factors
    )


def _assignments(body: tuple[Stmt, ...]) -> Iterator[tuple[str, Expr]]:
    for stmt in statements(body):
        match stmt:
            case Assign(target=str() as target, value=value):
                yield target, value


def _factors(expr: Expr, *, within: bool) -> Iterable[str]:
    """Yield the names that are multiplied or divided in an expression; all within a product."""
    if isinstance(expr, Name | Ref) and within:
        yield expr.name
    if isinstance(expr, Item):
        yield from _factors(expr.base, within=within)
        return
    inside = within or (isinstance(expr, Op) and expr.op in ("mul", "div"))
    inside |= isinstance(expr, Call) and _KINDS.get(expr.name) in ("mul", "div")
    for child in children(expr):
        yield from _factors(child, within=inside)
