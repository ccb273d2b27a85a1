"""The last gate of a Python file: whether a complement of a power meets a logarithm or a power.

Turning a file into the small form and following its definitions costs far more than parsing it,
and most files with logarithms, powers and the word "outlier" hold no rule. Here every expression
is reduced to a few facts, which names, attributes, parameters and results carry through the whole
file, in any order and along any path. That is much less than what ``evaluate`` follows and takes a
fraction of the time, and errs to one side: a rule that ``evaluate`` could see is seen.
"""

import ast
from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import cache

from ransac_fix.scan import functions

# What an expression may be, or be made of.
_ONE = 1  # a constant that is one
_POWER = 2  # a power or a product
_MINUS = 4  # something with a minus before it
_COMPLEMENT = 8  # one less a power
_LESS_ONE = 16  # a power less one
_LOG = 32  # made of logarithms
_DIFFERENCE = 64  # a power less a power: n**k - i**k, to be divided by n**k

_SIGNED = _COMPLEMENT | _LESS_ONE
_MOST_VISITS = 2000
_KINDS = {**functions.UNARY, **functions.BINARY}
_PASSES = frozenset(
    (*functions.CLAMPS, *functions.SELECTS, *functions.FULLS, *functions.RECORDS, "geom")
)
_HYPERGEOMETRIC = frozenset(("pmf", "sf", "cdf", "logpmf"))

_Definition = ast.FunctionDef | ast.AsyncFunctionDef


class _Found(Exception):  # noqa: N818 -- the answer, from any depth
    """There may be a rule."""


def may_hold_a_rule(tree: ast.Module) -> bool:
    """Whether a file could hold a stopping rule, by what its expressions are made of."""
    file = _File(tree)
    try:
        file.settle()
    except (_Found, RecursionError):
        return True
    finally:
        file.release()
    return False


class _Scope:
    """The names of a module, a class or a function, and what it depends on."""

    def __init__(
        self, body: list[ast.stmt], parent: "_Scope | None", name: str, *, is_class: bool = False
    ) -> None:
        self.body = body
        self.parent = parent
        self.name = name
        self.is_class = is_class
        self.names: dict[str, int] = {}
        self.read: set[str] = set()
        self.users: set[_Scope] = set()
        self.factors: dict[str, frozenset[str]] = {}
        self.unsettled = True


class _Function(_Scope):
    """A function: what it is called with goes to its parameters."""

    def __init__(self, node: _Definition, parent: _Scope) -> None:
        super().__init__(node.body, parent, node.name)
        arguments = node.args
        self.order = [one.arg for one in (*arguments.posonlyargs, *arguments.args)]
        self.parameters = {*self.order, *(one.arg for one in arguments.kwonlyargs)}
        if parent.is_class and self.order and self.order[0] in ("self", "cls"):
            del self.order[0]


class _Lambda:
    """A lambda with a name; its parameters are names of the scope around it."""

    def __init__(self, node: ast.Lambda, scope: _Scope) -> None:
        arguments = node.args
        self.scope = scope
        self.order = [one.arg for one in (*arguments.posonlyargs, *arguments.args)]
        self.parameters = {*self.order, *(one.arg for one in arguments.kwonlyargs)}


class _File:
    """The facts of a file, which only ever grow, until they are settled."""

    def __init__(self, tree: ast.Module) -> None:
        self._scopes: list[_Scope] = []
        self._definitions: dict[int, _Function] = {}
        self._functions: defaultdict[str, list[_Function | _Lambda]] = defaultdict(list)
        self._attributes: defaultdict[str, int] = defaultdict(int)
        self._attribute_users: defaultdict[str, set[_Scope]] = defaultdict(set)
        self._results: defaultdict[str, int] = defaultdict(int)
        self._result_users: defaultdict[str, set[_Scope]] = defaultdict(set)
        self._aliases: defaultdict[str, set[str]] = defaultdict(set)
        self._scope = _Scope(tree.body, None, "")
        self._loops = 0
        self._collect(self._scope)
        self._statements: dict[type[ast.AST], Callable[..., None]] = {
            ast.Assign: self._assignment,
            ast.AnnAssign: self._annotated,
            ast.AugAssign: self._augmented,
            ast.Expr: self._expression,
            ast.Return: self._return,
            ast.If: self._branch,
            ast.While: self._while,
            ast.For: self._for,
            ast.AsyncFor: self._for,
            ast.With: self._with,
            ast.AsyncWith: self._with,
            ast.Try: self._try,
            ast.TryStar: self._try,
            ast.Match: self._match,
            ast.FunctionDef: self._function,
            ast.AsyncFunctionDef: self._function,
            ast.Import: self._import,
            ast.ImportFrom: self._import,
            ast.Assert: self._assert,
        }
        self._expressions: dict[type[ast.AST], Callable[..., int]] = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._attribute,
            ast.Subscript: self._subscript,
            ast.Slice: self._slice,
            ast.Tuple: self._sequence,
            ast.List: self._sequence,
            ast.Set: self._sequence,
            ast.BoolOp: self._boolean,
            ast.Starred: self._inner,
            ast.Await: self._inner,
            ast.NamedExpr: self._named,
            ast.IfExp: self._choice,
            ast.Compare: self._compare,
            ast.Lambda: self._lambda,
            ast.ListComp: self._comprehension,
            ast.SetComp: self._comprehension,
            ast.GeneratorExp: self._comprehension,
            ast.DictComp: self._mapping,
            ast.Dict: self._record,
            ast.UnaryOp: self._unary,
            ast.BinOp: self._binary,
            ast.Call: self._call,
        }

    def _collect(self, scope: _Scope) -> None:
        """Find the scopes of a file and the functions by their names."""
        self._scopes.append(scope)
        left = list(reversed(scope.body))
        while left:
            node = left.pop()
            if isinstance(node, _Definition):
                function = _Function(node, scope)
                self._definitions[id(node)] = function
                self._functions[node.name].append(function)
                self._collect(function)
            elif isinstance(node, ast.ClassDef):
                self._collect(_Scope(node.body, scope, node.name, is_class=True))
            elif isinstance(node, ast.Assign):
                if isinstance(node.value, ast.Lambda):
                    for target in node.targets:
                        name = _last_name(target)
                        if name is not None:
                            self._functions[name].append(_Lambda(node.value, scope))
            else:
                for field in ("finalbody", "orelse", "body"):
                    left += reversed(getattr(node, field, ()))
                for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
                    left += reversed(part.body)

    def settle(self) -> None:
        """Visit every scope until nothing is new; raise when there may be a rule."""
        visits = 0
        unsettled = self._scopes
        while unsettled:
            for scope in unsettled:
                visits += 1
                if visits > _MOST_VISITS + 10 * len(self._scopes):
                    raise _Found
                scope.unsettled = False
                self._scope, self._loops = scope, 0
                above = scope.parent
                while above is not None:
                    above.users.add(scope)
                    above = above.parent
                self._block(scope.body)
            unsettled = [scope for scope in self._scopes if scope.unsettled]

    def release(self) -> None:
        """Let go of the tree at once: scopes know each other, and nothing collects them soon."""
        for scope in self._scopes:
            scope.users.clear()
            scope.body = []
        self._statements.clear()
        self._expressions.clear()
        self._functions.clear()
        self._attribute_users.clear()
        self._result_users.clear()

    # ---- names ----------------------------------------------------------------------------

    def _look_up(self, name: str) -> int:
        scope = self._scope
        scope.read.add(name)
        facts = scope.names.get(name, 0)
        above = scope.parent
        while above is not None:
            above.read.add(name)
            if name in above.names:
                facts |= above.names[name]
            above = above.parent
        return facts

    def _assign(self, scope: _Scope, name: str, facts: int) -> None:
        old = scope.names.get(name, 0)
        if facts & ~old:
            scope.names[name] = old | facts
            if name in scope.read:
                scope.unsettled = True
                for user in scope.users:
                    user.unsettled = True
            if scope.is_class:
                self._set_attribute(name, facts)

    def _set_attribute(self, name: str, facts: int) -> None:
        if facts & ~self._attributes[name]:
            self._attributes[name] |= facts
            for user in self._attribute_users[name]:
                user.unsettled = True

    def _set_result(self, name: str, facts: int) -> None:
        if facts & ~self._results[name]:
            self._results[name] |= facts
            for user in self._result_users[name]:
                user.unsettled = True

    def _result(self, name: str) -> int:
        self._result_users[name].add(self._scope)
        return self._results[name]

    def _alias(self, target: str, value: ast.expr) -> None:
        if isinstance(value, ast.Name):
            self._aliases[target].add(value.id)
        elif isinstance(value, ast.Attribute):
            self._aliases[target].add(value.attr)

    def _names_of(self, name: str) -> Iterable[str]:
        if name not in self._aliases:
            return (name,)
        found = [name]
        for one in found:
            found += [other for other in self._aliases.get(one, ()) if other not in found]
        return found

    # ---- statements -----------------------------------------------------------------------

    def _block(self, body: list[ast.stmt]) -> None:
        for node in body:
            visit = self._statements.get(type(node))
            if visit is not None:
                visit(node)

    def _assignment(self, node: ast.Assign) -> None:
        for target in node.targets:
            self._bind(target, node.value)
        if self._loops:
            self._growth(node.targets, node.value)

    def _growth(self, targets: Iterable[ast.expr], value: ast.expr) -> None:
        """Take what is made of itself in a loop for a product: p = p * q, or q = p * r; p = q."""
        match value:
            case ast.BinOp(op=ast.Sub(), left=left, right=right):
                self._shrinks(targets, left, right)
        factors = _factors(value)
        multiplied = _multiplies(value)
        before = self._scope.factors
        for target in targets:
            name = _last_name(target)
            if name is None:
                continue
            if any((multiplied and one == name) or name in before.get(one, ()) for one in factors):
                if self._expr(value) & _COMPLEMENT:
                    raise _Found  # one factor more in each run
                self._bind(target, None, _POWER)
            if multiplied:
                before[name] = factors

    def _shrinks(self, targets: Iterable[ast.expr], left: ast.expr, right: ast.expr) -> None:
        """Look for p = p - p * q, one factor 1 - q more in each run."""
        names = {_last_name(target) for target in targets} & _names_in(left) & _names_in(right)
        if names and self._expr(right) & _POWER:
            raise _Found

    def _bind(self, target: ast.expr, value: ast.expr | None, facts: int = 0) -> None:
        """Give a target what it is assigned: an expression, or facts where these are known."""
        if isinstance(target, ast.Tuple | ast.List):
            parts = target.elts
            if isinstance(value, ast.Tuple | ast.List) and len(value.elts) == len(parts):
                for part, one in zip(parts, value.elts, strict=True):
                    self._bind(part, one)
                return
            if value is not None:
                facts = self._expr(value)
            for part in parts:
                self._bind(part, None, facts)
            return
        if isinstance(target, ast.Starred):
            self._bind(target.value, value, facts)
            return
        name = _last_name(target)
        if value is not None:
            if name is not None:
                self._alias(name, value)
            facts = self._expr(value)
        if name is None or not facts:
            return
        if not isinstance(target, ast.Attribute):
            self._assign(self._scope, name, facts)
        if not isinstance(target, ast.Name):
            self._set_attribute(name, facts)

    def _annotated(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._bind(node.target, node.value)

    def _augmented(self, node: ast.AugAssign) -> None:
        left, right = self._expr(node.target), self._expr(node.value)
        if isinstance(node.op, ast.Mult | ast.Div | ast.FloorDiv) and self._loops:
            if right & _COMPLEMENT:
                raise _Found  # one factor more in each run
            left |= _POWER
        if isinstance(node.op, ast.Sub) and self._loops:
            self._shrinks((node.target,), node.target, node.value)
        facts = self._operation(type(node.op), left, right, node.target, node.value)
        self._bind(node.target, None, facts)

    def _expression(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        facts = self._expr(node.value)
        match node.value:
            case ast.Call(func=ast.Attribute(value=target, attr=name)) if name.endswith("_"):
                self._bind(target, None, facts)  # changed in place
            case ast.Call(func=ast.Attribute(value=target, attr="append"), args=[one]):
                self._bind(target, one)
        if isinstance(node.value, ast.Call):
            for word in node.value.keywords:
                if word.arg == "out":
                    self._bind(word.value, None, facts)

    def _return(self, node: ast.Return) -> None:
        if node.value is not None:
            self._set_result(self._scope.name, self._expr(node.value))

    def _branch(self, node: ast.If) -> None:
        self._expr(node.test)
        self._block(node.body)
        self._block(node.orelse)

    def _while(self, node: ast.While) -> None:
        self._loops += 1
        self._expr(node.test)
        self._block(node.body)
        self._loops -= 1
        self._block(node.orelse)

    def _for(self, node: ast.For | ast.AsyncFor) -> None:
        self._bind(node.target, None, self._expr(node.iter))
        self._loops += 1
        self._block(node.body)
        self._loops -= 1
        self._block(node.orelse)

    def _with(self, node: ast.With | ast.AsyncWith) -> None:
        for item in node.items:
            facts = self._expr(item.context_expr)
            if item.optional_vars is not None:
                self._bind(item.optional_vars, None, facts)
        self._block(node.body)

    def _try(self, node: ast.Try | ast.TryStar) -> None:
        self._block(node.body)
        for handler in node.handlers:
            self._block(handler.body)
        self._block(node.orelse)
        self._block(node.finalbody)

    def _match(self, node: ast.Match) -> None:
        self._expr(node.subject)
        for case in node.cases:
            self._block(case.body)

    def _function(self, node: _Definition) -> None:
        function = self._definitions[id(node)]
        arguments = node.args
        positional = [one.arg for one in (*arguments.posonlyargs, *arguments.args)]
        defaults = list(zip(positional[::-1], arguments.defaults[::-1], strict=False))
        for name, value in (
            *defaults,
            *zip([one.arg for one in arguments.kwonlyargs], arguments.kw_defaults, strict=True),
        ):
            if value is not None:
                self._assign(function, name, self._expr(value))

    def _import(self, node: ast.Import | ast.ImportFrom) -> None:
        for alias in node.names:
            if alias.asname:
                self._aliases[alias.asname].add(alias.name.rpartition(".")[2])

    def _assert(self, node: ast.Assert) -> None:
        self._expr(node.test)

    # ---- expressions ----------------------------------------------------------------------

    def _expr(self, node: ast.expr) -> int:
        visit = self._expressions.get(type(node))
        return self._unknown(node) if visit is None else visit(node)

    def _unknown(self, node: ast.expr) -> int:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                self._expr(child)
        return 0

    def _constant(self, node: ast.Constant) -> int:
        value = node.value
        if (type(value) is int or type(value) is float) and 0.999 <= value <= 1.001:
            return _ONE
        return 0

    def _name(self, node: ast.Name) -> int:
        return self._look_up(node.id)

    def _attribute(self, node: ast.Attribute) -> int:
        name = node.attr
        self._attribute_users[name].add(self._scope)
        facts = self._expr(node.value) | self._attributes[name]
        return facts | self._result(name) if name in self._functions else facts

    def _subscript(self, node: ast.Subscript) -> int:
        self._expr(node.slice)
        return self._expr(node.value)

    def _slice(self, node: ast.Slice) -> int:
        for part in (node.lower, node.upper, node.step):
            if part is not None:
                self._expr(part)
        return 0

    def _all(self, nodes: Iterable[ast.expr]) -> int:
        facts = 0
        for node in nodes:
            facts |= self._expr(node)
        return facts

    def _sequence(self, node: ast.Tuple | ast.List | ast.Set) -> int:
        return self._all(node.elts)

    def _boolean(self, node: ast.BoolOp) -> int:
        return self._all(node.values)

    def _inner(self, node: ast.Starred | ast.Await) -> int:
        return self._expr(node.value)

    def _named(self, node: ast.NamedExpr) -> int:
        facts = self._expr(node.value)
        self._bind(node.target, None, facts)
        return facts

    def _choice(self, node: ast.IfExp) -> int:
        self._expr(node.test)
        return self._expr(node.body) | self._expr(node.orelse)

    def _compare(self, node: ast.Compare) -> int:
        self._expr(node.left)
        self._all(node.comparators)
        return 0

    def _lambda(self, node: ast.Lambda) -> int:
        for name, default in zip(
            [one.arg for one in (*node.args.posonlyargs, *node.args.args)][::-1],
            node.args.defaults[::-1],
            strict=False,
        ):
            self._assign(self._scope, name, self._expr(default))
        return self._expr(node.body)

    def _comprehension(self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp) -> int:
        for generator in node.generators:
            self._bind(generator.target, None, self._expr(generator.iter))
            self._all(generator.ifs)
        return self._expr(node.elt)

    def _mapping(self, node: ast.DictComp) -> int:
        for generator in node.generators:
            self._bind(generator.target, None, self._expr(generator.iter))
            self._all(generator.ifs)
        self._expr(node.key)
        self._expr(node.value)
        return 0

    def _record(self, node: ast.Dict) -> int:
        self._all(key for key in node.keys if key is not None)
        return self._all(node.values)

    def _unary(self, node: ast.UnaryOp) -> int:
        facts = self._expr(node.operand)
        return _negative(facts) if isinstance(node.op, ast.USub) else facts

    def _binary(self, node: ast.BinOp) -> int:
        left, right = self._expr(node.left), self._expr(node.right)
        return self._operation(type(node.op), left, right, node.left, node.right)

    def _operation(
        self, operator: type[ast.operator], left: int, right: int, one: ast.expr, other: ast.expr
    ) -> int:
        if operator is ast.Add:
            return _sum(left, right)
        if operator is ast.Sub:
            return _difference(left, right)
        if operator is ast.Pow:
            return self._power(left, other)
        both = left | right
        if operator is ast.Mult:
            return self._product(left, right, one, other)
        if operator is ast.Div or operator is ast.FloorDiv:
            return _quotient(both) | (left & right & _ONE)
        return 0

    def _product(self, left: int, right: int, one: ast.expr, other: ast.expr) -> int:
        both = left | right
        facts = both & ~_ONE | (left & right & _ONE)
        if both & _MINUS and both & _LESS_ONE:
            facts |= _COMPLEMENT
        names, others = (
            {name for named in _names_in(side) for name in self._names_of(named)}
            for side in (one, other)
        )
        if facts & _POWER or not names.isdisjoint(others) or not (names or others):
            facts |= _POWER  # w * w and 0.7 * 0.7
        return facts

    def _power(self, base: int, written: ast.expr) -> int:
        if base & _COMPLEMENT and not _is_literal(written):
            raise _Found
        return _POWER | base & _LOG

    # ---- calls ----------------------------------------------------------------------------

    def _call(self, node: ast.Call) -> int:
        arguments = [self._expr(one) for one in node.args]
        keywords = [(word.arg, self._expr(word.value)) for word in node.keywords]
        match node.func:
            case ast.Name(id=name):
                base = 0
            case ast.Attribute(attr=name):
                base = self._expr(node.func.value)
            case _:
                return self._expr(node.func)  # perhaps a lambda that is called at once
        everything = base
        if name in functions.DISTRIBUTED:
            self._distributed(node, base)
        for one in arguments:
            everything |= one
        for _, one in keywords:
            everything |= one
        if name == "map" and node.args:
            applied = _last_name(node.args[0]) or ""
            if applied in self._functions:
                self._pass(applied, [everything], [])
                return self._result(applied) | self._look_up(applied)
            return self._known_function(_kind_of(applied), node, everything)
        if name not in self._functions and name not in self._aliases:
            kind = _kind_of(name)
            return self._known_function(kind, node, everything) if kind else 0
        facts = 0
        for known in self._names_of(name):
            if known in self._functions:
                facts |= self._result(known) | self._look_up(known)  # what a lambda gives
                if everything:
                    self._pass(known, arguments, keywords)
            kind = _kind_of(known)
            if kind:
                facts |= self._known_function(kind, node, everything)
        return facts

    def _distributed(self, node: ast.Call, base: int) -> None:
        """Look for a power in what scipy.stats says of a first success: geom.ppf(s, w**k)."""
        for one in (*node.args[1:], *(word.value for word in node.keywords)):
            base |= self._expr(one)
        if base & _POWER:
            raise _Found

    def _known_function(self, kind: str, node: ast.Call, everything: int) -> int:
        match kind:
            case "log":
                if everything & (_COMPLEMENT | _DIFFERENCE):
                    raise _Found
                return _LOG
            case "log1p":
                if everything & _COMPLEMENT or (everything & _POWER and everything & _MINUS):
                    raise _Found
                return _LOG
            case "same":
                return everything
            case "one":
                return _ONE
            case "exp":
                return _POWER if everything & _LOG else 0
            case "expm1":
                return _POWER | _LESS_ONE if everything & _LOG else 0
            case "neg":
                return _negative(everything)
            case "reciprocal":
                return everything & ~_ONE
            case "sum":
                return everything & _LOG
            case "prod":
                if everything & _COMPLEMENT:
                    raise _Found
                return _POWER
            case "fixed":
                return _POWER
            case "pow":
                written = node.args[-1] if node.args else None
                if everything & _COMPLEMENT and (written is None or not _is_literal(written)):
                    raise _Found
                return _POWER
            case "counting":
                return _POWER | _LOG
            case "add":
                return _sum(everything, everything) | everything & _POWER
            case "sub" | "rsub":
                return _difference(everything, everything) | everything & _POWER
            case "mul":
                return everything & ~_ONE | _POWER
            case "div":
                return _quotient(everything)
        return 0

    def _pass(
        self, name: str, arguments: list[int], keywords: list[tuple[str | None, int]]
    ) -> None:
        """Give the parameters of the functions of a name what they are called with."""
        for function in self._functions[name]:
            scope = function.scope if isinstance(function, _Lambda) else function
            for parameter, facts in zip(function.order, arguments, strict=False):
                self._assign(scope, parameter, facts)
            for word, facts in keywords:
                if word is None:
                    for parameter in function.parameters:
                        self._assign(scope, parameter, facts)
                elif word in function.parameters:
                    self._assign(scope, word, facts)


def _negative(facts: int) -> int:
    facts |= _MINUS
    return facts | _COMPLEMENT if facts & _LESS_ONE else facts


def _sum(left: int, right: int) -> int:
    both = left | right
    facts = both & (_ONE | _SIGNED | _LOG)
    if both & _ONE and both & _POWER and both & _MINUS:
        facts |= _COMPLEMENT
    if (left ^ right) & _POWER:
        facts |= both & (_POWER | _MINUS)  # the other side may be a small guard
    return facts


def _difference(left: int, right: int) -> int:
    facts = _sum(left, _negative(right) if right & (_POWER | _LESS_ONE) else right)
    if left & right & _POWER:
        facts |= _DIFFERENCE
    return facts | _LESS_ONE if left & _POWER and right & _ONE else facts


def _quotient(both: int) -> int:
    return both & ~_ONE | (_COMPLEMENT if both & _DIFFERENCE else 0)


def _is_literal(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        node = node.operand
    return isinstance(node, ast.Constant)


def _last_name(node: ast.expr) -> str | None:
    while isinstance(node, ast.Subscript):
        node = node.value
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else None


def _multiplies(node: ast.expr) -> bool:
    """Whether an expression is a product or quotient, perhaps inside calls."""
    match node:
        case ast.BinOp(op=ast.Mult() | ast.Div() | ast.FloorDiv()):
            return True
        case ast.IfExp():
            return _multiplies(node.body) or _multiplies(node.orelse)
        case ast.Call():
            base = isinstance(node.func, ast.Attribute) and _multiplies(node.func.value)
            return base or any(map(_multiplies, node.args))
        case ast.UnaryOp():
            return _multiplies(node.operand)
    return False


def _factors(node: ast.expr) -> frozenset[str]:
    """Give the names that such an expression multiplies or divides, or the one name that it is."""
    match node:
        case ast.BinOp(op=ast.Mult() | ast.Div() | ast.FloorDiv()):
            return _factors(node.left) | _factors(node.right)
        case ast.IfExp():
            return _factors(node.body) | _factors(node.orelse)
        case ast.Call():
            base = [node.func.value] if isinstance(node.func, ast.Attribute) else []
            return frozenset[str]().union(*map(_factors, (*base, *node.args)))
        case ast.UnaryOp():
            return _factors(node.operand)
    name = _last_name(node)
    return frozenset() if name is None else frozenset((name,))


def _names_in(node: ast.expr) -> set[str]:
    found: set[str] = set()
    left: list[ast.AST] = [node]
    while left:
        one = left.pop()
        if isinstance(one, ast.Name):
            found.add(one.id)
        elif isinstance(one, ast.Attribute):
            found.add(one.attr)
        else:
            left += ast.iter_child_nodes(one)
    return found


def _functions_known() -> dict[str, str]:
    kinds = {
        **dict.fromkeys(("comb", "factorial", "gamma", "lgamma"), "counting"),
        **dict.fromkeys(("square", "sqrt"), "fixed"),
        "floordiv": "div",
    }
    return {
        **dict.fromkeys(functions.SUMS, "sum"),
        **dict.fromkeys(functions.RANGES, "none"),
        **{name: kinds.get(kind, kind) for name, kind in _KINDS.items()},
        **dict.fromkeys((*functions.PRODUCTS, "reduce"), "prod"),
        **dict.fromkeys(functions.ONES, "one"),
        **dict.fromkeys(_PASSES, "same"),
        **dict.fromkeys(_HYPERGEOMETRIC, "counting"),
        "logn": "log",
    }


_FUNCTIONS = _functions_known()


@cache
def _kind_of(name: str) -> str:
    """Say what a function does, by its name; nothing for an unknown one."""
    known = _FUNCTIONS.get(name) or _FUNCTIONS.get(name.removesuffix("_"))
    if known is not None:
        return known
    if functions.is_power(name):
        return "pow"
    if functions.fixed_power(name) is not None:
        return "fixed"
    return functions.own_logarithm(name) or ""
