"""How a file draws its minimal samples: with or without replacement.

A rule is right only for the sampler it stands beside. The calls that draw are read from the small
form by name and arguments; a call that draws one index at a time repeats itself unless something
near it checks for that.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from ransac_fix.scan.form import (
    Assign,
    Call,
    Expr,
    Function,
    If,
    Item,
    Loop,
    Module,
    Name,
    Num,
    Op,
    Seq,
    Span,
    Stmt,
)
from ransac_fix.scan.walk import expressions, inside


@dataclass(frozen=True, slots=True)
class Draw:
    """A call that draws indices.

    Attributes
    ----------
    law : {"distinct", "replacement", "weighted", "single", "single in c"}
        ``single``: one index at a time, so with replacement unless checked.
    span : Span
    function : Function or None
        Where it stands.
    loops : int
        How many loops, comprehensions included, it stands in.
    size : int or None
        How many indices it draws, where that is written as a number.
    """

    law: str
    span: Span
    function: Function | None
    loops: int
    size: int | None = None


_DISTINCT = frozenset(
    [
        "permutation",
        "permuted",
        "shuffle",
        "randperm",
        "sample_without_replacement",
        "random_shuffle",
        "combinations",
    ]
)
_SINGLE = frozenset(["randrange", "irand", "rand_int"])
# How C and C++ draw one index: a call, or the remainder of one.
_SINGLE_IN_C = frozenset(
    [
        "RandInt",
        "RandomInt",
        "RandomInteger",
        "randInt",
        "randomInt",
        "randomInteger",
        "random_int",
        "uniformInteger",
    ]
)
_RANDOM_IN_C = frozenset(["rand", "random", "lrand48", "rand_r"])
_CHECKS = frozenset(["unique", "set", "unique_consecutive", "isin", "in1d", "duplicated"])

# ... and how they see to it that none comes twice, besides comparing.
_CHECKS_IN_C = _CHECKS | {"find", "insert", "count", "contains", "erase", "pop_back", "swap"}


def draws(module: Module) -> list[Draw]:
    """Find the calls of a file that draw indices, single draws settled by what checks them."""
    found: list[Draw] = []
    checked: set[int | None] = set()
    checked_in_c: set[int | None] = set()
    checked_singly: set[int | None] = set()
    for expr, function, loops in expressions(module.body, None, 0):
        if isinstance(expr, Call):
            if expr.name in _CHECKS:
                checked.add(_key(function))
            if expr.name in _CHECKS_IN_C:
                checked_in_c.add(_key(function))
            law = _law(expr)
            if law is not None and expr.span is not None:
                found.append(Draw(law, expr.span, function, loops, _size(expr)))
        elif isinstance(expr, Op) and expr.op == "in" and loops:
            # Of an index: whether it was drawn already; of a whole sample: something else.
            checked_singly.add(_key(function))
        elif isinstance(expr, Op) and expr.op in ("==", "!=") and loops:
            checked_in_c.add(_key(function))
        elif isinstance(expr, Op) and _is_remainder(expr) and expr.span is not None:
            body = module.body if function is None else function.body
            law = "distinct" if _is_shrinking(expr, body) or _asks_flags(body) else "single in c"
            found.append(Draw(law, expr.span, function, loops))
    checks = {"single": checked | checked_singly, "single in c": checked_in_c}
    return [_settled(draw, _key(draw.function) in checks.get(draw.law, checked)) for draw in found]


def law_for(
    all_draws: Iterable[Draw], functions: Iterable[Function | None], owner: str | None
) -> tuple[str, Draw | None]:
    """Say how the samples of a rule are drawn, and where, from the draws nearest to it.

    Parameters
    ----------
    all_draws : iterable of Draw
    functions : iterable of Function or None
        The function of the rule and those that call it, nearest first.
    owner : str or None
        The class of the rule.

    Returns
    -------
    law : {"distinct", "replacement", "weighted", "unknown"}
    draw : Draw or None
    """
    known = list(all_draws)
    near = [
        [draw for draw in known if same_function(draw.function, function)] for function in functions
    ]
    near.append(
        [draw for draw in known if owner and draw.function and draw.function.owner == owner]
    )
    near.append(known)
    for group in near:
        # The sample is drawn in a loop; what is drawn once is data or a shuffle of it.
        looped = [draw for draw in group if draw.loops] or group
        laws = {draw.law for draw in looped}
        if len(laws) == 1:
            return looped[0].law, looped[0]
        if laws:
            return "unknown", None
    return "unknown", None


def same_function(one: Function | None, other: Function | None) -> bool:
    """Whether two functions are the same, or both the module itself."""
    # By place: the draws may come from another reading of the same file.
    if one is None or other is None:
        return one is other
    return one.span == other.span


def _settled(draw: Draw, checked: bool) -> Draw:
    if draw.law in ("single", "single in c") or (draw.law == "replacement" and checked):
        law = "distinct" if checked else "replacement"
        return Draw(law, draw.span, draw.function, draw.loops, draw.size)
    return draw


def _is_remainder(expr: Op) -> bool:
    """Whether an expression reads ``rand() % n``, or ``(rand() * RAND_MAX + rand()) % n``."""
    return expr.op == "mod" and any(
        isinstance(inner, Call) and inner.name in _RANDOM_IN_C for inner in inside(expr.args[0])
    )


def _is_shrinking(remainder: Op, body: tuple[Stmt, ...]) -> bool:
    """Whether one is drawn of those that are left: ``rand() % (n - i)``, as a shuffle does."""
    match remainder.args[1]:
        case Op(op="sub", args=(_, Name(name=name))):
            return name in _steps(body)
    return False


def _steps(body: tuple[Stmt, ...]) -> set[str]:
    """Collect the names that loops count with."""
    names: set[str] = set()
    for stmt in body:
        match stmt:
            case Assign(target=str() as target, value=Op(op="add" | "sub", args=(Name(name), _))):
                if target == name:
                    names.add(target)
            case If():
                names |= _steps(stmt.body) | _steps(stmt.orelse)
            case Loop():
                names |= _steps(stmt.body)
            case _:
                pass
    return names


def _asks_flags(body: tuple[Stmt, ...]) -> bool:
    """Whether a loop asks what it has marked: ``while (used[i])``, ``if (points[i].taken)``."""
    for stmt in body:
        match stmt:
            case If(test=test) | Loop(test=Op() | Name() | Item() as test):
                if _is_flag(test) or _asks_flags(stmt.body):
                    return True
                if isinstance(stmt, If) and _asks_flags(stmt.orelse):
                    return True
            case Loop():
                if _asks_flags(stmt.body):
                    return True
            case _:
                pass
    return False


def _is_flag(test: Expr) -> bool:
    match test:
        case Op(op="not", args=(inner,)):
            return _is_flag(inner)
        case Name(name=name):
            head, _, tail = name.partition(".")
            return bool(tail) and head != "this"
        case Item():
            return True
    return False


def _key(function: Function | None) -> int | None:
    return None if function is None else id(function)


def _law(call: Call) -> str | None:
    keywords = dict(call.keywords)
    base = call.base.name if isinstance(call.base, Name) else ""
    if call.name in _DISTINCT:
        return "distinct"
    if call.name == "sample":
        # random.sample(population, k), DataFrame.sample(n), rng.sample
        if "replace" in keywords:
            return _by_replace(keywords["replace"])
        return "distinct" if call.args or "n" in keywords or "k" in keywords else None
    if call.name == "choices":
        return "weighted" if "weights" in keywords or len(call.args) > 1 else "replacement"
    if call.name == "choice":
        if "p" in keywords or len(call.args) > 3:
            return "weighted"
        if "replace" in keywords:
            return _by_replace(keywords["replace"])
        if len(call.args) > 2:
            return _by_replace(call.args[2])
        return "replacement" if "size" in keywords or len(call.args) > 1 else "single"
    if call.name in ("randint", "integers", "random_integers"):
        several = "size" in keywords or len(call.args) > 2
        if base.rpartition(".")[2] == "torch":
            several = True
        return "replacement" if several else "single"
    if call.name in _SINGLE:
        return "single"
    if call.name in _SINGLE_IN_C:
        return "single in c"
    if call.name == "random_":
        return "replacement"
    if call.name in ("topk", "argsort") and _draws_noise(call.args[:1]):
        return "distinct"
    return None


def _size(call: Call) -> int | None:
    """Read the number of indices that a call draws."""
    keywords = dict(call.keywords)
    place = {"randint": 2, "integers": 2}.get(call.name, 1)
    value = next((keywords[name] for name in ("size", "k", "n") if name in keywords), None)
    if value is None and call.name in ("choice", "sample", "choices", "randint", "integers"):
        value = call.args[place] if len(call.args) > place else None
    if isinstance(value, Seq) and len(value.items) == 1:
        value = value.items[0]
    return int(value.value) if isinstance(value, Num) else None


def _by_replace(value: Expr) -> str:
    if isinstance(value, Name) and value.name == "False":
        return "distinct"
    if isinstance(value, Num) and value.value == 0:
        return "distinct"
    return "replacement"


def _draws_noise(args: tuple[Expr, ...]) -> bool:
    for expr in args:
        for inner in inside(expr):
            if isinstance(inner, Call) and inner.name in ("rand", "random", "rand_like"):
                return True
    return False
