"""The recogniser: which of the candidates is a stopping rule, and which probability it assumes.

There is one recogniser for all languages. It reads only resolved expressions, so that a rule is
what its algebra says, however it is spelled.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from ransac_fix.scan import algebra
from ransac_fix.scan.evaluate import Candidate
from ransac_fix.scan.form import Expr, Fn, Function, Name, Num, Op, Over, Span
from ransac_fix.scan.logarithms import log_arguments, quotients
from ransac_fix.scan.monomials import Power, monomials
from ransac_fix.scan.probability import Probability, classify

_WAYS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A place where a stopping rule stands.

    Attributes
    ----------
    form : {"quotient", "test", "inverse"}
        ``log(1-s) / log(1-P)``; a comparison that is the same rule solved otherwise, such as
        ``1 - (1-P)**N > s``; or the number of inliers that would have been seen by now,
        ``n * (1 - (1-s)**(1/N)) ** (1/k)``.
    probability : Probability
        The P that it assumes: approximate, exact or with replacement.
    span : Span
        Where it stands.
    used : Span
        Where its value is used: the same place, but for a comparison of a name.
    confidence : Expr or None
        The s of the rule, or 1-s where that is what the source has.
    function : Function or None
        The function it stands in.
    assumed : Expr
        The expression that the rule takes for P.
    seen : tuple of Candidate
        Each way it was reached: by itself, and through the calls of its function.
    called_with : tuple of Probability
        What its callers in the file make of it.
    """

    form: str
    probability: Probability
    span: Span
    used: Span
    confidence: Expr | None
    trials: Expr | None
    function: Function | None
    assumed: Expr
    seen: tuple[Candidate, ...]
    called_with: tuple[Probability, ...] = ()


def recognise(candidates: Sequence[Candidate]) -> list[Site]:
    """Find the rules among the candidates of one file, exact ones too, in order of place."""
    seen: dict[tuple[Span, str], list[Candidate]] = {}
    for candidate in candidates:
        span = candidate.expr.span
        if span is not None:
            seen.setdefault((span, candidate.kind), []).append(candidate)
    sites: list[Site] = []
    for (span, kind), group in seen.items():
        # A function read by itself says most of itself; its callers say what its parameters are.
        for candidate in sorted(group, key=lambda one: one.call is not None):
            read = _READERS[kind](candidate)
            if read is not None:
                own = next((one.function for one in group if one.call is None), None)
                sites.append(
                    Site(
                        kind,
                        read.probability,
                        _place(span, read.formula),
                        span,
                        read.confidence,
                        read.trials,
                        own or candidate.function,
                        read.assumed,
                        tuple(group),
                        _called_with(kind, group),
                    )
                )
                break
    return _without_repeats(sites)


@dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    probability: Probability
    assumed: Expr
    confidence: Expr | None
    trials: Expr | None = None
    formula: Expr | None = None


def _place(span: Span, formula: Expr | None) -> Span:
    """Give the place of the formula: not that of a test which only names its value."""
    own = algebra.plain(formula).span if formula is not None else None
    return span if own is None or _inside(own, span) else own


def _quotient(candidate: Candidate) -> _Reading | None:
    best: _Reading | None = None
    for quotient in islice(quotients(candidate.expr), _WAYS):
        for argument in islice(log_arguments(quotient.bottom), _WAYS):
            for assumed in islice(algebra.complement(argument), _WAYS):
                probability = classify(assumed)
                if probability is None:
                    continue
                reading = _Reading(probability, assumed, _confidence(quotient.top))
                if probability.kind == "approximate":
                    return reading
                best = best or reading
    return best


def _confidence(top: Expr) -> Expr | None:
    """Read s out of log(1-s)."""
    for argument in islice(log_arguments(top), _WAYS):
        match algebra.plain(argument):
            case Op(op="sub", args=(one, s)) if algebra.number(one) == 1.0:
                return s  # even where both are numbers
        return next(algebra.complement(argument), argument)
    return None


def _test(candidate: Candidate) -> _Reading | None:
    assert isinstance(candidate.expr, Op)
    left, right = candidate.expr.args
    best: _Reading | None = None
    for side, other, whole in _sides(left, right):
        for assumed, trials, formula in _failure_powers(side, other):
            probability = classify(assumed)
            if probability is None:
                continue
            confidence = next(algebra.complement(other), other) if whole else None
            reading = _Reading(probability, assumed, confidence, trials, formula)
            if probability.kind == "approximate":
                return reading
            best = best or reading
    return best


def _sides(left: Expr, right: Expr) -> Iterator[tuple[Expr, Expr, bool]]:
    """Yield each side of a comparison and the other one, and then the terms of each side."""
    yield left, right, True
    yield right, left, True
    for side, other in ((left, right), (right, left)):
        terms = [term for _, term in islice(algebra.terms(side), _WAYS)]
        for term in terms if len(terms) > 1 else ():
            rest = [one for one in terms if one is not term]
            # x - y < 0 compares x with y.
            yield term, rest[0] if algebra.number(other) == 0.0 and rest else other, False
        match algebra.plain(side):
            case Op(op="mul", args=(one, two)):
                for factor, scaled in ((one, two), (two, one)):
                    if algebra.number(factor) is not None:
                        yield scaled, other, False


def _failure_powers(side: Expr, other: Expr) -> Iterator[tuple[Expr, Expr, Expr]]:
    """Yield (P, N, formula) for a side that reads (1-P)**N, 1 - (1-P)**N or N*log(1-P).

    N*log(1-P) may be a sum of logarithms over the trials, or have its N on the other side.
    """
    logarithmic = _is_logarithmic(other)
    for formula in islice(algebra.readings(side), _WAYS):
        for reading in (formula, *islice(algebra.complement(formula), _WAYS)):
            for monomial in islice(monomials(reading), _WAYS):
                for power in monomial.powers:
                    # (1-P)**N, or (1-P) once more in each run of a loop
                    if power.symbol is None or not _all_fail(monomial.powers, power):
                        continue
                    for assumed in islice(algebra.complement(power.base), _WAYS):
                        yield assumed, power.symbol, formula
        for log, trials in _multiples(formula, other) if logarithmic else ():
            for argument in islice(log_arguments(log), _WAYS):
                for assumed in islice(algebra.complement(argument), _WAYS):
                    yield assumed, trials, formula


def _all_fail(powers: Sequence[Power], power: Power) -> bool:
    """Whether the others are the chance of one more sample with outliers, as this run has it."""
    own = algebra.key(power.base)
    return all(
        algebra.key(other.base) == own
        or (
            other.symbol is None
            and any(
                classify(assumed) is not None
                for assumed in islice(algebra.complement(other.base), _WAYS)
            )
        )
        for other in powers
    )


def _is_logarithmic(expr: Expr) -> bool:
    """Whether an expression reads as log(x) or log(x) / N."""
    for reading in islice(algebra.readings(expr), _WAYS):
        match reading:
            case Op(op="div", args=(top, _)):
                reading = top
        if any(True for _ in log_arguments(reading)):
            return True
    return False


def _multiples(formula: Expr, other: Expr) -> Iterator[tuple[Expr, Expr]]:
    """Yield (log, N) for N*log, for the sum of a log over N trials, and for log against x/N."""
    match formula:
        case Op(op="mul", args=args):
            for log, trials in (args, args[::-1]):
                if not isinstance(algebra.plain(trials), Fn | Num):
                    yield log, trials
        case Fn(name="log"):
            for reading in islice(algebra.readings(other), _WAYS):
                match reading:
                    case Op(op="div", args=(_, trials)):
                        yield formula, trials
    for _, term in islice(algebra.terms(formula), _WAYS):
        match term:
            case Over(kind="sum", body=body):
                for _, log in islice(algebra.terms(body), _WAYS):
                    yield log, term.count or Name("number of trials")


def _inverse(candidate: Candidate) -> _Reading | None:
    """Read n * (1 - (1-s)**(1/N)) ** (1/k), the rule solved for the inliers."""
    assert isinstance(candidate.expr, Op)
    for root, samples in (candidate.expr.args, candidate.expr.args[::-1]):
        for outer in islice(algebra.readings(root), _WAYS):
            size = _rooted(outer)
            if size is None or not isinstance(outer, Op):
                continue
            for inside in islice(algebra.complement(outer.args[0]), _WAYS):
                for inner in islice(algebra.readings(inside), _WAYS):
                    trials = _rooted(inner)
                    if trials is None or not isinstance(inner, Op):
                        continue
                    miss = inner.args[0]
                    confidence = next(algebra.complement(miss), miss)
                    probability = Probability("approximate", exponent=size, n_samples=samples)
                    return _Reading(probability, outer, confidence, trials)
    return None


def _rooted(expr: Expr) -> Expr | None:
    """Give k of x ** (1/k)."""
    if not (isinstance(expr, Op) and expr.op == "pow"):
        return None
    for exponent in islice(algebra.readings(expr.args[1]), _WAYS):
        match exponent:
            case Op(op="div", args=(one, size)) if algebra.number(one) == 1.0:
                return size
    return None


def _called_with(kind: str, group: Sequence[Candidate]) -> tuple[Probability, ...]:
    reads = (_READERS[kind](one) for one in group if one.call is not None)
    return tuple(read.probability for read in islice(reads, _WAYS) if read is not None)


def probability_of(candidate: Candidate) -> Probability | None:
    """Say which probability one candidate assumes, seen the way it is."""
    read = _READERS[candidate.kind](candidate)
    return None if read is None else read.probability


_READERS = {"quotient": _quotient, "test": _test, "inverse": _inverse}


def _without_repeats(sites: list[Site]) -> list[Site]:
    """Keep the inner one where one stands inside another: ``log(a)/log(b)`` in ``.../2``."""
    sites = sorted(sites, key=lambda site: site.span)
    return [
        site
        for site in sites
        if not any(other.span != site.span and _inside(other.span, site.span) for other in sites)
    ]


def _inside(inner: Span, outer: Span) -> bool:
    return (inner.line, inner.column) >= (outer.line, outer.column) and (
        inner.end_line,
        inner.end_column,
    ) <= (outer.end_line, outer.end_column)
