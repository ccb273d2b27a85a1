"""Follow definitions: from the small form to resolved expressions, and the candidates in them.

The walker runs over each body once for its definitions and once to record, carrying for every
name the expression it stands for. Where paths join, a name stands for one of several
(:class:`~ransac_fix.scan.form.Choice`); a loop that multiplies a name in every run makes it a
product (:class:`~ransac_fix.scan.form.Over`). Calls to functions of the same file are replaced by
what they return. All this is bounded: by depth, by the number of choices, and by the number of
nodes one file may produce.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from ransac_fix.scan import functions
from ransac_fix.scan.form import (
    Assign,
    Call,
    Choice,
    Class,
    Each,
    Evaluate,
    Expr,
    Fn,
    Function,
    If,
    Import,
    Index,
    Item,
    Lambda,
    Leave,
    Loop,
    Module,
    Name,
    Num,
    Op,
    Over,
    Ref,
    Seq,
    Span,
    Stmt,
    Unknown,
)
from ransac_fix.scan.walk import functions as functions_of

Env = dict[str, Expr]

# What a resolved expression contains.
LOG = 1  # a logarithm
POW = 2  # a power or product
NESTED = 4  # a power of an expression with a power in it
COMPARISONS = frozenset(("<", "<=", ">", ">="))

_MAX_DEPTH = 80
_MAX_CHOICES = 6
_MAX_INLINE = 4
_MAX_CALLS = 12  # functions that are walked one from within the other
_MAX_NODES = 400_000


class TooComplex(Exception):  # noqa: N818 -- not an error of anybody's
    """The file produces more expressions than any hand-written one."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A place that may hold a rule.

    Attributes
    ----------
    kind : {"quotient", "test", "inverse"}
        A division with logarithms on both sides, a comparison with a power of powers in it, or
        a number of data times a power of powers.
    expr : Expr
        The resolved expression.
    function : Function or None
        The function it stands in; None at module level.
    loops : int
        How many loops it stands in.
    target : str or None
        The name its statement assigns to.
    call : Span or None
        For a candidate seen through a call: where the call stands.
    """

    kind: str
    expr: Expr
    function: Function | None
    loops: int
    target: str | None
    call: Span | None = None


@dataclass(slots=True)
class _Scope:
    """One body being walked."""

    function: Function | None
    owner: str | None
    returns: list[Expr] = field(default_factory=list)
    exits: list[list[Env]] = field(default_factory=list)
    ends: list[Env] | None = None  # what names are where it returns, if that is asked for


@dataclass(frozen=True, slots=True, eq=False)
class _Summary:
    """What a function returns, and what it makes of its parameters by reference."""

    value: Expr
    changed: Mapping[str, Expr]
    parameters: Mapping[str, Name]
    order: tuple[str, ...]
    defaults: Mapping[str, Expr]


def candidates(module: Module) -> list[Candidate]:
    """Find every place of a file that may hold a rule, resolved."""
    return _Evaluator(module).run()


class _Evaluator:
    def __init__(self, module: Module) -> None:
        self._module = module
        self._facts: dict[int, tuple[int, int]] = {}
        self._keep: list[Expr] = []
        self._functions: dict[str, list[Function]] = {}
        self._summaries: dict[int, _Summary | None] = {}
        self._closures: dict[int, Env] = {}
        self._attributes: dict[tuple[str, str], list[Expr]] = {}
        self._globals: Env = {}
        self._found: list[Candidate] = []
        self._imported: set[int] = set()
        self._recording = False
        self._second = False
        self._scope = _Scope(None, None)
        self._loops = 0
        self._loop_number = 0
        self._target: str | None = None
        self._call: Span | None = None
        self._inlining = 0
        self._calls = 0
        for function in functions_of(module.body):
            self._functions.setdefault(function.name, []).append(function)

    def run(self) -> list[Candidate]:
        # First, in silence: the names of the module, and the attributes that its classes set.
        env: Env = {}
        self._block(self._module.body, env)
        self._globals = env
        everything = list(functions_of(self._module.body))
        for function in everything:
            members = function.owner and any("." in name for name in _assigned(function.body))
            if members or any(name.startswith("global.") for name in _assigned(function.body)):
                self._walk_function(function)
        # Then every body once more, with those known; a function that is called is walked when
        # it is first called.
        self._summaries.clear()
        self._recording = self._second = True
        self._block(self._module.body, {})
        for function in everything:
            self._summary(function)
        return self._found

    # ---- bookkeeping ----------------------------------------------------------------------

    def _new(self, expr: Expr, parts: Iterable[Expr], facts: int = 0) -> Expr:
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

    def _has(self, expr: Expr, fact: int) -> bool:
        return bool(self._facts.get(id(expr), (0, 0))[0] & fact)

    def _candidate(self, kind: str, expr: Expr) -> None:
        if self._recording:
            self._found.append(
                Candidate(kind, expr, self._scope.function, self._loops, self._target, self._call)
            )

    # ---- statements -----------------------------------------------------------------------

    def _block(self, body: tuple[Stmt, ...], env: Env) -> bool:
        """Walk statements, changing ``env``; False when control never reaches the end."""
        return all(self._statement(stmt, env) for stmt in body)

    def _statement(self, stmt: Stmt, env: Env) -> bool:
        match stmt:
            case Assign():
                self._target = stmt.target
                value = self._expr(stmt.value, env)
                if stmt.target is not None:
                    self._bind(stmt.target, value, env)
                self._target = None
            case Evaluate():
                self._changed_by_call(stmt.value, self._expr(stmt.value, env), env)
            case If():
                return self._if(stmt, env)
            case Loop():
                self._loop(stmt, env)
            case Leave():
                if stmt.value is not None:
                    value = self._expr(stmt.value, env)
                    self._scope.returns.append(value)
                if stmt.kind in ("break", "continue") and self._scope.exits:
                    self._scope.exits[-1].append(dict(env))
                elif stmt.kind == "return" and self._scope.ends is not None:
                    self._scope.ends.append(dict(env))
                return False
            case Import():
                env[stmt.name] = self._module_named(stmt.target)
            case Function():
                self._closures[id(stmt)] = env
            case Class():
                inner = dict(env)
                self._block(stmt.body, inner)
                for name, value in inner.items():
                    if env.get(name) is not value and isinstance(value, Ref):
                        self._attribute(stmt.name, name, value)
        return True

    def _changed_by_call(self, call: Expr, value: Expr, env: Env) -> None:
        """Follow what a call changes: ``x.log_()``, ``np.log(x, out=y)``, ``x.append(y)``."""
        if not isinstance(call, Call):
            return
        for word, target in call.keywords:
            if word == "out" and isinstance(target, Name):
                self._bind(target.name, value, env)
        if isinstance(call.base, Name) and call.name.endswith("_"):
            self._bind(call.base.name, value, env)
        elif isinstance(call.base, Name) and call.name == "append" and len(call.args) == 1:
            before = _unwrap(env.get(call.base.name, Unknown()))
            if isinstance(before, Seq) and not before.names and not self._loops:
                items = (*before.items, self._quiet(call.args[0], env))
                self._bind(call.base.name, self._new(Seq(items, before.span), items), env)

    def _bind(self, target: str, value: Expr, env: Env) -> None:
        env[target] = value
        if isinstance(value, Seq) and value.names:
            for name in value.names:
                env.pop(f"{target}.{name}", None)  # what an earlier record held
        head, _, tail = target.partition(".")
        if tail and head in ("self", "cls", "this") and self._scope.owner:
            self._attribute(self._scope.owner, tail, value)
        elif tail and head == "global":
            self._attribute(head, tail, value)

    def _settle(self, end: Env) -> None:
        """Keep the products that a method has made of members by its end."""
        for name, value in end.items():
            head, _, tail = name.partition(".")
            made = isinstance(_unwrap(value), Op) and self._has(value, POW)
            if tail and made and head in ("self", "this", "global"):
                self._bind(name, value, {})

    def _attribute(self, owner: str, name: str, value: Expr) -> None:
        if self._second:
            return  # the first walk has seen them all
        known = self._attributes.setdefault((owner, name), [])
        if len(known) < _MAX_CHOICES and not any(value is one for one in known):
            known.append(value)

    def _if(self, stmt: If, env: Env) -> bool:
        self._expr(stmt.test, env)
        then, other = dict(env), dict(env)
        then_ends = self._block(stmt.body, then)
        other_ends = self._block(stmt.orelse, other)
        ends = [one for one, reached in ((then, then_ends), (other, other_ends)) if reached]
        if ends:
            self._join(ends, env)
        return bool(ends)

    def _join(self, ends: list[Env], env: Env) -> None:
        if len(ends) == 1:
            joined = ends[0]
        else:
            joined = dict(ends[0])
            for one in ends[1:]:
                for name, value in one.items():
                    known = joined.get(name)
                    if known is None:
                        joined[name] = value
                    elif known is not value:
                        joined[name] = self._choice((known, value))
        env.clear()
        env.update(joined)

    def _choice(self, values: Iterable[Expr], span: Span | None = None) -> Expr:
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
        del options[_MAX_CHOICES:]
        return self._new(Choice(tuple(options), span), options)

    def _loop(self, stmt: Loop, env: Env) -> None:
        self._loop_number += 1
        loop = str(self._loop_number)
        count: Expr | None = None
        counters = _counters(stmt.body)
        start = dict(env)
        if stmt.source is not None:
            source = self._expr(stmt.source, env)
            count = _range_count(source)
            start.update(self._running(stmt.variables, source, loop, count))
        carried: dict[str, Expr] = {}
        for name in _assigned(stmt.body):
            if name in counters:
                carried[name] = self._new(Index(name, loop, count), ())
            else:
                carried[name] = Name(name)
        if stmt.test is not None and count is None:
            count = _test_count(stmt.test, counters, lambda expr: self._quiet(expr, env))

        # One run in silence, to see what the loop does to each name.
        recording, self._recording = self._recording, False
        end = self._run_body(stmt, {**start, **carried})
        self._recording = recording

        # What each name is at the start of any run, and after the loop.
        steady, after = dict(start), dict(env)
        for name, symbol in carried.items():
            before = env.get(name)
            value = end.get(name)
            if value is None:
                continue
            if name in counters:
                steady[name] = symbol
                after[name] = Name(name)
                continue
            total = self._accumulated(before, symbol, value, loop, count)
            both = self._choice([one for one in (before, value) if one is not None])
            after[name] = both if total is None else total
            if total is not None and count is not None:
                # In the loop there have not been all runs yet, and a break may end them.
                total = self._accumulated(before, symbol, value, loop, None)
            steady[name] = both if total is None else total
        if recording or stmt.test is not None:
            if stmt.test is not None:
                self._loops += 1
                self._expr(stmt.test, dict(steady))
                self._loops -= 1
            if recording:
                end = self._run_body(stmt, dict(steady))
        for name, value in end.items():
            if name not in after and name not in stmt.variables:
                after[name] = value
        env.clear()
        env.update(after)

    def _run_body(self, stmt: Loop, env: Env) -> Env:
        self._loops += 1
        self._scope.exits.append([])
        ends = [env] if self._block(stmt.body, env) else []
        ends += self._scope.exits.pop()
        self._loops -= 1
        joined: Env = {}
        self._join(ends[:_MAX_CHOICES] or [env], joined)
        return joined

    def _quiet(self, expr: Expr, env: Env) -> Expr:
        recording, self._recording = self._recording, False
        value = self._expr(expr, env)
        self._recording = recording
        return value

    def _accumulated(
        self, before: Expr | None, symbol: Expr, value: Expr, loop: str, count: Expr | None
    ) -> Expr | None:
        """Give the product or sum a name has become, if the loop builds one."""
        if before is None:
            return None
        factors = _peel(value, symbol)
        if factors is None:
            return None
        kind, body = factors
        # One factor may itself be conditional; what counts is that it is multiplied in each run.
        term: Expr
        if kind == "prod":
            term = body[0][1] if len(body) == 1 and body[0][0] == "mul" else Num(1.0)
            if id(term) not in self._facts:  # as _peel writes it
                self._new(term, (), self._facts.get(id(value), (0, 0))[0] & (POW | LOG))
            if len(body) != 1 or body[0][0] != "mul":
                for operator, factor in body:
                    term = self._new(Op(operator, (term, factor)), (term, factor), POW)
            nested = NESTED if self._has(term, POW) else 0
            over = self._new(Over("prod", term, loop, count), (term,), POW | nested)
            return self._new(Op("mul", (before, over)), (before, over))
        term = Num(0.0)
        for operator, part in body:
            term = self._new(Op(operator, (term, part)), (term, part))
        over = self._new(Over("sum", term, loop, count), (term,))
        return self._new(Op("add", (before, over)), (before, over))

    # ---- functions ------------------------------------------------------------------------

    def _walk_function(self, function: Function) -> tuple[list[Expr], dict[str, Name], list[Env]]:
        env = dict(self._closures.get(id(function), self._globals))
        for name, value in self._globals.items():
            env.setdefault(name, value)
        parameters = {one.name: Name(one.name) for one in function.parameters}
        for name, symbol in parameters.items():
            self._facts[id(symbol)] = (LOG if _says_log(name) else 0, 0)
            self._keep.append(symbol)
        env.update(parameters)
        outer = self._scope, self._loops, self._target, self._call
        self._scope = _Scope(function, function.owner)
        if any(one.by_reference for one in function.parameters):
            self._scope.ends = []
        self._loops, self._target, self._call = 0, None, None
        ends = [env] if self._block(function.body, env) else []
        returns = self._scope.returns
        for end in ends:
            self._settle(end)
        ends += self._scope.ends or []
        self._scope, self._loops, self._target, self._call = outer
        return returns, parameters, ends

    def _summary(self, function: Function) -> _Summary | None:
        """Say what a function returns, in its parameters; None when that says nothing."""
        if id(function) in self._summaries:
            return self._summaries[id(function)]
        if self._calls >= _MAX_CALLS:
            return None  # it is walked later, by itself
        self._calls += 1
        self._summaries[id(function)] = None  # a recursive function has no summary
        recording = self._recording
        # In the second walk this records, even where the call that led here does not.
        self._recording = recording or self._second
        returns, parameters, ends = self._walk_function(function)
        self._calls -= 1
        defaults = {
            one.name: self._expr(one.default, dict(self._globals))
            for one in function.parameters
            if one.default is not None
        }
        self._recording = recording
        value = self._choice(returns)
        value = self._unrolled(function, value) or value
        references = tuple(one.name for one in function.parameters if one.by_reference)
        paths = {name for env in ends for name in env if name.partition(".")[0] in references}
        changed = {
            name: self._choice([env[name] for env in ends if name in env])
            for name in sorted(paths if references else ())
        }
        changed = {name: one for name, one in changed.items() if self._has(one, LOG | POW)}
        summary = None
        worth = self._has(value, LOG | POW) or _is_complement(value)
        if changed or worth or _selects(value, parameters):
            order = tuple(one.name for one in function.parameters)
            if function.owner and order and order[0] in ("self", "cls"):
                order = order[1:]
            summary = _Summary(value, changed, parameters, order, defaults)
        self._summaries[id(function)] = summary
        return summary

    def _unrolled(self, function: Function, value: Expr) -> Expr | None:
        """Give the product that a function is which returns a factor times itself for one less."""
        options = value.options if isinstance(value, Choice) else (value,)
        ends: list[Expr] = []
        factors: list[tuple[str, Expr]] = []
        arguments: tuple[Expr, ...] = ()
        for option in options:
            own = _call_within(option, f"?{function.name}")
            peeled = None if own is None else _peel(option, own)
            if own is None:
                ends.append(option)
            elif peeled is None or peeled[0] != "prod" or factors:
                return None
            else:
                factors, arguments = peeled[1], own.args
        names = [one.name for one in function.parameters]
        if not factors or not ends or len(arguments) != len(names):
            return None
        self._loop_number += 1
        loop = str(self._loop_number)
        counters: list[Expr] = []
        values: dict[int, Expr] = {}
        for name, argument in zip(names, arguments, strict=True):
            match _unwrap(argument):
                case Name(name=same) if same == name:
                    pass
                case Op(op="sub", args=(before, Num(value=1.0))):
                    symbol = _unwrap(before)
                    if not (isinstance(symbol, Name) and symbol.name == name):
                        return None
                    counters.append(symbol)
                    index = self._new(Index(name, loop), ())
                    values[id(symbol)] = self._op("sub", (symbol, index), None)
                case _:
                    return None
        if not counters:
            return None
        term: Expr = Num(1.0)
        for operator, factor in factors:
            term = self._op(operator, (term, self._substitute(factor, values, {})), None)
        over = self._new(Over("prod", term, loop, counters[-1]), (term,), POW)
        return self._op("mul", (self._choice(ends), over), value.span)

    def _function_for(self, call: Call, base: Expr | None) -> Function | None:
        named = self._functions.get(call.name)
        if not named:
            return None
        if isinstance(base, Name) and base.name in functions.MODULES:
            return None
        if len(named) == 1:
            return named[0]
        # A method of its own class goes before a function, where it is called like one.
        owners = (self._scope.owner,) if base is not None else (self._scope.owner, None)
        for owner in owners:
            same = [one for one in named if one.owner == owner]
            if len(same) > 1:
                same = [one for one in same if len(one.parameters) == len(call.args)]
            if len(same) == 1:
                return same[0]
        return None

    def _inline(self, summary: _Summary, call: Call, arguments: "Arguments", env: Env) -> Expr:
        positional, keywords = arguments
        values: dict[int, Expr] = {}
        for name, value in zip(summary.order, positional, strict=False):
            values[id(summary.parameters[name])] = value
        for name, value in keywords:
            if name in summary.parameters:
                values[id(summary.parameters[name])] = value
        for name, value in summary.defaults.items():
            values.setdefault(id(summary.parameters[name]), value)
        outer, self._call = self._call, call.span
        self._inlining += 1
        memo: dict[int, Expr] = {}
        result = self._substitute(summary.value, values, memo)
        for name, value in summary.changed.items():
            parameter, dot, member = name.partition(".")
            given = summary.order.index(parameter)
            target = call.args[given] if given < len(call.args) else None
            if isinstance(target, Name):
                made = self._substitute(value, values, memo)
                self._bind(f"{target.name}{dot}{member}", made, env)
        self._inlining -= 1
        self._call = outer
        return result

    def _substitute(self, expr: Expr, values: Mapping[int, Expr], memo: dict[int, Expr]) -> Expr:
        if id(expr) in values:
            return values[id(expr)]
        if id(expr) in memo:
            return memo[id(expr)]
        result = expr
        match expr:
            case Ref():
                value = self._substitute(expr.value, values, memo)
                if value is not expr.value:
                    result = self._new(Ref(expr.name, value, expr.span), (value,))
            case Op() | Fn():
                args = tuple(self._substitute(arg, values, memo) for arg in expr.args)
                if any(new is not old for new, old in zip(args, expr.args, strict=True)):
                    if isinstance(expr, Fn):
                        result = self._fn(expr.name, args, expr.span)
                    else:
                        result = self._op(expr.op, args, expr.span)
            case Choice():
                options = [self._substitute(one, values, memo) for one in expr.options]
                if any(new is not old for new, old in zip(options, expr.options, strict=True)):
                    result = self._choice(options, expr.span)
            case Over():
                body = self._substitute(expr.body, values, memo)
                count = expr.count and self._substitute(expr.count, values, memo)
                if body is not expr.body or count is not expr.count:
                    facts = POW if expr.kind == "prod" else 0
                    result = self._new(
                        Over(expr.kind, body, expr.loop, count, expr.span), (body,), facts
                    )
            case Seq():
                items = tuple(self._substitute(one, values, memo) for one in expr.items)
                if any(new is not old for new, old in zip(items, expr.items, strict=True)):
                    result = self._new(Seq(items, expr.span, expr.names), items)
            case Item():
                base = self._substitute(expr.base, values, memo)
                if base is not expr.base:
                    result = self._item(base, expr.index, expr.span)
            case _:
                pass
        memo[id(expr)] = result
        return result

    # ---- expressions ----------------------------------------------------------------------

    def _expr(self, expr: Expr, env: Env) -> Expr:
        match expr:
            case Num():
                return expr
            case Name():
                return self._name(expr, env)
            case Op():
                return self._op(
                    expr.op, tuple(self._expr(arg, env) for arg in expr.args), expr.span
                )
            case Call():
                return self._evaluate_call(expr, env)
            case Choice():
                if expr.test is not None:
                    self._expr(expr.test, env)
                return self._choice([self._expr(one, env) for one in expr.options], expr.span)
            case Item():
                base = self._expr(expr.base, env)
                return self._item(base, self._expr(expr.index, env), expr.span)
            case Seq():
                items = tuple(self._expr(one, env) for one in expr.items)
                return self._new(Seq(items, expr.span, expr.names), items)
            case Each():
                return self._each(expr, env)
            case Ref():  # name := value
                value = self._expr(expr.value, env)
                env[expr.name] = value
                return self._new(Ref(expr.name, value, expr.span), (value,))
            case Lambda():
                self._closures.setdefault(id(expr.function), env)
                inner = dict(env)
                for parameter in expr.function.parameters:
                    inner[parameter.name] = Name(parameter.name)
                outer, self._scope = self._scope, _Scope(self._scope.function, self._scope.owner)
                self._block(expr.function.body, inner)
                self._scope = outer
                return expr
            case Unknown():
                parts = tuple(self._expr(part, env) for part in expr.parts)
                # What an unknown operation does to a logarithm is unknown: its facts end here.
                return self._new(Unknown(parts, expr.span), ())
            case _:
                return expr

    def _name(self, expr: Name, env: Env) -> Expr:
        value = env.get(expr.name)
        if value is None:
            head, _, tail = expr.name.partition(".")
            if tail:
                value = self._dotted(head, tail, env)
                if value is None and head in ("this", "global"):
                    value = env.get(tail)  # in C++ a global is spelled like a member
                if value is None:
                    value = self._entry_named(expr.name, env)
        if isinstance(value, Name) and id(value) in self._imported:
            return value
        facts = LOG if _says_log(expr.name) else 0
        if value is None:
            return self._new(Name(expr.name, expr.span), (), facts)
        return self._new(Ref(expr.name, value, expr.span), (value,))

    def _dotted(self, head: str, tail: str, env: Env) -> Expr | None:
        if head in ("self", "cls", "this") and self._scope.owner:
            known = self._attributes.get((self._scope.owner, tail))
            if known:
                return self._choice(known)
            return self._property(tail) or self._inherited(tail)
        value = env.get(head)
        while isinstance(value, Ref):
            value = value.value
        if isinstance(value, Name) and id(value) in self._imported:
            return self._module_named(f"{value.name}.{tail}")
        known = self._attributes.get((head, tail))  # Class.constant
        return self._choice(known) if known else self._property(tail)

    def _inherited(self, name: str) -> Expr | None:
        """Give a member that one other class of the file sets, which may be the base."""
        found = [one for (owner, own), one in self._attributes.items() if own == name and owner]
        return self._choice(found[0]) if len(found) == 1 else None

    def _entry_named(self, path: str, env: Env) -> Expr | None:
        """Give what ``a.b`` is, where ``a`` is a record."""
        base, _, name = path.rpartition(".")
        value = env.get(base)
        head, _, tail = base.partition(".")
        if value is None and tail:
            value = self._dotted(head, tail, env)
        return None if value is None else self._member(value, name)

    def _property(self, name: str) -> Expr | None:
        """Give what a method without parameters returns, read like an attribute."""
        named = self._functions.get(name, ())
        for function in named:
            alone = [one.name for one in function.parameters] in (["self"], ["cls"])
            if alone and (function.owner == self._scope.owner or len(named) == 1):
                summary = self._summary(function)
                return None if summary is None else summary.value
        return None

    def _each(self, expr: Each, env: Env) -> Expr:
        source = self._expr(expr.source, env)
        written_out = _unwrap(source)
        if isinstance(written_out, Seq) and len(expr.variables) == 1:
            items = written_out.items
            if len(items) <= _MAX_CHOICES and not all(isinstance(one, Num) for one in items):
                bodies = tuple(
                    self._each_body(expr, {expr.variables[0]: one}, env) for one in items
                )
                return self._new(Seq(bodies, expr.span), bodies)
        self._loop_number += 1
        loop = str(self._loop_number)
        count = _range_count(source)
        body = self._each_body(expr, self._running(expr.variables, source, loop, count), env)
        return self._new(Over("each", body, loop, count, expr.span), (body,))

    def _each_body(self, expr: Each, variables: Env, env: Env) -> Expr:
        inner = {**env, **variables}
        for test in expr.tests:
            self._expr(test, inner)
        return self._expr(expr.body, inner)

    def _running(
        self, variables: tuple[str, ...], source: Expr, loop: str, count: Expr | None
    ) -> Env:
        """Say what the variables of a loop are: counters, or names of unknown values."""
        together = _unwrap(source)
        zipped = isinstance(together, Fn) and together.name == "?zip"
        bound: Env = {}
        for number, name in enumerate(variables):
            counted = number == 0 and _is_counted(source)
            if zipped and isinstance(together, Fn) and number < len(together.args):
                counted = _is_counted(together.args[number])
            bound[name] = self._new(Index(name, loop, count), ()) if counted else Name(name)
        return bound

    def _item(self, base: Expr, index: Expr, span: Span | None) -> Expr:
        inner = base
        while isinstance(inner, Ref):
            inner = inner.value
        if isinstance(index, Num) and float(index.value).is_integer():
            entry = self._entry(base, int(index.value))
            if entry is not None:
                return entry
        elif isinstance(index, Ref | Name):
            member = self._member(base, index.name)
            if member is not None:
                return member
        if isinstance(inner, Choice) and isinstance(index, Num):
            parts = [self._item(option, index, span) for option in inner.options]
            if any(not isinstance(part, Item) for part in parts):
                return self._choice(parts, span)
        facts = 0 if isinstance(inner, Seq) else POW | LOG
        kept = self._facts.get(id(base), (0, 0))[0] & facts
        return self._new(Item(base, index, span), (), kept)

    def _entry(self, base: Expr, number: int, depth: int = 0) -> Expr | None:
        """Give one entry of a sequence written out, or of what is made of one entry by entry."""
        inner = _unwrap(base)
        match inner:
            case Seq(items=items, names=()) if -len(items) <= number < len(items):
                return items[number]
            case Fn(name="log" | "exp", args=(whole,)) if depth < _MAX_INLINE:
                entry = self._entry(whole, number, depth + 1)
                return None if entry is None else self._fn(inner.name, (entry,), inner.span)
            case Op(op="sub" | "div" | "pow", args=args) if depth < _MAX_INLINE:
                # Not what joins or repeats a list: `[a] + [b]`, `[w] * k`.
                entries = [self._entry(arg, number, depth + 1) for arg in args]
                if any(entry is not None for entry in entries):
                    parts = (
                        arg if entry is None else entry
                        for arg, entry in zip(args, entries, strict=True)
                    )
                    return self._op(inner.op, tuple(parts), inner.span)
        return None

    def _member(self, base: Expr, name: str) -> Expr | None:
        """Give what a record holds under a name."""
        inner = _unwrap(base)
        if isinstance(inner, Choice):
            found = [self._member(option, name) for option in inner.options]
            known = [one for one in found if one is not None]
            return self._choice(known) if known else None
        if isinstance(inner, Seq) and name in inner.names:
            return inner.items[inner.names.index(name)]
        return None

    def _op(self, operator: str, args: tuple[Expr, ...], span: Span | None) -> Expr:
        facts = POW if operator in ("pow", "mul") else 0
        if operator == "pow" and (
            self._has(args[0], POW) or (self._has(args[1], LOG) and self._has(args[1], POW))
        ):
            facts |= NESTED  # (1 - w**k) ** N, 10 ** (N * log10(1 - w**k))
        expr = self._new(Op(operator, args, span), args, facts)
        if operator in ("div", "floordiv"):
            if self._has(args[1], LOG) and (self._has(args[0], LOG) or self._has(args[1], POW)):
                self._candidate("quotient", expr)
        elif operator in COMPARISONS:
            logs = [self._has(arg, LOG) or _is_zero(arg) for arg in args]
            if self._has(expr, NESTED) or (all(logs) and self._has(expr, LOG)):
                self._candidate("test", expr)
        elif operator == "mul":
            if self._has(args[0], LOG) and self._has(args[1], LOG):
                self._candidate("quotient", expr)
            if any(self._has(arg, NESTED) and _is_power(arg) for arg in args):
                self._candidate("inverse", expr)
        return expr

    def _fn(self, name: str, args: tuple[Expr, ...], span: Span | None) -> Expr:
        facts = 0
        if name == "log":
            facts = LOG
        elif name in ("exp", "comb", "factorial", "gamma", "hypergeom"):
            facts = POW
            if name == "exp" and self._has(args[0], LOG) and self._has(args[0], POW):
                facts |= NESTED  # exp(N * log(1 - w**k))
        return self._new(Fn(name, args, span), args, facts)

    def _evaluate_call(self, call: Call, env: Env) -> Expr:
        base = self._expr(call.base, env) if call.base is not None else None
        args = tuple(self._expr(arg, env) for arg in call.args)
        keywords = tuple((name, self._expr(value, env)) for name, value in call.keywords)
        function = self._function_for(call, base)
        if function is not None and self._inlining < _MAX_INLINE:
            summary = self._summary(function)
            if summary is not None:
                return self._inline(summary, call, (args, keywords), env)
        name = call.name
        if base is None:
            bound = env.get(name)
            while isinstance(bound, Ref):
                bound = bound.value
            if isinstance(bound, Lambda) and self._inlining < _MAX_INLINE:
                return self._apply(bound.function, args, keywords)
            if isinstance(bound, Name) and bound.name != name:
                module, _, name = bound.name.rpartition(".")
                base = self._module_named(module) if module else None
        return self._known(name, base, args, keywords, call.span)

    def _module_named(self, name: str) -> Name:
        module = Name(name)
        self._imported.add(id(module))
        self._keep.append(module)
        return module

    def _apply(
        self, function: Function, args: tuple[Expr, ...], keywords: tuple[tuple[str, Expr], ...]
    ) -> Expr:
        env = dict(self._closures.get(id(function), self._globals))
        for parameter in function.parameters:
            env[parameter.name] = Name(parameter.name)
        env.update(
            (parameter.name, value)
            for parameter, value in zip(function.parameters, args, strict=False)
        )
        env.update(keywords)
        self._inlining += 1
        value: Expr = Unknown()
        for stmt in function.body:
            if isinstance(stmt, Leave) and stmt.value is not None:
                value = self._expr(stmt.value, env)
        self._inlining -= 1
        return value

    def _is_module(self, base: Expr) -> bool:
        if not isinstance(base, Name):
            return False
        return id(base) in self._imported or base.name in functions.MODULES

    def _known(
        self,
        name: str,
        base: Expr | None,
        args: tuple[Expr, ...],
        keywords: tuple[tuple[str, Expr], ...],
        span: Span | None,
    ) -> Expr:
        """Write a call to a known function one way, whatever library it is from."""
        name = functions.not_in_place(name)
        module = base is None or self._is_module(base)
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
                return self._choice((operands[0], operands[2]), span)
            return self._choice(operands[1:], span)
        if name in functions.CLAMPS and len(operands) + len(named) >= 2:
            bounds = (value for key, value in keywords if not _is_axis(key))
            return self._fn("clamp", (*operands, *bounds), span)
        if name in functions.CLAMPS and len(operands) == 1:
            inner = _unwrap(operands[0])
            if isinstance(inner, Seq):  # max([x, low])
                return self._fn("clamp", inner.items, span)
            return self._fn("same", operands, span)
        if name in functions.ONES:
            return Num(1.0, span)
        if name in functions.ZEROS:
            return Num(0.0, span)
        if name in functions.FULLS and len(operands) >= 2:
            return operands[1]
        if name in functions.RANGES and operands:
            count = _arange_count(operands)
            # One running index for all: arrays of a product run together.
            return self._new(Index(name, "arange", count, span), ())
        if name in functions.RECORDS and keywords and not args:
            items = tuple(value for _, value in keywords)
            return self._new(Seq(items, span, tuple(word for word, _ in keywords)), items)
        if name == "map" and len(operands) == 2:
            return self._mapped(operands[0], operands[1], span)
        if name in functions.PRODUCTS and operands:
            return self._product(operands[0], span)
        if name == "reduce" and len(operands) >= 2 and _multiplies(operands[0]):
            return self._product(operands[1], span)
        if name == "reduce" and len(operands) >= 2:
            return self._reduced(operands, span)
        if name == "reduce" and base is not None and _multiplies(base):
            return self._product(args[0], span) if args else Unknown((), span)
        if name in functions.SUMS and operands:
            over = _unwrap(operands[0])
            if isinstance(over, Over):
                return self._new(Over("sum", over.body, over.loop, over.count, span), (over.body,))
            if self._has(operands[0], LOG):
                loop, count = _runs_of(operands[0])
                return self._new(Over("sum", operands[0], loop, count, span), operands[:1])
        if name == "full" and len(operands) >= 2:
            return operands[1]
        # numpy's logarithm of x to the base n, and Unreal's
        if name in ("logn", "LogX") and len(operands) == 2:
            logs = tuple(self._fn("log", (one,), span) for one in operands[::-1])
            return self._op("div", logs, span)
        if name in functions.UNARY and operands:
            return self._unary(functions.UNARY[name], name, operands, module=module, span=span)
        own = functions.own_logarithm(name)
        if own is not None and len(operands) == 1:
            return self._unary(own, name, operands, module=module, span=span)
        if name in functions.BINARY and len(operands) >= 2:
            return self._binary(functions.BINARY[name], operands[:2], span)
        if name in functions.COMPARISONS and len(operands) >= 2:
            return self._op(functions.COMPARISONS[name], operands[:2], span)
        if len(operands) == 2 and functions.is_power(name):
            return self._op("pow", operands, span)
        fixed = functions.fixed_power(name)
        if fixed is not None and len(operands) == 1:
            return self._op("pow", (operands[0], Num(fixed)), span)
        if name in ("pmf", "sf", "cdf", "logpmf") and _is_hypergeom(base):
            return self._fn("hypergeom", operands, span)
        if name in functions.DISTRIBUTED and base is not None:
            distributed = self._distributed(name, base, args, named, span)
            if distributed is not None:
                return distributed
        if name in functions.COUNTS:
            return self._fn("count", operands, span)
        everything = (*operands, *(value for _, value in keywords))
        facts = LOG if _says_log(name) and not _is_logging(base) else 0
        return self._new(Fn(f"?{name}", everything, span), (), facts)

    def _unary(
        self, kind: str, name: str, operands: tuple[Expr, ...], *, module: bool, span: Span | None
    ) -> Expr:
        value = operands[0]
        if kind == "log":
            if name == "log" and module and len(operands) == 2:
                # math.log(x, base) is a quotient of logarithms
                top = self._fn("log", (value,), span)
                bottom = self._fn("log", (operands[1],), span)
                return self._op("div", (top, bottom), span)
            return self._fn("log", (value,), span)
        if kind == "log1p":
            one = self._op("add", (Num(1.0), value), span)
            return self._fn("log", (one,), span)
        if kind == "expm1":
            return self._op("sub", (self._fn("exp", (value,), span), Num(1.0)), span)
        if kind == "square":
            return self._op("pow", (value, Num(2.0)), span)
        if kind == "sqrt":
            return self._op("pow", (value, Num(0.5)), span)
        if kind == "reciprocal":
            return self._op("div", (Num(1.0), value), span)
        if kind == "neg":
            return self._op("neg", (value,), span)
        return self._fn(kind, (value,), span)

    def _binary(self, kind: str, operands: tuple[Expr, ...], span: Span | None) -> Expr:
        if kind == "comb":
            return self._fn("comb", operands, span)
        if kind == "rsub":
            return self._op("sub", operands[::-1], span)
        return self._op(kind, operands, span)

    def _distributed(
        self,
        name: str,
        base: Expr,
        args: tuple[Expr, ...],
        named: Mapping[str, Expr],
        span: Span | None,
    ) -> Expr | None:
        """Write out what a distribution says of the first success, or of none in N trials."""
        distribution = _unwrap(base)
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
        one, failure = Num(1.0), self._op("sub", (Num(1.0), parameters[-1]), span)
        trials = args[0]
        if kind in ("binom", "comb") and len(parameters) == 2:
            if not (isinstance(trials, Num) and trials.value == 0.0):
                return None
            trials = parameters[0]
            name = {"pmf": "sf", "cdf": "sf", "sf": "cdf"}.get(name, "")
        elif kind != "geom" or len(parameters) != 1:
            return None
        if name in ("ppf", "isf"):
            miss = self._op("sub", (one, trials), span) if name == "ppf" else trials
            logs = tuple(self._fn("log", (value,), span) for value in (miss, failure))
            return self._op("div", logs, span)
        missed = self._op("pow", (failure, trials), span)
        if name == "sf":
            return missed
        return self._op("sub", (one, missed), span) if name == "cdf" else None

    def _reduced(self, operands: tuple[Expr, ...], span: Span | None) -> Expr:
        """Read ``reduce(f, values, start)`` as the loop that it is."""
        function, source = _unwrap(operands[0]), operands[1]
        start = operands[2] if len(operands) > 2 else Num(1.0)
        if isinstance(function, Lambda) and len(function.function.parameters) == 2:
            self._loop_number += 1
            loop = str(self._loop_number)
            count = _range_count(source)
            symbol = Name(function.function.parameters[0].name)
            taken = function.function.parameters[1].name
            one = self._running((taken,), source, loop, count)[taken]
            value = self._apply(function.function, (symbol, one), ())
            total = self._accumulated(start, symbol, value, loop, count)
            if total is not None:
                return total
        return self._new(Fn("?reduce", operands, span), operands)

    def _mapped(self, function: Expr, source: Expr, span: Span | None) -> Expr:
        """Read ``map(f, (a, b))`` as ``(f(a), f(b))``."""
        items = _unwrap(source)
        if not isinstance(items, Seq) or len(items.items) > _MAX_CHOICES:
            return self._new(Fn("?map", (function, source), span), (function, source))
        made = tuple(self._applied(function, (one,), span) for one in items.items)
        return self._new(Seq(made, span), made)

    def _applied(self, function: Expr, args: tuple[Expr, ...], span: Span | None) -> Expr:
        """Give what a function that is a value makes of its arguments."""
        inner = _unwrap(function)
        if isinstance(inner, Lambda) and self._inlining < _MAX_INLINE:
            return self._apply(inner.function, args, ())
        if isinstance(inner, Name):
            module, _, name = inner.name.rpartition(".")
            own = self._functions.get(name, ())
            summary = self._summary(own[0]) if len(own) == 1 and not module else None
            if summary is not None and self._inlining < _MAX_INLINE:
                return self._inline(summary, Call(None, name, (), (), span), (args, ()), {})
            return self._known(name, self._module_named(module) if module else None, args, (), span)
        return self._new(Fn("?", args, span), args)

    def _product(self, operand: Expr, span: Span | None) -> Expr:
        inner = _unwrap(operand)
        if isinstance(inner, Seq) and inner.items:
            result = inner.items[0]
            for item in inner.items[1:]:
                result = self._op("mul", (result, item), span)
            return result
        body: Expr
        count: Expr | None
        repeated = _repeated(inner)
        if repeated is not None:
            body, loop, count = repeated[0], "", repeated[1]
        elif isinstance(inner, Over):
            body, loop, count = inner.body, inner.loop, inner.count
        else:
            body = operand
            loop, count = _runs_of(operand)
        facts = POW | NESTED if self._has(body, POW) else POW
        return self._new(Over("prod", body, loop, count, span), (body,), facts)


Arguments = tuple[tuple[Expr, ...], tuple[tuple[str, Expr], ...]]


# ---- small questions ------------------------------------------------------------------------


def _assigned(body: tuple[Stmt, ...]) -> dict[str, None]:
    """Collect the names a body assigns, in order."""
    names: dict[str, None] = {}
    for stmt in body:
        match stmt:
            case Assign(target=str() as target):
                names[target] = None
            case If():
                names.update(_assigned(stmt.body))
                names.update(_assigned(stmt.orelse))
            case Loop():
                names.update(dict.fromkeys(stmt.variables))
                names.update(_assigned(stmt.body))
            case _:
                pass
    return names


def _counters(body: tuple[Stmt, ...]) -> set[str]:
    """Collect the names that a run of the body changes by one, and does nothing else to."""
    steps: dict[str, int] = {}
    for stmt in body:
        if isinstance(stmt, Assign) and stmt.target and isinstance(stmt.value, Op):
            match stmt.value:
                case Op(op="add" | "sub", args=(Name(name=name), Num(value=1.0))) if (
                    name == stmt.target
                ):
                    steps[name] = steps.get(name, 0) + 1
    others = [stmt for stmt in body if isinstance(stmt, If | Loop)]
    return {name for name, times in steps.items() if times == 1} - set(_assigned(tuple(others)))


def _is_counted(source: Expr) -> bool:
    """Whether a loop's source gives consecutive integers (first, for ``enumerate``)."""
    source = _unwrap(source)
    if isinstance(source, Index):
        return True
    match source:
        case Fn(name="?reversed" | "?tqdm" | "?list" | "same", args=(inner, *_)):
            return _is_counted(inner)
        case Fn(name="?enumerate" | "?count"):
            return True
    return False


def _range_count(source: Expr) -> Expr | None:
    source = _unwrap(source)
    if isinstance(source, Index):
        return source.count
    match source:
        case Fn(name="?reversed" | "?tqdm" | "?list" | "same", args=(inner, *_)):
            return _range_count(inner)
    return None


def _arange_count(operands: tuple[Expr, ...]) -> Expr | None:
    if len(operands) == 1:
        return operands[0]
    low, high = operands[0], operands[1]
    if isinstance(_unwrap(low), Num) and _unwrap(low).value == 0:  # type: ignore[union-attr]
        return high
    return Op("sub", (high, low))


def _test_count(test: Expr, counters: set[str], resolve: Callable[[Expr], Expr]) -> Expr | None:
    match test:
        case Op(op="<" | "!=", args=(Name(name=name), bound)) if name in counters:
            return resolve(bound)
        case Op(op=">", args=(bound, Name(name=name))) if name in counters:
            return resolve(bound)
    return None


def _peel(value: Expr, symbol: Expr) -> tuple[str, list[tuple[str, Expr]]] | None:
    """Take apart ``symbol * a / b * ...`` (or ``symbol + a - b``) into what is applied."""
    applied: list[tuple[str, Expr]] = []
    kinds: set[str] = set()
    current = value
    for _ in range(32):
        while isinstance(current, Ref):
            current = current.value
        if current is symbol:
            if len(kinds) != 1:
                return None
            return kinds.pop(), applied[::-1]
        match current:
            case Op(op="mul", args=(left, right)):
                kinds.add("prod")
                if _reaches(left, symbol):
                    applied.append(("mul", right))
                    current = left
                else:
                    applied.append(("mul", left))
                    current = right
            case Op(op="div", args=(left, right)):
                kinds.add("prod")
                applied.append(("div", right))
                current = left
            case Op(op="sub", args=(left, right)) if _unwrap(left) is symbol and _reaches(
                right, symbol
            ):
                part = _peel(right, symbol)  # s - s * x is s * (1 - x)
                if part is None or part[0] != "prod":
                    return None
                kinds.add("prod")
                factor: Expr | None = None
                for operator, one in part[1]:
                    alone = factor is None and operator == "mul"
                    factor = one if alone else Op(operator, (factor or Num(1.0), one))
                assert factor is not None
                applied.append(("mul", Op("sub", (Num(1.0), factor))))
                current = left
            case Op(op="add" | "sub" as operator, args=(left, right)):
                kinds.add("sum")
                if operator == "add" and not _reaches(left, symbol):
                    left, right = right, left
                applied.append((operator, right))
                current = left
            case Fn(name="same", args=(inner, *_)):
                current = inner
            case Choice(options=options):
                # An accumulator that some runs leave alone (`if ...: continue`).
                reaching = [one for one in options if one is not symbol and _reaches(one, symbol)]
                if len(reaching) != 1:
                    return None
                current = reaching[0]
            case _:
                return None
    return None


def _reaches(expr: Expr, symbol: Expr) -> bool:
    for _ in range(32):
        if expr is symbol:
            return True
        match expr:
            case Ref(value=value):
                expr = value
            case Op(op="mul" | "div" | "add" | "sub", args=(left, right)):
                if _reaches(right, symbol):
                    return True
                expr = left
            case Fn(name="same", args=(inner, *_)):
                expr = inner
            case _:
                return False
    return False


def _unwrap(expr: Expr) -> Expr:
    while isinstance(expr, Ref) or (isinstance(expr, Fn) and expr.name == "same"):
        expr = expr.value if isinstance(expr, Ref) else expr.args[0]
    return expr


def _repeated(expr: Expr) -> tuple[Expr, Expr] | None:
    """Read ``[w] * k``."""
    match expr:
        case (
            Op(op="mul", args=(Seq(items=(one,)), count))
            | Op(op="mul", args=(count, Seq(items=(one,))))
        ):
            return one, count
    return None


def _runs_of(expr: Expr) -> tuple[str, Expr | None]:
    """Say over which loop the entries of an array run, and how many there are."""
    loop, count = "", None
    for index in _indices(expr):
        loop, count = index.loop, index.count
    return loop, count


def _indices(expr: Expr, depth: int = 0) -> Iterator[Index]:
    if depth > 12:
        return
    match expr:
        case Index():
            yield expr
        case Ref(value=value):
            yield from _indices(value, depth + 1)
        case Op(args=args) | Fn(args=args):
            for arg in args:
                yield from _indices(arg, depth + 1)
        case Item(base=base):
            yield from _indices(base, depth + 1)
        case _:
            pass


def _is_zero(expr: Expr) -> bool:
    return isinstance(expr, Num) and expr.value == 0.0


def _call_within(expr: Expr, name: str) -> Fn | None:
    """Find the call of an unknown function among the factors of a product."""
    match _unwrap(expr):
        case Fn(name=own) as call if own == name:
            return call
        case Op(op="mul" | "div", args=(left, right)):
            return _call_within(left, name) or _call_within(right, name)
    return None


def _selects(expr: Expr, parameters: Mapping[str, Name]) -> bool:
    """Whether an expression is one of some parameters and numbers: a maximum, a clamp."""
    if not isinstance(expr, Choice):
        return False
    options = [_unwrap(option) for option in expr.options]
    symbols = list(parameters.values())
    return all(
        isinstance(one, Num) or any(one is symbol for symbol in symbols) for one in options
    ) and any(not isinstance(one, Num) for one in options)


def _is_complement(expr: Expr) -> bool:
    match _unwrap(expr):
        case Op(op="sub" | "add", args=args):
            return any(isinstance(arg, Num) and arg.value == 1.0 for arg in args)
    return False


def _is_power(expr: Expr) -> bool:
    expr = _unwrap(expr)
    return isinstance(expr, Op) and expr.op == "pow"


def _multiplies(function: Expr) -> bool:
    """Whether a function of two arguments gives their product: ``operator.mul`` or a lambda."""
    function = _unwrap(function)
    match function:
        case Name(name=name):
            return name.rpartition(".")[2] in ("mul", "multiply")
        case Lambda(function=Function(parameters=(one, other), body=(Leave(value=value),))):
            match value:
                case Op(op="mul", args=(Name(name=left), Name(name=right))):
                    return {left, right} == {one.name, other.name}
    return False


def _is_hypergeom(base: Expr | None) -> bool:
    base = _unwrap(base) if base is not None else None
    if isinstance(base, Name):
        return base.name.rpartition(".")[2] == "hypergeom"
    return isinstance(base, Fn) and base.name == "?hypergeom"


def _is_axis(keyword: str) -> bool:
    return keyword in ("axis", "dim", "keepdim", "keepdims", "out", "key", "default", "dtype")


def _says_log(name: str) -> bool:
    """Whether a name says it holds a logarithm: ``log_probability``, ``logConf``, ``lnP``."""
    last = name.rpartition(".")[2].lower()
    return last.startswith("log") and not last.startswith(("logger", "logg", "logs", "logit"))


def _is_logging(base: Expr | None) -> bool:
    base = _unwrap(base) if base is not None else None
    return isinstance(base, Name) and "log" in base.name.lower()
