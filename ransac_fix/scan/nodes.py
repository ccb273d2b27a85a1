"""The nodes of resolved expressions, and what each of them contains.

Every resolved node is made here, so that two things are known of it at once: whether there is a
logarithm or a power in it, and whether it may hold a rule. The number of nodes and their depth are
bounded.
"""

from collections.abc import Callable, Iterable, Mapping

from ransac_fix.scan import functions
from ransac_fix.scan.form import (
    Choice,
    Expr,
    Fn,
    Item,
    Name,
    Num,
    Op,
    Over,
    Ref,
    Seq,
    Span,
    Unknown,
)
from ransac_fix.scan.shapes import is_power, is_zero, says_log, unwrap

# What a resolved expression contains.
LOG = 1  # a logarithm
POW = 2  # a power or product
NESTED = 4  # a power of an expression with a power in it
COMPARISONS = frozenset(("<", "<=", ">", ">="))

MAX_CHOICES = 6
_MAX_DEPTH = 80
_MAX_NODES = 400_000
_MAX_ENTRIES = 4


class TooComplex(Exception):  # noqa: N818 -- not an error of anybody's
    """The file produces more expressions than any hand-written one."""


class Nodes:
    """The resolved nodes of one file.

    Parameters
    ----------
    found : callable
        Called with the kind and the node of each place that may hold a rule, as it is made:
        ``quotient``, ``test`` or ``inverse``.
    """

    def __init__(self, found: Callable[[str, Expr], None]) -> None:
        self._found = found
        self._facts: dict[int, tuple[int, int]] = {}
        self._keep: list[Expr] = []
        self._imported: set[int] = set()
        self._loops = 0

    def loop(self) -> str:
        """Name a loop like no other."""
        self._loops += 1
        return str(self._loops)

    def new(self, expr: Expr, parts: Iterable[Expr], facts: int = 0) -> Expr:
        """Register a resolved node: its facts are those of its parts and its own."""
        depth = 0
        for part in parts:
            part_facts, part_depth = self._facts.get(id(part), (0, 0))
            facts |= part_facts
            depth = max(depth, part_depth)
        if depth >= _MAX_DEPTH:
            expr = Unknown((), expr.span)
            facts, depth = 0, 0
        self._facts[id(expr)] = (facts, depth + 1)
        self._keep.append(expr)
        if len(self._keep) > _MAX_NODES:
            raise TooComplex
        return expr

    def adopt(self, expr: Expr, source: Expr) -> None:
        """Register a node that was written anew out of what is in another."""
        if id(expr) not in self._facts:
            self.new(expr, (), self._facts.get(id(source), (0, 0))[0] & (POW | LOG))

    def symbol(self, name: str) -> Name:
        """Make a name that stands for nothing else, such as a parameter."""
        symbol = Name(name)
        self._facts[id(symbol)] = (LOG if says_log(name) else 0, 0)
        self._keep.append(symbol)
        return symbol

    def has(self, expr: Expr, fact: int) -> bool:
        """Whether a node contains one of some things: ``LOG``, ``POW``, ``NESTED``."""
        return bool(self._facts.get(id(expr), (0, 0))[0] & fact)

    def choice(self, values: Iterable[Expr], span: Span | None = None) -> Expr:
        """Make a value that is one of several; what says nothing is none of them."""
        options: list[Expr] = []
        for value in values:
            for option in value.options if isinstance(value, Choice) else (value,):
                nothing = isinstance(option, Unknown) and not option.parts
                if not nothing and not any(option is other for other in options):
                    options.append(option)
        if len(options) == 1:
            return options[0]
        if not options:
            return Unknown((), span)
        del options[MAX_CHOICES:]
        return self.new(Choice(tuple(options), span), options)

    def substitute(self, expr: Expr, values: Mapping[int, Expr], memo: dict[int, Expr]) -> Expr:
        """Put values in place of nodes, which are known by identity."""
        if id(expr) in values:
            return values[id(expr)]
        if id(expr) in memo:
            return memo[id(expr)]
        result = expr
        match expr:
            case Ref():
                value = self.substitute(expr.value, values, memo)
                if value is not expr.value:
                    result = self.new(Ref(expr.name, value, expr.span), (value,))
            case Op() | Fn():
                args = tuple(self.substitute(arg, values, memo) for arg in expr.args)
                if any(new is not old for new, old in zip(args, expr.args, strict=True)):
                    if isinstance(expr, Fn):
                        result = self.fn(expr.name, args, expr.span)
                    else:
                        result = self.op(expr.op, args, expr.span)
            case Choice():
                options = [self.substitute(one, values, memo) for one in expr.options]
                if any(new is not old for new, old in zip(options, expr.options, strict=True)):
                    result = self.choice(options, expr.span)
            case Over():
                body = self.substitute(expr.body, values, memo)
                count = expr.count and self.substitute(expr.count, values, memo)
                if body is not expr.body or count is not expr.count:
                    facts = POW if expr.kind == "prod" else 0
                    result = self.new(
                        Over(expr.kind, body, expr.loop, count, expr.span), (body,), facts
                    )
            case Seq():
                items = tuple(self.substitute(one, values, memo) for one in expr.items)
                if any(new is not old for new, old in zip(items, expr.items, strict=True)):
                    result = self.new(Seq(items, expr.span, expr.names), items)
            case Item():
                base = self.substitute(expr.base, values, memo)
                if base is not expr.base:
                    result = self.item(base, expr.index, expr.span)
            case _:
                pass
        memo[id(expr)] = result
        return result

    def item(self, base: Expr, index: Expr, span: Span | None) -> Expr:
        """Make an entry or a member; what it is, where that is written out."""
        inner = base
        while isinstance(inner, Ref):
            inner = inner.value
        if isinstance(index, Num) and float(index.value).is_integer():
            entry = self.entry(base, int(index.value))
            if entry is not None:
                return entry
        elif isinstance(index, Ref | Name):
            member = self.member(base, index.name)
            if member is not None:
                return member
        if isinstance(inner, Choice) and isinstance(index, Num):
            parts = [self.item(option, index, span) for option in inner.options]
            if any(not isinstance(part, Item) for part in parts):
                return self.choice(parts, span)
        facts = 0 if isinstance(inner, Seq) else POW | LOG
        kept = self._facts.get(id(base), (0, 0))[0] & facts
        return self.new(Item(base, index, span), (), kept)

    def entry(self, base: Expr, number: int, depth: int = 0) -> Expr | None:
        """Give one entry of a sequence written out, or of what is made of one entry by entry."""
        inner = unwrap(base)
        match inner:
            case Seq(items=items, names=()) if -len(items) <= number < len(items):
                return items[number]
            case Fn(name="log" | "exp", args=(whole,)) if depth < _MAX_ENTRIES:
                entry = self.entry(whole, number, depth + 1)
                return None if entry is None else self.fn(inner.name, (entry,), inner.span)
            case Op(op="sub" | "div" | "pow", args=args) if depth < _MAX_ENTRIES:
                # Not what joins or repeats a list: `[a] + [b]`, `[w] * k`.
                entries = [self.entry(arg, number, depth + 1) for arg in args]
                if any(entry is not None for entry in entries):
                    parts = (
                        arg if entry is None else entry
                        for arg, entry in zip(args, entries, strict=True)
                    )
                    return self.op(inner.op, tuple(parts), inner.span)
        return None

    def member(self, base: Expr, name: str) -> Expr | None:
        """Give what a record holds under a name."""
        inner = unwrap(base)
        if isinstance(inner, Choice):
            found = [self.member(option, name) for option in inner.options]
            known = [one for one in found if one is not None]
            return self.choice(known) if known else None
        if isinstance(inner, Seq) and name in inner.names:
            return inner.items[inner.names.index(name)]
        return None

    def op(self, operator: str, args: tuple[Expr, ...], span: Span | None) -> Expr:
        """Make an operation."""
        facts = POW if operator in ("pow", "mul") else 0
        if operator == "pow" and (
            self.has(args[0], POW) or (self.has(args[1], LOG) and self.has(args[1], POW))
        ):
            facts |= NESTED  # (1 - w**k) ** N, 10 ** (N * log10(1 - w**k))
        expr = self.new(Op(operator, args, span), args, facts)
        if operator in ("div", "floordiv"):
            if self.has(args[1], LOG) and (self.has(args[0], LOG) or self.has(args[1], POW)):
                self._found("quotient", expr)
        elif operator in COMPARISONS:
            logs = [self.has(arg, LOG) or is_zero(arg) for arg in args]
            if self.has(expr, NESTED) or (all(logs) and self.has(expr, LOG)):
                self._found("test", expr)
        elif operator == "mul":
            if self.has(args[0], LOG) and self.has(args[1], LOG):
                self._found("quotient", expr)
            if any(self.has(arg, NESTED) and is_power(arg) for arg in args):
                self._found("inverse", expr)
        return expr

    def fn(self, name: str, args: tuple[Expr, ...], span: Span | None) -> Expr:
        """Make a call of a known function."""
        facts = 0
        if name == "log":
            facts = LOG
        elif name in ("exp", "comb", "factorial", "gamma", "hypergeom"):
            facts = POW
            if name == "exp" and self.has(args[0], LOG) and self.has(args[0], POW):
                facts |= NESTED  # exp(N * log(1 - w**k))
        return self.new(Fn(name, args, span), args, facts)

    def module(self, name: str) -> Name:
        """Make the name of a module, or of a member of one."""
        module = Name(name)
        self._imported.add(id(module))
        self._keep.append(module)
        return module

    def is_imported(self, name: Name) -> bool:
        """Whether a name is what an import has bound."""
        return id(name) in self._imported

    def is_module(self, base: Expr) -> bool:
        """Whether an expression is a module, imported or by a name that modules have."""
        if not isinstance(base, Name):
            return False
        return id(base) in self._imported or base.name in functions.MODULES
