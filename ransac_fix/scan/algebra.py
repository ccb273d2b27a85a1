"""The algebra of the rule: what a value may be, numbers, sums, complements, ratios of counts.

Everything here reads resolved expressions (``evaluate``) and looks through what does not change
the mathematics: names, casts, rounding, clamps to constants, small guards. A value that may be
one of several is read every way, up to a budget.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from ransac_fix.scan.form import (
    Choice,
    Expr,
    Fn,
    Index,
    Item,
    Name,
    Num,
    Op,
    Over,
    Ref,
    Seq,
)

WAYS = 8  # ways one expression is read
MAX_DEPTH = 40
_TINY = 1e-3
_EPS_NAME = re.compile(
    r"(?:^|[._])(?:c?eps(?:ilon)?\d*|tiny|min|spacing|small\w*|"
    r"(?:FLT|DBL|LDBL)_(?:EPSILON|MIN)|\w*_eps(?:ilon)?)$",
    re.IGNORECASE,
)


def plain(expr: Expr) -> Expr:
    """Look through names and casts, where there is one way to do so."""
    while True:
        match expr:
            case Ref(value=value):
                expr = value
            case Fn(name="same", args=(inner, *_)):
                expr = inner
            case _:
                return expr


def readings(expr: Expr, depth: int = 0) -> Iterator[Expr]:
    """Yield what a value may be, seen through names, casts, choices and clamps."""
    expr = plain(expr)
    if depth > MAX_DEPTH:
        yield expr
        return
    match expr:
        case Choice(options=options):
            for option in _meaningful(options):
                yield from readings(option, depth + 1)
        case Fn(name="clamp", args=args):
            for argument in _meaningful(args):
                yield from readings(argument, depth + 1)
        case Op(op="or" | "and", args=args):
            for argument in _meaningful(args):
                yield from readings(argument, depth + 1)
        case Op(op="add" | "sub", args=(left, right)) if is_tiny(right) and number(left) is None:
            # Not 1 - epsilon, where epsilon may well be the ratio of outliers.
            yield from readings(left, depth + 1)
        case Op(op="add", args=(left, right)) if is_tiny(left) and number(right) is None:
            yield from readings(right, depth + 1)
        case Item(base=base) if isinstance(plain(base), Fn | Op | Over | Choice):
            # one entry of an array computed entry by entry
            yield from readings(base, depth + 1)
        case _:
            yield expr


def _meaningful(options: tuple[Expr, ...]) -> tuple[Expr, ...]:
    """Drop the bounds of a clamp; if everything is a bound, keep what is not tiny."""
    kept = tuple(option for option in options if not is_bound(option))
    return kept or tuple(option for option in options if not is_tiny(option)) or options


def is_tiny(expr: Expr, depth: int = 0) -> bool:
    """Whether an expression is a guard against zero: 1e-10, eps, np.finfo(float).eps."""
    expr = plain(expr)
    match expr:
        case Num(value=value):
            return abs(value) < _TINY and value != 0
        case Name(name=name):
            return bool(_EPS_NAME.search(name))
        case Item(index=Name(name=name)):
            return bool(_EPS_NAME.search(name))
        case Op(op="neg" | "mul" | "div", args=args) if depth < 6:
            return is_tiny(args[0], depth + 1)
        case Op(op="pow"):
            power = number(expr)
            return power is not None and 0 < abs(power) < _TINY
        case Fn(name="?spacing" | "?epsilon" | "?nextafter" | "?min" | "count", args=args):
            return expr.name != "count" and len(args) <= 1
        case Choice(options=options) if depth < 6:
            return all(is_tiny(option, depth + 1) for option in options)
    return False


def is_bound(expr: Expr) -> bool:
    """Whether an expression is a constant that a clamp compares with."""
    match plain(expr):
        case Num():
            return True
        case Op(op="add" | "sub", args=(left, right)):
            return is_bound(left) and is_bound(right)
        case Name(name=name) if name.rpartition(".")[2].lower() in ("inf", "infinity", "nan"):
            return True
        case other:
            return is_tiny(other)


def number(expr: Expr, depth: int = 0) -> float | None:
    """Give the value of a constant expression."""
    expr = plain(expr)
    match expr:
        case Num(value=value):
            return value
        case Op(op="neg", args=(inner,)):
            positive = number(inner, depth + 1)
            return None if positive is None else -positive
        case Op(op=operator, args=(left, right)) if depth < 8:
            a, b = number(left, depth + 1), number(right, depth + 1)
            if a is None or b is None:
                return None
            try:
                match operator:
                    case "add":
                        return a + b
                    case "sub":
                        return a - b
                    case "mul":
                        return a * b
                    case "div":
                        return a / b
                    case "pow":
                        power = a**b
                        return power if isinstance(power, float) else None
            except ArithmeticError:
                return None
    return None


def key(expr: Expr) -> str:
    """Spell an expression by structure, so that equal expressions have equal keys.

    Past a few levels parts are known by identity: definitions are shared, so equal parts mostly
    are the same object, and the spelling stays short.
    """
    return _spell(expr, 5)


def _spell(expr: Expr, levels: int) -> str:
    expr = plain(expr)
    if levels == 0:
        match expr:
            case Num(value=value):
                return f"{value:g}"
            case Name(name=name):
                return name
        return f"#{id(expr)}"
    deeper = levels - 1
    match expr:
        case Num(value=value):
            return f"{value:g}"
        case Name(name=name):
            return name
        case Op(op=operator, args=args):
            return f"({operator} {' '.join(_spell(arg, deeper) for arg in args)})"
        case Fn(name=name, args=args):
            return f"{name}({','.join(_spell(arg, deeper) for arg in args[:8])})"
        case Item(base=base, index=index):
            return f"{_spell(base, deeper)}[{_spell(index, deeper)}]"
        case Seq(items=items):
            return f"[{','.join(_spell(item, deeper) for item in items[:8])}]"
        case Index(loop=loop):
            return f"@{loop}"
        case Over(kind=kind, body=body, loop=loop):
            return f"{kind}@{loop}({_spell(body, deeper)})"
        case Choice(options=options):
            return f"{{{'|'.join(_spell(option, deeper) for option in options)}}}"
    return f"#{id(expr)}"


# ---- sums -----------------------------------------------------------------------------------


def terms(expr: Expr, sign: int = 1, depth: int = 0) -> Iterator[tuple[int, Expr]]:
    """Split a sum into signed terms, through names but not through choices."""
    expr = plain(expr)
    if depth > MAX_DEPTH:
        yield sign, expr
        return
    match expr:
        case Op(op="add", args=args):
            for arg in args:
                yield from terms(arg, sign, depth + 1)
        case Op(op="sub", args=(left, right)):
            yield from terms(left, sign, depth + 1)
            yield from terms(right, -sign, depth + 1)
        case Op(op="neg", args=(inner,)):
            yield from terms(inner, -sign, depth + 1)
        case Op(op="mul", args=(Num(value=-1.0), inner)):
            yield from terms(inner, -sign, depth + 1)
        case Fn(name="clamp") if len(_meaningful(expr.args)) == 1:
            yield from terms(_meaningful(expr.args)[0], sign, depth + 1)
        case _:
            yield sign, expr


def complement(expr: Expr) -> Iterator[Expr]:
    """Yield each P for which an expression reads as 1 - P."""
    for reading in islice(readings(expr), WAYS):
        constant = 0.0
        others: list[tuple[int, Expr]] = []
        for sign, term in terms(reading):
            value = number(term)
            if has_structure(term):
                others.append((sign, term))
            elif value is not None:
                constant += sign * value
            elif not is_tiny(term):
                others.append((sign, term))
        match reading:
            case Op(op="div", args=(top, bottom)):
                yield from _rest_of_quotient(top, bottom)
        if abs(constant - 1.0) > _TINY or len(others) != 1:
            continue
        sign, other = others[0]
        positive = other if sign < 0 else _without_sign(other)
        if positive is not None:
            yield positive


def _rest_of_quotient(top: Expr, bottom: Expr) -> Iterator[Expr]:
    """Yield b/a for (a - b)/a."""
    whole, parts = key(bottom), list(terms(top))
    if len(parts) != 2 or number(bottom) is not None:
        return
    for (sign, one), (other_sign, other) in (parts, parts[::-1]):
        if sign > 0 > other_sign and key(one) == whole:
            yield Op("div", (other, bottom))


def _without_sign(expr: Expr) -> Expr | None:
    """Give P for -P, where the sign may stand at one of its factors; None without one."""
    match plain(expr):
        case Op(op="neg", args=(inner,)):
            return inner
        case Num(value=value, span=span) if value < 0:
            return Num(-value, span)
        case Op(op="mul" | "div" as operator, args=(left, right)):
            first = _without_sign(left)
            if first is not None:
                return Op(operator, (first, right))
            second = _without_sign(right)
            if second is not None:
                return Op(operator, (left, second))
    return None


def has_structure(expr: Expr, depth: int = 0) -> bool:
    """Whether a constant expression is written as a power or product worth reading."""
    match plain(expr):
        case Op(op="pow"):
            return True
        case Op(op="mul", args=(left, right)) if key(left) == key(right):
            return True  # 0.7 * 0.7
        case Op(op="mul" | "div", args=args) if depth < 6:
            return any(has_structure(arg, depth + 1) for arg in args)
    return False


# ---- counts ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Counts:
    """The two counts of a ratio of inliers, and the division that makes it of them."""

    n_inliers: Expr
    n_samples: Expr
    division: Expr


def counts_of(ratio: Expr) -> Counts | None:
    """Read I and n out of I/n, 1 - outliers/n or 1 - (n - I)/n, where there is one way to.

    Unlike the recogniser this reads no choices: a ratio that may be one of several has no counts
    that always belong to it.
    """
    expr = _definite(ratio)
    match expr:
        case Op(op="div", args=(top, bottom)):
            return Counts(top, bottom, expr)
        case Op(op="add" | "sub"):
            constant = 0.0
            others: list[tuple[int, Expr]] = []
            for sign, term in terms(expr):
                value = number(term)
                if value is None:
                    others.append((sign, _definite(term)))
                else:
                    constant += sign * value
            if len(others) != 1:
                return None
            sign, other = others[0]
            match other:
                case Op(op="div", args=(top, bottom)):
                    if constant == 0.0 and sign > 0:
                        return Counts(top, bottom, other)
                    if constant == 1.0 and sign < 0:
                        return Counts(_rest_of(bottom, top), bottom, other)
    return None


def _definite(expr: Expr) -> Expr:
    expr = plain(expr)
    while isinstance(expr, Fn) and expr.name == "clamp":
        kept = _meaningful(expr.args)
        if len(kept) != 1:
            break
        expr = plain(kept[0])
    return expr


def _rest_of(total: Expr, part: Expr) -> Expr:
    """Give total - part, or I where part is itself total - I."""
    rest: list[Expr] = []
    signs = 0
    for sign, term in terms(part):
        if sign > 0 and key(term) == key(total):
            signs += 1
        else:
            rest.append(term)
    if signs == 1 and len(rest) == 1:
        return rest[0]
    return Op("sub", (total, part))
