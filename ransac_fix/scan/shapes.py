"""Small questions about what an expression is, as it stands: its shape, and what its name says."""

from collections.abc import Mapping
from functools import lru_cache

from ransac_fix.scan.form import Choice, Expr, Fn, Function, Lambda, Leave, Name, Num, Op, Ref


def unwrap(expr: Expr) -> Expr:
    """Look through names and casts."""
    while isinstance(expr, Ref) or (isinstance(expr, Fn) and expr.name == "same"):
        expr = expr.value if isinstance(expr, Ref) else expr.args[0]
    return expr


def is_zero(expr: Expr) -> bool:
    """Whether an expression is the number zero."""
    return isinstance(expr, Num) and expr.value == 0.0


def call_within(expr: Expr, name: str) -> Fn | None:
    """Find the call of an unknown function among the factors of a product."""
    match unwrap(expr):
        case Fn(name=own) as call if own == name:
            return call
        case Op(op="mul" | "div", args=(left, right)):
            return call_within(left, name) or call_within(right, name)
    return None


def selects(expr: Expr, parameters: Mapping[str, Name]) -> bool:
    """Whether an expression is one of some parameters and numbers: a maximum, a clamp."""
    if not isinstance(expr, Choice):
        return False
    options = [unwrap(option) for option in expr.options]
    symbols = list(parameters.values())
    return all(
        isinstance(one, Num) or any(one is symbol for symbol in symbols) for one in options
    ) and any(not isinstance(one, Num) for one in options)


def is_complement(expr: Expr) -> bool:
    """Whether an expression is a number taken from one, or one from it."""
    match unwrap(expr):
        case Op(op="sub" | "add", args=args):
            return any(isinstance(arg, Num) and arg.value == 1.0 for arg in args)
    return False


def is_power(expr: Expr) -> bool:
    """Whether an expression is a power."""
    expr = unwrap(expr)
    return isinstance(expr, Op) and expr.op == "pow"


def multiplies(function: Expr) -> bool:
    """Whether a function of two arguments gives their product: ``operator.mul`` or a lambda."""
    function = unwrap(function)
    match function:
        case Name(name=name):
            return name.rpartition(".")[2] in ("mul", "multiply")
        case Lambda(function=Function(parameters=(one, other), body=(Leave(value=value),))):
            match value:
                case Op(op="mul", args=(Name(name=left), Name(name=right))):
                    return {left, right} == {one.name, other.name}
    return False


@lru_cache(maxsize=4096)
def says_log(name: str) -> bool:
    """Whether a name says it holds a logarithm: ``log_probability``, ``logConf``, ``lnP``."""
    last = name.rpartition(".")[2].lower()
    return last.startswith("log") and not last.startswith(("logger", "logg", "logs", "logit"))
