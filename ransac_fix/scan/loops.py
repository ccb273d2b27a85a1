"""What loops make of the names in them: counters, and products and sums built run by run."""

from collections.abc import Callable, Iterator

from ransac_fix.scan.form import (
    Assign,
    Choice,
    Expr,
    Fn,
    Function,
    If,
    Index,
    Item,
    Loop,
    Name,
    Num,
    Op,
    Over,
    Ref,
    Seq,
    Stmt,
)
from ransac_fix.scan.nodes import NESTED, POW, Nodes
from ransac_fix.scan.shapes import call_within, unwrap
from ransac_fix.scan.walk import statements


def accumulated(
    nodes: Nodes, before: Expr | None, symbol: Expr, value: Expr, loop: str, count: Expr | None
) -> Expr | None:
    """Give the product or sum a name has become, if the loop builds one."""
    if before is None:
        return None
    factors = peel(value, symbol)
    if factors is None:
        return None
    kind, body = factors
    # One factor may itself be conditional; what counts is that it is multiplied in each run.
    term: Expr
    if kind == "prod":
        term = body[0][1] if len(body) == 1 and body[0][0] == "mul" else Num(1.0)
        nodes.adopt(term, value)  # as peel writes it
        if len(body) != 1 or body[0][0] != "mul":
            for operator, factor in body:
                term = nodes.new(Op(operator, (term, factor)), (term, factor), POW)
        nested = NESTED if nodes.has(term, POW) else 0
        over = nodes.new(Over("prod", term, loop, count), (term,), POW | nested)
        return nodes.new(Op("mul", (before, over)), (before, over))
    term = Num(0.0)
    for operator, part in body:
        term = nodes.new(Op(operator, (term, part)), (term, part))
    over = nodes.new(Over("sum", term, loop, count), (term,))
    return nodes.new(Op("add", (before, over)), (before, over))


def unrolled(nodes: Nodes, function: Function, value: Expr) -> Expr | None:
    """Give the product that a function is which returns a factor times itself for one less."""
    options = value.options if isinstance(value, Choice) else (value,)
    ends: list[Expr] = []
    factors: list[tuple[str, Expr]] = []
    arguments: tuple[Expr, ...] = ()
    for option in options:
        own = call_within(option, f"?{function.name}")
        peeled = None if own is None else peel(option, own)
        if own is None:
            ends.append(option)
        elif peeled is None or peeled[0] != "prod" or factors:
            return None
        else:
            factors, arguments = peeled[1], own.args
    names = [one.name for one in function.parameters]
    if not factors or not ends or len(arguments) != len(names):
        return None
    loop = nodes.loop()
    counted: list[Expr] = []
    values: dict[int, Expr] = {}
    for name, argument in zip(names, arguments, strict=True):
        match unwrap(argument):
            case Name(name=same) if same == name:
                pass
            case Op(op="sub", args=(before, Num(value=1.0))):
                symbol = unwrap(before)
                if not (isinstance(symbol, Name) and symbol.name == name):
                    return None
                counted.append(symbol)
                index = nodes.new(Index(name, loop), ())
                values[id(symbol)] = nodes.op("sub", (symbol, index), None)
            case _:
                return None
    if not counted:
        return None
    term: Expr = Num(1.0)
    for operator, factor in factors:
        term = nodes.op(operator, (term, nodes.substitute(factor, values, {})), None)
    over = nodes.new(Over("prod", term, loop, counted[-1]), (term,), POW)
    return nodes.op("mul", (nodes.choice(ends), over), value.span)


def running(
    nodes: Nodes, variables: tuple[str, ...], source: Expr, loop: str, count: Expr | None
) -> dict[str, Expr]:
    """Say what the variables of a loop are: counters, or names of unknown values."""
    together = unwrap(source)
    zipped = isinstance(together, Fn) and together.name == "?zip"
    bound: dict[str, Expr] = {}
    for number, name in enumerate(variables):
        counted = number == 0 and is_counted(source)
        if zipped and isinstance(together, Fn) and number < len(together.args):
            counted = is_counted(together.args[number])
        bound[name] = nodes.new(Index(name, loop, count), ()) if counted else Name(name)
    return bound


def assigned(body: tuple[Stmt, ...]) -> dict[str, None]:
    """Collect the names a body assigns, in order."""
    names: dict[str, None] = {}
    for stmt in statements(body):
        match stmt:
            case Assign(target=str() as target):
                names[target] = None
            case Loop():
                names.update(dict.fromkeys(stmt.variables))
            case _:
                pass
    return names


def counters(body: tuple[Stmt, ...]) -> set[str]:
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
    return {name for name, times in steps.items() if times == 1} - set(assigned(tuple(others)))


def is_counted(source: Expr) -> bool:
    """Whether a loop's source gives consecutive integers (first, for ``enumerate``)."""
    source = unwrap(source)
    if isinstance(source, Index):
        return True
    match source:
        case Fn(name="?reversed" | "?tqdm" | "?list" | "same", args=(inner, *_)):
            return is_counted(inner)
        case Fn(name="?enumerate" | "?count"):
            return True
    return False


def range_count(source: Expr) -> Expr | None:
    """Say how many runs a loop over consecutive integers has."""
    source = unwrap(source)
    if isinstance(source, Index):
        return source.count
    match source:
        case Fn(name="?reversed" | "?tqdm" | "?list" | "same", args=(inner, *_)):
            return range_count(inner)
    return None


def arange_count(operands: tuple[Expr, ...]) -> Expr | None:
    """Say how many integers a range from its operands has."""
    if len(operands) == 1:
        return operands[0]
    low, high = operands[0], operands[1]
    if isinstance(unwrap(low), Num) and unwrap(low).value == 0:  # type: ignore[union-attr]
        return high
    return Op("sub", (high, low))


def test_count(test: Expr, counters: set[str], resolve: Callable[[Expr], Expr]) -> Expr | None:
    """Say how many runs a loop has that counts up to a bound."""
    match test:
        case Op(op="<" | "!=", args=(Name(name=name), bound)) if name in counters:
            return resolve(bound)
        case Op(op=">", args=(bound, Name(name=name))) if name in counters:
            return resolve(bound)
    return None


def peel(value: Expr, symbol: Expr) -> tuple[str, list[tuple[str, Expr]]] | None:
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
            case Op(op="sub", args=(left, right)) if unwrap(left) is symbol and _reaches(
                right, symbol
            ):
                part = peel(right, symbol)  # s - s * x is s * (1 - x)
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


def repeated(expr: Expr) -> tuple[Expr, Expr] | None:
    """Read ``[w] * k``."""
    match expr:
        case (
            Op(op="mul", args=(Seq(items=(one,)), count))
            | Op(op="mul", args=(count, Seq(items=(one,))))
        ):
            return one, count
    return None


def runs_of(expr: Expr) -> tuple[str, Expr | None]:
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
