"""The small form that every language front end produces and the recogniser reads.

A front end turns source into *statements* over *expressions*. It resolves nothing: names stay
names and calls stay calls. ``evaluate`` then follows definitions and yields expressions in which
each name carries the value it had at that point (:class:`Ref`), and mathematical functions of
every library are written one way (:class:`Fn`, :class:`Op`).

Expressions are compared by identity; ``algebra.key`` compares them by structure.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias


class Span(NamedTuple):
    """Where an expression stands: lines from 1, columns in characters from 0, end exclusive."""

    line: int
    column: int
    end_line: int
    end_column: int


@dataclass(frozen=True, slots=True, eq=False)
class Num:
    """A number."""

    value: float
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Name:
    """A name or dotted path whose value is not known: ``n``, ``self.k``, ``points.shape``.

    An entry of a dictionary is spelled like an attribute: ``options["k"]`` is ``options.k``.
    """

    name: str
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Ref:
    """A name together with the value it has here."""

    name: str
    value: "Expr"
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Op:
    """An operator: add, sub, mul, div, floordiv, mod, pow, neg, not, and, or, in, <, <=, ..."""

    op: str
    args: "tuple[Expr, ...]"
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A call as written: ``base.name(args)``, with ``base`` None for a bare name."""

    base: "Expr | None"
    name: str
    args: "tuple[Expr, ...]"
    keywords: "tuple[tuple[str, Expr], ...]" = ()
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Fn:
    """A known function after evaluation: log, exp, same (casts, rounding), clamp, comb, ..."""

    name: str
    args: "tuple[Expr, ...]"
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """One of several values: a conditional expression, or definitions that meet at a join.

    ``test`` is what a conditional expression asks, as it was written.
    """

    options: "tuple[Expr, ...]"
    span: Span | None = None
    test: "Expr | None" = None


@dataclass(frozen=True, slots=True, eq=False)
class Over:
    """A product (``prod``) or sum of ``body`` over the runs of a loop.

    An :class:`Index` with the same ``loop`` inside ``body`` changes by one in each run. ``count``
    is the number of runs where it is known.
    """

    kind: str
    body: "Expr"
    loop: str
    count: "Expr | None"
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Index:
    """What changes by one in each run of a loop: its counter, or the entries of ``arange``."""

    name: str
    loop: str
    count: "Expr | None" = None
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Each:
    """A comprehension: ``body`` for each value of ``variables`` in ``source`` that passes."""

    body: "Expr"
    variables: tuple[str, ...]
    source: "Expr"
    span: Span | None = None
    tests: "tuple[Expr, ...]" = ()


@dataclass(frozen=True, slots=True, eq=False)
class Seq:
    """A tuple or list display, or a record: a dictionary or object whose items have ``names``."""

    items: "tuple[Expr, ...]"
    span: Span | None = None
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """A subscript or a member of the value of an expression."""

    base: "Expr"
    index: "Expr"
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Lambda:
    """An anonymous function."""

    function: "Function"
    span: Span | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Unknown:
    """Anything else, with the expressions inside it."""

    parts: "tuple[Expr, ...]" = ()
    span: Span | None = None


Expr: TypeAlias = (
    Num | Name | Ref | Op | Call | Fn | Choice | Over | Index | Each | Seq | Item | Lambda | Unknown
)


@dataclass(frozen=True, slots=True, eq=False)
class Assign:
    """``target = value``; a target is a dotted path, or None when it is anything else."""

    target: str | None
    value: Expr


@dataclass(frozen=True, slots=True, eq=False)
class Evaluate:
    """An expression evaluated for its effect."""

    value: Expr


@dataclass(frozen=True, slots=True, eq=False)
class If:
    """A branch."""

    test: Expr
    body: "tuple[Stmt, ...]"
    orelse: "tuple[Stmt, ...]"


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A loop: over ``source`` into ``variables`` (for each), or while ``test`` holds."""

    variables: tuple[str, ...]
    source: Expr | None
    test: Expr | None
    body: "tuple[Stmt, ...]"
    span: Span


@dataclass(frozen=True, slots=True, eq=False)
class Leave:
    """Control leaves: return (with a value), raise, break, continue."""

    kind: str
    value: Expr | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Import:
    """A name bound to a module or to a member of one."""

    name: str
    target: str


@dataclass(frozen=True, slots=True, eq=False)
class Parameter:
    """A parameter and its default; one by reference may change what it is called with."""

    name: str
    default: Expr | None = None
    span: Span | None = None
    by_reference: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Function:
    """A function or method."""

    name: str
    parameters: tuple[Parameter, ...]
    body: "tuple[Stmt, ...]"
    span: Span
    owner: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Class:
    """A class."""

    name: str
    body: "tuple[Stmt, ...]"
    span: Span


Stmt: TypeAlias = Assign | Evaluate | If | Loop | Leave | Import | Function | Class


@dataclass(frozen=True, slots=True, eq=False)
class Module:
    """One source file, or one notebook, in the small form."""

    body: tuple[Stmt, ...]
