"""What calls of known functions stand for, whatever library they are of.

The functions and their spellings are those of ``functions``; here their calls become nodes.
"""

from collections.abc import Callable, Mapping
from typing import TypeAlias

from ransac_fix.scan import functions
from ransac_fix.scan.form import (
    Expr,
    Fn,
    Index,
    Lambda,
    Name,
    Num,
    Over,
    Seq,
    Span,
    Unknown,
)
from ransac_fix.scan.loops import accumulated, arange_count, range_count, repeated, running, runs_of
from ransac_fix.scan.nodes import LOG, MAX_CHOICES, NESTED, POW, Nodes
from ransac_fix.scan.shapes import multiplies, says_log, unwrap

Apply: TypeAlias = Callable[[Expr, tuple[Expr, ...], Span | None], Expr | None]


class KnownCalls:
    """Writes calls of known functions as what they compute.

    Parameters
    ----------
    nodes : Nodes
    apply : callable
        Gives what a function that is a value makes of arguments, where the file says what it does:
        of a lambda, or of a function of the file. None for anything else.
    """

    def __init__(self, nodes: Nodes, apply: Apply) -> None:
        self._nodes = nodes
        self._apply = apply

    def read(
        self,
        name: str,
        base: Expr | None,
        args: tuple[Expr, ...],
        keywords: tuple[tuple[str, Expr], ...],
        span: Span | None,
    ) -> Expr:
        """Write a call to a known function one way, whatever library it is from."""
        name = functions.not_in_place(name)
        module = base is None or self._nodes.is_module(base)
        kind = functions.UNARY.get(name) or functions.BINARY.get(name)
        if kind in functions.MATHEMATICS and len(args) == 1 + (name in functions.BINARY):
            module = True  # whatever it is of, a method would have one argument less
        if name == "LogX" and len(args) == 2:
            module = True
        named = dict(keywords)
        # The operand comes first: the receiver of a method, or the first argument.
        operands = args if module or base is None else (base, *args)
        if not operands and keywords:
            operands = tuple(value for _, value in keywords)

        if name in functions.SELECTS and len(operands) == 3:
            if not module:  # x.where(condition, other)
                return self._nodes.choice((operands[0], operands[2]), span)
            return self._nodes.choice(operands[1:], span)
        if name in functions.CLAMPS and len(operands) + len(named) >= 2:
            bounds = (value for key, value in keywords if not _is_axis(key))
            return self._nodes.fn("clamp", (*operands, *bounds), span)
        if name in functions.CLAMPS and len(operands) == 1:
            inner = unwrap(operands[0])
            if isinstance(inner, Seq):  # max([x, low])
                return self._nodes.fn("clamp", inner.items, span)
            return self._nodes.fn("same", operands, span)
        if name in functions.ONES:
            return Num(1.0, span)
        if name in functions.ZEROS:
            return Num(0.0, span)
        if name in functions.FULLS and len(operands) >= 2:
            return operands[1]
        if name in functions.RANGES and operands:
            count = arange_count(operands)
            # One running index for all: arrays of a product run together.
            return self._nodes.new(Index(name, "arange", count, span), ())
        if name in functions.RECORDS and keywords and not args:
            items = tuple(value for _, value in keywords)
            return self._nodes.new(Seq(items, span, tuple(word for word, _ in keywords)), items)
        if name == "map" and len(operands) == 2:
            return self._mapped(operands[0], operands[1], span)
        if name in functions.PRODUCTS and operands:
            return self._product(operands[0], span)
        if name == "reduce" and len(operands) >= 2 and multiplies(operands[0]):
            return self._product(operands[1], span)
        if name == "reduce" and len(operands) >= 2:
            return self._reduced(operands, span)
        if name == "reduce" and base is not None and multiplies(base):
            return self._product(args[0], span) if args else Unknown((), span)
        if name in functions.SUMS and operands:
            over = unwrap(operands[0])
            if isinstance(over, Over):
                return self._nodes.new(
                    Over("sum", over.body, over.loop, over.count, span), (over.body,)
                )
            if self._nodes.has(operands[0], LOG):
                loop, count = runs_of(operands[0])
                return self._nodes.new(Over("sum", operands[0], loop, count, span), operands[:1])
        # numpy's logarithm of x to the base n, and Unreal's
        if name in ("logn", "LogX") and len(operands) == 2:
            logs = tuple(self._nodes.fn("log", (one,), span) for one in operands[::-1])
            return self._nodes.op("div", logs, span)
        if name in functions.UNARY and operands:
            return self._unary(functions.UNARY[name], name, operands, module=module, span=span)
        own = functions.own_logarithm(name)
        if own is not None and len(operands) == 1:
            return self._unary(own, name, operands, module=module, span=span)
        if name in functions.BINARY and len(operands) >= 2:
            return self._binary(functions.BINARY[name], operands[:2], span)
        if name in functions.COMPARISONS and len(operands) >= 2:
            return self._nodes.op(functions.COMPARISONS[name], operands[:2], span)
        if len(operands) == 2 and functions.is_power(name):
            return self._nodes.op("pow", operands, span)
        fixed = functions.fixed_power(name)
        if fixed is not None and len(operands) == 1:
            return self._nodes.op("pow", (operands[0], Num(fixed)), span)
        if name in ("pmf", "sf", "cdf", "logpmf") and _is_hypergeom(base):
            return self._nodes.fn("hypergeom", operands, span)
        if name in functions.DISTRIBUTED and base is not None:
            distributed = self._distributed(name, base, args, named, span)
            if distributed is not None:
                return distributed
        if name in functions.COUNTS:
            return self._nodes.fn("count", operands, span)
        everything = (*operands, *(value for _, value in keywords))
        facts = LOG if says_log(name) and not _is_logging(base) else 0
        return self._nodes.new(Fn(f"?{name}", everything, span), (), facts)

    def _unary(
        self, kind: str, name: str, operands: tuple[Expr, ...], *, module: bool, span: Span | None
    ) -> Expr:
        value = operands[0]
        if kind == "log":
            if name == "log" and module and len(operands) == 2:
                # math.log(x, base) is a quotient of logarithms
                top = self._nodes.fn("log", (value,), span)
                bottom = self._nodes.fn("log", (operands[1],), span)
                return self._nodes.op("div", (top, bottom), span)
            return self._nodes.fn("log", (value,), span)
        if kind == "log1p":
            one = self._nodes.op("add", (Num(1.0), value), span)
            return self._nodes.fn("log", (one,), span)
        if kind == "expm1":
            return self._nodes.op("sub", (self._nodes.fn("exp", (value,), span), Num(1.0)), span)
        if kind == "square":
            return self._nodes.op("pow", (value, Num(2.0)), span)
        if kind == "sqrt":
            return self._nodes.op("pow", (value, Num(0.5)), span)
        if kind == "reciprocal":
            return self._nodes.op("div", (Num(1.0), value), span)
        if kind == "neg":
            return self._nodes.op("neg", (value,), span)
        return self._nodes.fn(kind, (value,), span)

    def _binary(self, kind: str, operands: tuple[Expr, ...], span: Span | None) -> Expr:
        if kind == "comb":
            return self._nodes.fn("comb", operands, span)
        if kind == "rsub":
            return self._nodes.op("sub", operands[::-1], span)
        return self._nodes.op(kind, operands, span)

    def _distributed(
        self,
        name: str,
        base: Expr,
        args: tuple[Expr, ...],
        named: Mapping[str, Expr],
        span: Span | None,
    ) -> Expr | None:
        """Write out what a distribution says of the first success, or of none in N trials."""
        distribution = unwrap(base)
        parameters: tuple[Expr, ...] = args[1:]
        if isinstance(distribution, Fn):  # geom(p).ppf(q)
            parameters, kind = distribution.args, distribution.name.lstrip("?")
        elif isinstance(distribution, Name):
            kind = distribution.name.rpartition(".")[2]
        else:
            return None
        parameters = (*parameters, *(named[word] for word in ("n", "p") if word in named))
        if not args or not parameters:
            return None
        one, failure = Num(1.0), self._nodes.op("sub", (Num(1.0), parameters[-1]), span)
        trials = args[0]
        if kind in ("binom", "comb") and len(parameters) == 2:
            if not (isinstance(trials, Num) and trials.value == 0.0):
                return None
            trials = parameters[0]
            name = {"pmf": "sf", "cdf": "sf", "sf": "cdf"}.get(name, "")
        elif kind != "geom" or len(parameters) != 1:
            return None
        if name in ("ppf", "isf"):
            miss = self._nodes.op("sub", (one, trials), span) if name == "ppf" else trials
            logs = tuple(self._nodes.fn("log", (value,), span) for value in (miss, failure))
            return self._nodes.op("div", logs, span)
        missed = self._nodes.op("pow", (failure, trials), span)
        if name == "sf":
            return missed
        return self._nodes.op("sub", (one, missed), span) if name == "cdf" else None

    def _reduced(self, operands: tuple[Expr, ...], span: Span | None) -> Expr:
        """Read ``reduce(f, values, start)`` as the loop that it is."""
        function, source = unwrap(operands[0]), operands[1]
        start = operands[2] if len(operands) > 2 else Num(1.0)
        if isinstance(function, Lambda) and len(function.function.parameters) == 2:
            loop = self._nodes.loop()
            count = range_count(source)
            symbol = Name(function.function.parameters[0].name)
            taken = function.function.parameters[1].name
            one = running(self._nodes, (taken,), source, loop, count)[taken]
            value = self._apply(function, (symbol, one), span)
            if value is not None:
                total = accumulated(self._nodes, start, symbol, value, loop, count)
                if total is not None:
                    return total
        return self._nodes.new(Fn("?reduce", operands, span), operands)

    def _mapped(self, function: Expr, source: Expr, span: Span | None) -> Expr:
        """Read ``map(f, (a, b))`` as ``(f(a), f(b))``."""
        items = unwrap(source)
        if not isinstance(items, Seq) or len(items.items) > MAX_CHOICES:
            return self._nodes.new(Fn("?map", (function, source), span), (function, source))
        made = tuple(self._applied(function, (one,), span) for one in items.items)
        return self._nodes.new(Seq(made, span), made)

    def _applied(self, function: Expr, args: tuple[Expr, ...], span: Span | None) -> Expr:
        """Give what a function that is a value makes of its arguments."""
        own = self._apply(function, args, span)
        if own is not None:
            return own
        inner = unwrap(function)
        if isinstance(inner, Name):
            module, _, name = inner.name.rpartition(".")
            base = self._nodes.module(module) if module else None
            return self.read(name, base, args, (), span)
        return self._nodes.new(Fn("?", args, span), args)

    def _product(self, operand: Expr, span: Span | None) -> Expr:
        inner = unwrap(operand)
        if isinstance(inner, Seq) and inner.items:
            result = inner.items[0]
            for item in inner.items[1:]:
                result = self._nodes.op("mul", (result, item), span)
            return result
        body: Expr
        count: Expr | None
        alike = repeated(inner)
        if alike is not None:
            (body, count), loop = alike, ""
        elif isinstance(inner, Over):
            body, loop, count = inner.body, inner.loop, inner.count
        else:
            body = operand
            loop, count = runs_of(operand)
        facts = POW | NESTED if self._nodes.has(body, POW) else POW
        return self._nodes.new(Over("prod", body, loop, count, span), (body,), facts)


def _is_hypergeom(base: Expr | None) -> bool:
    base = unwrap(base) if base is not None else None
    if isinstance(base, Name):
        return base.name.rpartition(".")[2] == "hypergeom"
    return isinstance(base, Fn) and base.name == "?hypergeom"


def _is_axis(keyword: str) -> bool:
    return keyword in ("axis", "dim", "keepdim", "keepdims", "out", "key", "default", "dtype")


def _is_logging(base: Expr | None) -> bool:
    base = unwrap(base) if base is not None else None
    return isinstance(base, Name) and "log" in base.name.lower()
