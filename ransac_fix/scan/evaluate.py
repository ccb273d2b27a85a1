"""Follow definitions: from the small form to resolved expressions, and the candidates in them.

The walker runs over each body once for its definitions and once to record, carrying for every
name the expression it stands for. Where paths join, a name stands for one of several
(:class:`~ransac_fix.scan.form.Choice`); a loop that multiplies a name in every run makes it a
product (:class:`~ransac_fix.scan.form.Over`). Calls to functions of the same file are replaced by
what they return. All this is bounded: by depth, by the number of choices, and by the number of
nodes one file may produce.
"""

from collections.abc import Mapping
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
from ransac_fix.scan.known_calls import KnownCalls
from ransac_fix.scan.loops import (
    accumulated,
    assigned,
    counters,
    range_count,
    running,
    test_count,
    unrolled,
)
from ransac_fix.scan.members import Members
from ransac_fix.scan.nodes import LOG, MAX_CHOICES, POW, Nodes
from ransac_fix.scan.relevance import relevance
from ransac_fix.scan.shapes import is_complement, says_log, selects, unwrap
from ransac_fix.scan.walk import functions as functions_of

Env = dict[str, Expr]
Arguments = tuple[tuple[Expr, ...], tuple[tuple[str, Expr], ...]]

_MAX_INLINE = 4
_MAX_CALLS = 12  # functions that are walked one from within the other


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
    evaluator = _Evaluator(module)
    try:
        return evaluator.run()
    finally:
        evaluator.release()


class _Evaluator:
    def __init__(self, module: Module) -> None:
        self._module = module
        self._nodes = Nodes(self._candidate)
        self._known_calls = KnownCalls(self._nodes, self._applied)
        self._members = Members(self._nodes)
        self._functions: dict[str, list[Function]] = {}
        self._summaries: dict[int, _Summary | None] = {}
        self._closures: dict[int, Env] = {}
        self._globals: Env = {}
        self._found: list[Candidate] = []
        self._recording = False
        self._second = False
        self._scope = _Scope(None, None)
        self._loops = 0
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
        matter = relevance(self._module.body)
        for function in matter.needed:
            names = assigned(function.body)
            sets_members = function.owner and any("." in name for name in names)
            if sets_members or any(name.startswith("global.") for name in names):
                self._walk_function(function)
        # Then every body once more, with those known; a function that is called is walked when
        # it is first called.
        self._summaries.clear()
        self._members.close()
        self._recording = self._second = True
        self._block(self._module.body, {})
        for function in matter.showing:
            self._summary(function)
        return self._found

    def release(self) -> None:
        """Let go of what knows this in turn: it is much, and nothing collects it soon."""
        del self._nodes, self._known_calls, self._members

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
                env[stmt.name] = self._nodes.module(stmt.target)
            case Function():
                self._closures[id(stmt)] = env
            case Class():
                inner = dict(env)
                self._block(stmt.body, inner)
                for name, value in inner.items():
                    if env.get(name) is not value and isinstance(value, Ref):
                        self._members.add(stmt.name, name, value)
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
            before = unwrap(env.get(call.base.name, Unknown()))
            if isinstance(before, Seq) and not before.names and not self._loops:
                items = (*before.items, self._quiet(call.args[0], env))
                self._bind(call.base.name, self._nodes.new(Seq(items, before.span), items), env)

    def _bind(self, target: str, value: Expr, env: Env) -> None:
        env[target] = value
        if isinstance(value, Seq) and value.names:
            for name in value.names:
                env.pop(f"{target}.{name}", None)  # what an earlier record held
        head, _, tail = target.partition(".")
        if tail and head in ("self", "cls", "this") and self._scope.owner:
            self._members.add(self._scope.owner, tail, value)
        elif tail and head == "global":
            self._members.add(head, tail, value)

    def _settle(self, end: Env) -> None:
        """Keep the products that a method has made of members by its end."""
        for name, value in end.items():
            head, _, tail = name.partition(".")
            made = isinstance(unwrap(value), Op) and self._nodes.has(value, POW)
            if tail and made and head in ("self", "this", "global"):
                self._bind(name, value, {})

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
                        joined[name] = self._nodes.choice((known, value))
        env.clear()
        env.update(joined)

    def _loop(self, stmt: Loop, env: Env) -> None:
        loop = self._nodes.loop()
        count: Expr | None = None
        stepped = counters(stmt.body)
        start = dict(env)
        if stmt.source is not None:
            source = self._expr(stmt.source, env)
            count = range_count(source)
            start.update(running(self._nodes, stmt.variables, source, loop, count))
        carried: dict[str, Expr] = {}
        for name in assigned(stmt.body):
            if name in stepped:
                carried[name] = self._nodes.new(Index(name, loop, count), ())
            else:
                carried[name] = Name(name)
        if stmt.test is not None and count is None:
            count = test_count(stmt.test, stepped, lambda expr: self._quiet(expr, env))

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
            if name in stepped:
                steady[name] = symbol
                after[name] = Name(name)
                continue
            total = accumulated(self._nodes, before, symbol, value, loop, count)
            both = self._nodes.choice([one for one in (before, value) if one is not None])
            after[name] = both if total is None else total
            if total is not None and count is not None:
                # In the loop there have not been all runs yet, and a break may end them.
                total = accumulated(self._nodes, before, symbol, value, loop, None)
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
        self._join(ends[:MAX_CHOICES] or [env], joined)
        return joined

    def _quiet(self, expr: Expr, env: Env) -> Expr:
        recording, self._recording = self._recording, False
        value = self._expr(expr, env)
        self._recording = recording
        return value

    # ---- functions ------------------------------------------------------------------------

    def _walk_function(self, function: Function) -> tuple[list[Expr], dict[str, Name], list[Env]]:
        env = dict(self._closures.get(id(function), self._globals))
        for name, value in self._globals.items():
            env.setdefault(name, value)
        parameters = {one.name: self._nodes.symbol(one.name) for one in function.parameters}
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
        value = self._nodes.choice(returns)
        value = unrolled(self._nodes, function, value) or value
        references = tuple(one.name for one in function.parameters if one.by_reference)
        paths = {name for env in ends for name in env if name.partition(".")[0] in references}
        changed = {
            name: self._nodes.choice([env[name] for env in ends if name in env])
            for name in sorted(paths if references else ())
        }
        changed = {name: one for name, one in changed.items() if self._nodes.has(one, LOG | POW)}
        summary = None
        worth = self._nodes.has(value, LOG | POW) or is_complement(value)
        if changed or worth or selects(value, parameters):
            order = tuple(one.name for one in function.parameters)
            if function.owner and order and order[0] in ("self", "cls"):
                order = order[1:]
            summary = _Summary(value, changed, parameters, order, defaults)
        self._summaries[id(function)] = summary
        return summary

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

    def _inline(self, summary: _Summary, call: Call, arguments: Arguments, env: Env) -> Expr:
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
        result = self._nodes.substitute(summary.value, values, memo)
        for name, value in summary.changed.items():
            parameter, dot, member = name.partition(".")
            given = summary.order.index(parameter)
            target = call.args[given] if given < len(call.args) else None
            if isinstance(target, Name):
                made = self._nodes.substitute(value, values, memo)
                self._bind(f"{target.name}{dot}{member}", made, env)
        self._inlining -= 1
        self._call = outer
        return result

    # ---- expressions ----------------------------------------------------------------------

    def _expr(self, expr: Expr, env: Env) -> Expr:
        match expr:
            case Num():
                return expr
            case Name():
                return self._name(expr, env)
            case Op():
                return self._nodes.op(
                    expr.op, tuple(self._expr(arg, env) for arg in expr.args), expr.span
                )
            case Call():
                return self._evaluate_call(expr, env)
            case Choice():
                if expr.test is not None:
                    self._expr(expr.test, env)
                return self._nodes.choice([self._expr(one, env) for one in expr.options], expr.span)
            case Item():
                base = self._expr(expr.base, env)
                return self._nodes.item(base, self._expr(expr.index, env), expr.span)
            case Seq():
                items = tuple(self._expr(one, env) for one in expr.items)
                return self._nodes.new(Seq(items, expr.span, expr.names), items)
            case Each():
                return self._each(expr, env)
            case Ref():  # name := value
                value = self._expr(expr.value, env)
                env[expr.name] = value
                return self._nodes.new(Ref(expr.name, value, expr.span), (value,))
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
                return self._nodes.new(Unknown(parts, expr.span), ())
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
        if isinstance(value, Name) and self._nodes.is_imported(value):
            return value
        facts = LOG if says_log(expr.name) else 0
        if value is None:
            return self._nodes.new(Name(expr.name, expr.span), (), facts)
        return self._nodes.new(Ref(expr.name, value, expr.span), (value,))

    def _dotted(self, head: str, tail: str, env: Env) -> Expr | None:
        if head in ("self", "cls", "this") and self._scope.owner:
            own = self._members.get(self._scope.owner, tail)
            return own or self._property(tail) or self._members.inherited(tail)
        value = env.get(head)
        while isinstance(value, Ref):
            value = value.value
        if isinstance(value, Name) and self._nodes.is_imported(value):
            return self._nodes.module(f"{value.name}.{tail}")
        return self._members.get(head, tail) or self._property(tail)  # Class.constant

    def _entry_named(self, path: str, env: Env) -> Expr | None:
        """Give what ``a.b`` is, where ``a`` is a record."""
        base, _, name = path.rpartition(".")
        value = env.get(base)
        head, _, tail = base.partition(".")
        if value is None and tail:
            value = self._dotted(head, tail, env)
        return None if value is None else self._nodes.member(value, name)

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
        written_out = unwrap(source)
        if isinstance(written_out, Seq) and len(expr.variables) == 1:
            items = written_out.items
            if len(items) <= MAX_CHOICES and not all(isinstance(one, Num) for one in items):
                bodies = tuple(
                    self._each_body(expr, {expr.variables[0]: one}, env) for one in items
                )
                return self._nodes.new(Seq(bodies, expr.span), bodies)
        loop = self._nodes.loop()
        count = range_count(source)
        body = self._each_body(expr, running(self._nodes, expr.variables, source, loop, count), env)
        return self._nodes.new(Over("each", body, loop, count, expr.span), (body,))

    def _each_body(self, expr: Each, variables: Env, env: Env) -> Expr:
        inner = {**env, **variables}
        for test in expr.tests:
            self._expr(test, inner)
        return self._expr(expr.body, inner)

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
                base = self._nodes.module(module) if module else None
        return self._known_calls.read(name, base, args, keywords, call.span)

    def _applied(self, function: Expr, args: tuple[Expr, ...], span: Span | None) -> Expr | None:
        """Give what a lambda or a function of the file makes of arguments; None of others."""
        inner = unwrap(function)
        if self._inlining >= _MAX_INLINE:
            return None
        if isinstance(inner, Lambda):
            return self._apply(inner.function, args, ())
        own = self._functions.get(inner.name, []) if isinstance(inner, Name) else []
        summary = self._summary(own[0]) if len(own) == 1 else None
        if summary is None:
            return None
        return self._inline(summary, Call(None, own[0].name, (), (), span), (args, ()), {})

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
