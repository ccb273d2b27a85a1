"""Quotients of logarithms, and what the logarithms are of."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

from ransac_fix.scan.algebra import WAYS, number, plain, readings, terms
from ransac_fix.scan.form import Expr, Fn, Name, Num, Op


@dataclass(frozen=True, slots=True)
class Quotient:
    """``constant * log(top) / log(bottom)``."""

    top: Expr
    bottom: Expr
    scaled: bool


def quotients(expr: Expr) -> Iterator[Quotient]:
    """Yield the ways an expression reads as a quotient of two logarithms."""
    for factors in islice(_log_factorings(expr, 1, 0), 4 * WAYS):
        tops = [one for one, sign in factors if sign > 0 and _is_log(one)]
        bottoms = [one for one, sign in factors if sign < 0 and _is_log(one)]
        if len(bottoms) != 1 or len(tops) > 1:
            continue
        others = [one for one, _ in factors if one not in tops and one not in bottoms]
        if not tops:
            # log(1-s) worked out beforehand: a name that says so, or a negative number.
            named = [one for one, sign in factors if sign > 0 and _stands_for_log(one)]
            if len(named) != 1:
                continue
            tops = named
            others = [one for one in others if one is not named[0]]
        scaled = any(abs(number(one) or 0.0) != 1.0 for one in others)
        yield Quotient(tops[0], bottoms[0], scaled)


def _log_factorings(expr: Expr, sign: int, depth: int) -> Iterator[list[tuple[Expr, int]]]:
    for reading in islice(readings(expr), WAYS):
        match reading:
            case Op(op="mul", args=(left, right)) if depth < 8:
                second = sign
            case Op(op="div" | "floordiv", args=(left, right)) if depth < 8:
                second = -sign
            case Op(op="neg", args=(inner,)):
                yield from _log_factorings(inner, sign, depth + 1)
                continue
            case Op(op="pow", args=(inner, power)) if number(power) == -1.0:
                yield from _log_factorings(inner, -sign, depth + 1)
                continue
            case _:
                yield [(_one_log(reading), sign)]
                continue
        for one in islice(_log_factorings(left, sign, depth + 1), WAYS):
            for other in islice(_log_factorings(right, second, depth + 1), WAYS):
                yield one + other


def _one_log(expr: Expr) -> Expr:
    """Write a sum of logarithms as one: log(a) - k*log(b) as log(a / b**k)."""
    if not (isinstance(expr, Op) and expr.op in ("add", "sub")):
        return expr
    sides: dict[int, Expr] = {}
    for sign, part in terms(expr):
        factor = _logarithm_of(part)
        if factor is None:
            return expr
        sides[sign] = Op("mul", (sides[sign], factor)) if sign in sides else factor
    quotient = Op("div", (sides.get(1, Num(1.0)), sides[-1])) if -1 in sides else sides[1]
    return Fn("log", (quotient,), expr.span)


def _logarithm_of(expr: Expr) -> Expr | None:
    """Give x for log(x), or x**k for k*log(x)."""
    match plain(expr):
        case Fn(name="log", args=(inner, *_)):
            return inner
        case Op(op="mul", args=(left, right)):
            for one, other in ((left, right), (right, left)):
                match plain(one):
                    case Fn(name="log", args=(inner, *_)):
                        return Op("pow", (inner, other))
    return None


def _is_log(expr: Expr) -> bool:
    return isinstance(expr, Fn) and expr.name == "log"


def _stands_for_log(expr: Expr) -> bool:
    match expr:
        case Name():
            return True  # worked out elsewhere: a parameter, an attribute
        case Num(value=value):
            return 0.1 < abs(value) < 60.0 and abs(value) != 1.0  # not 1 / log(...), a factor
        case Fn(name=name):
            return name.startswith("?log")
        case Op(op="add" | "sub"):
            # log(1-s) less what other samples have taken care of: SPRT
            return any(_is_log(plain(term)) or _names_log(plain(term)) for _, term in terms(expr))
    return False


def _names_log(expr: Expr) -> bool:
    match expr:
        case Name(name=name):
            return name.rpartition(".")[2].lower().startswith("log")
    return isinstance(expr, Fn) and _stands_for_log(expr)


def log_arguments(expr: Expr) -> Iterator[Expr]:
    """Yield x for an expression that reads as log(x), or as its negative, log(1/x)."""
    for reading in islice(readings(expr), WAYS):
        if isinstance(reading, Fn) and reading.name == "log":
            yield _inverted(reading.args[0])


def _inverted(expr: Expr) -> Expr:
    """Give x for 1/x, and anything else as it is."""
    match plain(expr):
        case Op(op="div", args=(one, bottom)) if number(one) == 1.0:
            return bottom
    return expr
