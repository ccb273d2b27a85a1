"""Which probability of an all-inlier sample an expression is: a power, a product, or none."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice, pairwise

from ransac_fix.scan.algebra import WAYS, key, number, plain, readings, terms
from ransac_fix.scan.form import Expr, Fn, Index, Op
from ransac_fix.scan.monomials import Monomial, Power, monomials


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
        read = _offset_of(power.base)
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
    sizes = {symbol: _completed(members, groups) for symbol, members in groups.items() if symbol}
    found: list[Probability] = []
    left_over = 0
    for symbol, members in groups.items():
        if not members:
            continue
        read = _symbolic(members, sizes[symbol]) if symbol else _numeric(members)
        if read is None:
            left_over += len(members)
        else:
            found.append(read)
    if not found:
        return None
    return replace(found[0], other_factors=left_over + len(found) - 1)


def _completed(members: list[Power], groups: dict[str, list[Power]]) -> Expr | None:
    """Give k for the factors w**(k-1) and w, and take the second from those without a symbol."""
    symbol = members[0].symbol
    size = None if symbol is None else _one_more(symbol)
    bases = {key(power.base): power.exponent for power in members}
    completing = [power for power in groups.get("", []) if key(power.base) in bases]
    once = {key(power.base): power.exponent for power in completing}
    if size is None or once != bases or not len(completing) == len(bases) == len(members):
        return None
    groups[""] = [power for power in groups[""] if power not in completing]
    return size


def _one_more(expr: Expr) -> Expr | None:
    """Give k for k - 1."""
    signed = list(terms(expr))
    constant = sum(sign * (number(term) or 0.0) for sign, term in signed)
    others = [(sign, term) for sign, term in signed if number(term) is None]
    return others[0][1] if constant == -1.0 and [sign for sign, _ in others] == [1] else None


def _symbolic(members: list[Power], size: Expr | None) -> Probability | None:
    symbol = members[0].symbol
    tops = [power for power in members if power.exponent > 0]
    bottoms = [power for power in members if power.exponent < 0]
    if symbol is None or not tops or _is_reciprocal(symbol):
        return None
    return _ratio_power(tops, bottoms, size or symbol, None)


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


def _is_reciprocal(expr: Expr) -> bool:
    """Whether an exponent is one over something: a root, not a power."""
    for reading in islice(readings(expr), WAYS):
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


def _offset_of(expr: Expr) -> tuple[str, float] | None:
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
