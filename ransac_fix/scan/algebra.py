"""The algebra of the rule: complements, powers, products and quotients of logarithms.

Everything here reads resolved expressions (``evaluate``) and looks through what does not change
the mathematics: names, casts, rounding, clamps to constants, small guards. A value that may be
one of several is read every way, up to a budget.

A probability is brought to one canonical shape, a monomial: constant factors, powers of atoms,
and products of falling factors. ``w*w*w``, ``w**3``, ``pow(w, 3)``, ``exp(3*log(w))``,
``(i*i*i)/(n*n*n)`` and a loop over ``p *= w`` are then the same thing, and so are a loop over
``(I-i)/(n-i)``, ``comb(I, k)/comb(n, k)`` and ``I*(I-1)/(n*(n-1))``.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise

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

_WAYS = 8  # ways one expression is read
_DEPTH = 40
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
    if depth > _DEPTH:
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
    if depth > _DEPTH:
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
    for reading in islice(readings(expr), _WAYS):
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


# ---- monomials ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Power:
    """``base ** (exponent * symbol)``.

    ``written`` and ``raised`` are the exponent and the base of the power as written, ``whole`` the
    power itself; the base may since have been taken apart. ``repeated`` marks a number that is
    written as often as its power says.
    """

    base: Expr
    exponent: float = 1.0
    symbol: Expr | None = None
    written: Expr | None = None
    raised: Expr | None = None
    whole: Expr | None = None
    repeated: bool = False

    def to(self, base: Expr, times: float = 1.0) -> "Power":
        """Raise another base to this power, or to a multiple of it."""
        return replace(self, base=base, exponent=self.exponent * times)


@dataclass(slots=True)
class Monomial:
    """A product of constants, powers and falling factors."""

    constant: float = 1.0
    powers: list[Power] = field(default_factory=list)
    falling: list[tuple[int, Expr]] = field(default_factory=list)
    counting: list[tuple[int, Expr]] = field(default_factory=list)
    opaque: bool = False


def monomials(expr: Expr) -> Iterator[Monomial]:
    """Yield the ways an expression reads as a product."""
    for factors in islice(_factorings(expr, Power(expr), 0), _WAYS):
        monomial = Monomial()
        for factor in _with_powers_of_numbers(factors):
            _collect(factor, monomial)
        yield monomial


def _factorings(expr: Expr, power: Power, depth: int) -> Iterator[list[Power]]:
    """Flatten products and powers into factors, one list for each reading.

    ``power`` carries the exponent that the whole expression is raised to.
    """
    for reading in islice(readings(expr), _WAYS):
        if depth > _DEPTH:
            yield [power.to(reading)]
            continue
        match reading:
            case Op(op="mul", args=(left, right)):
                yield from _pairs(left, power, right, power, depth)
            case Op(op="div" | "floordiv", args=(left, right)):
                yield from _pairs(left, power, right, power.to(right, -1.0), depth)
            case Op(op="sub", args=(left, right)) if (
                fraction := _without_factor(right, left)
            ) is not None:
                # x - x*q is x * (1 - q)
                other = Op("sub", (Num(1.0), fraction))
                yield from _pairs(left, power, other, power, depth)
            case Op(op="neg", args=(inner,)):
                for rest in _factorings(inner, power, depth + 1):
                    yield [Power(Num(-1.0)), *rest]
            case Op(op="pow", args=(base, exponent)) if _raises_logarithms(base, exponent):
                yield from _exponentials(reading, exponent, power, depth)
            case Op(op="pow", args=(base, exponent)):
                yield from _raised(reading, base, exponent, 1.0, power, depth)
            case Fn(name="exp", args=(inner, *_)):
                yield from _exponentials(reading, inner, power, depth)
            case Over(kind="prod"):
                yield from _products(reading, power, depth)
            case Num():
                yield [power.to(reading)]
            case _:
                # As it was written: its name is what a report shows.
                yield [power.to(expr)]


def _without_factor(expr: Expr, factor: Expr) -> Expr | None:
    """Give y for x*y."""
    match plain(expr):
        case Op(op="mul", args=(one, other)):
            name = key(factor)
            if key(one) == name:
                return other
            return one if key(other) == name else None
    return None


def _raises_logarithms(base: Expr, exponent: Expr) -> bool:
    """Whether a power is an exponential: ``e ** (k * log(w))``, ``2 ** (k * log2(w))``."""
    named = isinstance(plain(base), Name) and key(base).rpartition(".")[2] in ("e", "M_E")
    if number(exponent) is not None or not (named or (number(base) or 0.0) > 1.0):
        return False
    factors = next(iter(_exponentials(exponent, exponent, Power(exponent), 0)))
    return not (len(factors) == 1 and factors[0].base is exponent)


def _raised(
    whole: Expr, base: Expr, exponent: Expr, sign: float, power: Power, depth: int
) -> Iterator[list[Power]]:
    value = number(exponent)
    match plain(exponent):
        case Op(op="neg", args=(positive,)):
            # (n / i)**-k is (i / n)**k
            yield from _raised(whole, _reciprocal(base), positive, sign, power, depth)
            return
    # Of 1 / (n / i)**k what is raised is i / n.
    raised = base if power.exponent * sign > 0 else _reciprocal(base)
    if value is not None:
        inner = replace(
            power,
            exponent=power.exponent * sign * value,
            written=exponent,
            raised=raised,
            whole=whole,
        )
    elif power.symbol is None:
        inner = replace(
            power,
            exponent=power.exponent * sign,
            symbol=exponent,
            written=exponent,
            raised=raised,
            whole=whole,
        )
    else:
        yield [power.to(whole)]
        return
    yield from _factorings(base, inner, depth + 1)


def _reciprocal(expr: Expr) -> Expr:
    match plain(expr):
        case Op(op="div", args=(top, bottom), span=span):
            return Op("div", (bottom, top), span)
    return Op("div", (Num(1.0), expr), expr.span)


def _pairs(
    left: Expr, left_power: Power, right: Expr, right_power: Power, depth: int
) -> Iterator[list[Power]]:
    for one in islice(_factorings(left, left_power, depth + 1), _WAYS):
        for other in islice(_factorings(right, right_power, depth + 1), _WAYS):
            yield one + other


def _exponentials(whole: Expr, inner: Expr, power: Power, depth: int) -> Iterator[list[Power]]:
    """Read exp(k*log(w) + ...) as a product of powers."""
    factors: list[Power] = []
    for reading in islice(readings(inner), 1):
        for sign, term in terms(reading):
            part = _log_term(term, power.to(term, float(sign)), depth)
            if part is None:
                factors = []
                break
            factors += part
    yield factors or [power.to(whole)]


def _log_term(term: Expr, power: Power, depth: int) -> list[Power] | None:
    """Read k*log(w), lgamma(x) or a sum of logarithms over a loop."""
    term = plain(term)
    match term:
        case Num(value=value):
            return [Power(Num(math.exp(value)))] if abs(value) < 100 else None
        case Fn(name="log", args=(inner, *_)):
            return next(iter(_factorings(inner, power, depth + 1)), None)
        case Fn(name="lgamma", args=(inner, *_)):
            return [power.to(Fn("gamma", (inner,)))]
        case Over(kind="sum", body=body, loop=loop, count=count):
            product: Expr = Num(1.0)
            for reading in islice(readings(body), 1):
                for sign, part in terms(reading):
                    factors = _log_term(part, Power(part, float(sign)), depth + 1)
                    if factors is None:
                        return None
                    for factor in factors:
                        product = Op(
                            "mul" if factor.exponent > 0 else "div", (product, factor.base)
                        )
            over = Over("prod", product, loop, count)
            return next(iter(_factorings(over, power, depth + 1)), None)
        case Op(op="mul", args=(left, right)):
            return _times_logs(term, left, right, power, depth) or _times_logs(
                term, right, left, power, depth
            )
    return None


def _times_logs(
    whole: Expr, logs: Expr, times: Expr, power: Power, depth: int
) -> list[Power] | None:
    """Read k*log(w) and k*(log(I) - log(n))."""
    raised: list[Power] = []
    for sign, part in terms(logs):
        log = plain(part)
        if not (isinstance(log, Fn) and log.name == "log"):
            return None
        raised += next(iter(_raised(whole, log.args[0], times, float(sign), power, depth)), [])
    return raised


def _products(whole: Over, power: Power, depth: int) -> Iterator[list[Power]]:
    """Read a product over a loop: falling factors, and factors that do not change."""
    for factors in islice(_factorings(whole.body, Power(whole.body), depth + 1), _WAYS):
        out: list[Power] = []
        for factor in factors:
            if depends_on(factor.base, whole.loop) and factor.symbol is not None:
                # a product of powers, one for each kind of data
                out.append(replace(factor, exponent=factor.exponent * power.exponent))
                continue
            if depends_on(factor.base, whole.loop):
                out.append(power.to(Fn("falling", (factor.base,)), factor.exponent))
                continue
            count = whole.count or Name("number of factors")
            out += next(iter(_raised(whole, factor.base, count, factor.exponent, power, depth)), [])
        yield out


def depends_on(expr: Expr, loop: str, depth: int = 0) -> bool:
    """Whether an expression changes from one run of a loop to the next."""
    expr = plain(expr)
    if depth > 12:
        return False
    match expr:
        case Index(loop=own):
            return own == loop
        case Op(args=args) | Fn(args=args):
            return any(depends_on(arg, loop, depth + 1) for arg in args)
        case Choice(options=options):
            return any(depends_on(option, loop, depth + 1) for option in options)
        case Item(base=base, index=index):
            return depends_on(base, loop, depth + 1) or depends_on(index, loop, depth + 1)
        case Seq(items=items):
            return any(depends_on(item, loop, depth + 1) for item in items)
    return False


def _with_powers_of_numbers(factors: list[Power]) -> list[Power]:
    """Read a number that is a factor several times as a power of it: ``0.7 * 0.7``.

    It is one where it could be a ratio by itself, or where as many factors divide: ``r * r`` with
    ``r = 2 / n`` is (2/n)**2.
    """
    times = Counter(_plain_number(factor) for factor in factors)
    del times[None]
    repeated = {value for value, count in times.items() if count > 1}
    if not repeated:
        return factors
    divided = Counter(key(factor.base) for factor in factors if factor.exponent == -1.0)
    most_divided = max(divided.values(), default=0)
    powers = {
        value
        for value in repeated
        if value is not None and (value < 1.0 or times[value] == most_divided)
    }
    return [
        replace(factor, repeated=True) if _plain_number(factor) in powers else factor
        for factor in factors
    ]


def _plain_number(factor: Power) -> float | None:
    """Give the value of a factor that is a positive number, raised to no power."""
    base = plain(factor.base)
    if isinstance(base, Num) and factor.exponent == 1.0 and factor.written is None:
        return base.value if base.value > 0.0 and factor.symbol is None else None
    return None


def _collect(factor: Power, monomial: Monomial) -> None:
    inner = plain(factor.base)
    sign = 1 if factor.exponent > 0 else -1
    match inner:
        case Num(value=1.0):
            pass
        case Num(value=value) if factor.written is None and not factor.repeated:
            # A constant raised to a power is an assumed ratio; any other is a factor.
            monomial.constant *= value if sign > 0 else (1.0 / value if value else math.inf)
        case Fn(name="falling", args=(body,)):
            monomial.falling.append((sign, body))
        case Fn(name="comb" | "factorial" | "gamma" | "hypergeom"):
            monomial.counting.append((sign, inner))
        case _:
            monomial.powers.append(factor)


def offset_of(expr: Expr) -> tuple[str, float] | None:
    """Read ``x - 2`` as (key of x, -2)."""
    constant = 0.0
    others: list[str] = []
    # A count that may be one of several is one unknown: the same one in I and in I - 1.
    for sign, term in terms(expr):
        value = number(term)
        if value is not None:
            constant += sign * value
        else:
            others.append(f"{sign}{key(term)}")
    if not others:
        return None
    return "+".join(sorted(others)), constant


# ---- quotients of logarithms ----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Quotient:
    """``constant * log(top) / log(bottom)``."""

    top: Expr
    bottom: Expr
    scaled: bool


def quotients(expr: Expr) -> Iterator[Quotient]:
    """Yield the ways an expression reads as a quotient of two logarithms."""
    for factors in islice(_log_factorings(expr, 1, 0), 4 * _WAYS):
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
    for reading in islice(readings(expr), _WAYS):
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
        for one in islice(_log_factorings(left, sign, depth + 1), _WAYS):
            for other in islice(_log_factorings(right, second, depth + 1), _WAYS):
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
    for reading in islice(readings(expr), _WAYS):
        if isinstance(reading, Fn) and reading.name == "log":
            yield _inverted(reading.args[0])


def _inverted(expr: Expr) -> Expr:
    """Give x for 1/x, and anything else as it is."""
    match plain(expr):
        case Op(op="div", args=(one, bottom)) if number(one) == 1.0:
            return bottom
    return expr


# ---- classification -------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Probability:
    """What the probability of an all-inlier sample was taken to be.

    Attributes
    ----------
    kind : {"approximate", "exact", "replacement"}
        ``replacement``: a falling numerator over a power, exact when samples are drawn with
        replacement.
    ratio : Expr or None
        The inlier ratio w of w**k, as written.
    exponent : Expr or None
        The sample size k.
    exponent_value : float or None
        k where it is a number.
    n_inliers, n_samples : Expr or None
        Where the ratio is a quotient, its two counts.
    constant : float
        A factor that is not part of the probability of the sample, such as 1/3.
    other_factors : int
        How many more such factors there are.
    power : Expr or None
        The power itself, where it is written as one.
    """

    kind: str
    ratio: Expr | None = None
    exponent: Expr | None = None
    exponent_value: float | None = None
    n_inliers: Expr | None = None
    n_samples: Expr | None = None
    constant: float = 1.0
    other_factors: int = 0
    power: Expr | None = None


def classify(expr: Expr) -> Probability | None:
    """Say which probability an expression computes: approximate wins over exact, if both."""
    best: Probability | None = None
    for monomial in monomials(expr):
        found = _classify(monomial)
        if found is not None:
            found = replace(found, constant=monomial.constant)
            if found.kind == "approximate":
                return found
            best = best or found
    return best


def _classify(monomial: Monomial) -> Probability | None:
    if not 0.0 < abs(monomial.constant) <= 1.0:
        return None
    up = [body for sign, body in monomial.falling if sign > 0]
    down = [body for sign, body in monomial.falling if sign < 0]
    if up and down:
        return _falling(up[0], down[0])
    if up and monomial.powers:
        # I*(I-1)*... over n**k: drawn with replacement, and a repeated index spoils the sample.
        return Probability("replacement")
    if up:
        ratio = plain(up[0])
        match ratio:
            case Op(op="div", args=(top, bottom)):
                return _falling(top, bottom)
        return None
    if _is_counted_ratio(monomial.counting):
        return Probability("exact")
    if monomial.counting:
        return None
    return _falling_written_out(monomial) or _power(monomial)


def _is_counted_ratio(counting: Iterable[tuple[int, Expr]]) -> bool:
    signs = [sign for sign, _ in counting]
    if any(isinstance(one, Fn) and one.name == "hypergeom" for _, one in counting):
        return True
    return 1 in signs and -1 in signs


def _falling(top: Expr, bottom: Expr) -> Probability:
    return Probability("exact", n_inliers=_base_count(top), n_samples=_base_count(bottom))


def _base_count(expr: Expr) -> Expr | None:
    for _, term in terms(expr):
        if number(term) is None and not isinstance(plain(term), Index):
            return term
    return None


def _falling_written_out(monomial: Monomial) -> Probability | None:
    """Read I*(I-1)*(I-2) / (n*(n-1)*(n-2))."""
    if any(abs(power.exponent) != 1.0 or power.symbol is not None for power in monomial.powers):
        return None
    sides: dict[int, dict[str, list[float]]] = {1: {}, -1: {}}
    for power in monomial.powers:
        read = offset_of(power.base)
        if read is not None:
            name, offset = read
            sides[1 if power.exponent > 0 else -1].setdefault(name, []).append(offset)
    tops = {name: sorted(offsets) for name, offsets in sides[1].items() if len(offsets) > 1}
    bottoms = [sorted(offsets) for offsets in sides[-1].values() if len(offsets) > 1]
    for offsets in tops.values():
        steps = [b - a for a, b in pairwise(offsets)]
        if all(step == 1.0 for step in steps) and offsets in bottoms:
            return Probability("exact", exponent_value=float(len(offsets)))
    return None


def _power(monomial: Monomial) -> Probability | None:
    """Find the power w**k, or (I/n)**k with its factors apart."""
    groups: dict[str, list[Power]] = {}
    for power in monomial.powers:
        symbol = "" if power.symbol is None else key(power.symbol)
        groups.setdefault(symbol, []).append(power)
    found: list[Probability] = []
    left_over = 0
    for symbol, members in groups.items():
        read = _symbolic(members) if symbol else _numeric(members)
        if read is None:
            left_over += len(members)
        else:
            found.append(read)
    if not found:
        return None
    return replace(found[0], other_factors=left_over + len(found) - 1)


def _symbolic(members: list[Power]) -> Probability | None:
    symbol = members[0].symbol
    tops = [power for power in members if power.exponent > 0]
    bottoms = [power for power in members if power.exponent < 0]
    if symbol is None or not tops or is_reciprocal(symbol):
        return None
    return _ratio_power(tops, bottoms, symbol, None)


def _numeric(members: list[Power]) -> Probability | None:
    """Add up exponents of equal bases: w*w*w is w**3."""
    totals: dict[str, float] = {}
    first: dict[str, Power] = {}
    for power in members:
        name = key(power.base)
        totals[name] = totals.get(name, 0.0) + power.exponent
        first.setdefault(name, power)
    highest = max(totals.values())
    if not 2 <= highest <= 64 or highest != int(highest):
        return None
    tops = [first[name] for name, total in totals.items() if total == highest]
    bottoms = [first[name] for name, total in totals.items() if total == -highest]
    return _ratio_power(tops, bottoms, tops[0].written, highest)


def _ratio_power(
    tops: list[Power], bottoms: list[Power], exponent: Expr | None, value: float | None
) -> Probability | None:
    base = tops[0].base
    constant = number(base)
    ratio = base if tops[0].raised is None else tops[0].raised
    if constant is not None and not bottoms and constant >= 1.0:
        return None  # 2**k counts something else
    return Probability(
        "approximate",
        ratio=ratio,
        exponent=exponent,
        exponent_value=value,
        n_inliers=base if bottoms else None,
        n_samples=bottoms[0].base if bottoms else None,
        power=tops[0].whole,
    )


def is_reciprocal(expr: Expr) -> bool:
    """Whether an exponent is one over something: a root, not a power."""
    for reading in islice(readings(expr), _WAYS):
        match reading:
            case Op(op="div", args=(top, bottom)) if number(bottom) is None:
                value = number(top)
                if value is not None and abs(value) == 1.0:
                    return True
            case Op(op="neg"):
                return True
            case Op(op="pow", args=(_, power)) if (number(power) or 0.0) < 0:
                return True
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
