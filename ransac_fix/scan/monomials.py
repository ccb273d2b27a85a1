"""Products in one canonical shape, the monomial: constants, powers of atoms, falling factors.

``w*w*w``, ``w**3``, ``pow(w, 3)``, ``exp(3*log(w))``, ``(i*i*i)/(n*n*n)`` and a loop over
``p *= w`` are then the same thing, and so are a loop over ``(I-i)/(n-i)``,
``comb(I, k)/comb(n, k)`` and ``I*(I-1)/(n*(n-1))``.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice

from ransac_fix.scan.algebra import MAX_DEPTH, WAYS, key, number, plain, readings, terms
from ransac_fix.scan.form import Choice, Expr, Fn, Index, Item, Name, Num, Op, Over, Seq


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
    for factors in islice(_factorings(expr, Power(expr), 0), WAYS):
        monomial = Monomial()
        for factor in _with_powers_of_numbers(factors):
            _collect(factor, monomial)
        yield monomial


def _factorings(expr: Expr, power: Power, depth: int) -> Iterator[list[Power]]:
    """Flatten products and powers into factors, one list for each reading.

    ``power`` carries the exponent that the whole expression is raised to.
    """
    for reading in islice(readings(expr), WAYS):
        if depth > MAX_DEPTH:
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
    for one in islice(_factorings(left, left_power, depth + 1), WAYS):
        for other in islice(_factorings(right, right_power, depth + 1), WAYS):
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
    for factors in islice(_factorings(whole.body, Power(whole.body), depth + 1), WAYS):
        out: list[Power] = []
        for factor in factors:
            if _depends_on(factor.base, whole.loop) and factor.symbol is not None:
                # a product of powers, one for each kind of data
                out.append(replace(factor, exponent=factor.exponent * power.exponent))
                continue
            if _depends_on(factor.base, whole.loop):
                out.append(power.to(Fn("falling", (factor.base,)), factor.exponent))
                continue
            count = whole.count or Name("number of factors")
            out += next(iter(_raised(whole, factor.base, count, factor.exponent, power, depth)), [])
        yield out


def _depends_on(expr: Expr, loop: str, depth: int = 0) -> bool:
    """Whether an expression changes from one run of a loop to the next."""
    expr = plain(expr)
    if depth > 12:
        return False
    match expr:
        case Index(loop=own):
            return own == loop
        case Op(args=args) | Fn(args=args):
            return any(_depends_on(arg, loop, depth + 1) for arg in args)
        case Choice(options=options):
            return any(_depends_on(option, loop, depth + 1) for option in options)
        case Item(base=base, index=index):
            return _depends_on(base, loop, depth + 1) or _depends_on(index, loop, depth + 1)
        case Seq(items=items):
            return any(_depends_on(item, loop, depth + 1) for item in items)
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
