"""The commonest shape of a stopping rule: a function of I, n, k and s, called by name from a loop.

scikit-image, scikit-learn and kornia all have it, and so do most libraries that copied theirs.
`count_rule` is the whole plan of such a library; `examine` and `exact_rule` are its two halves.
"""

import inspect
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from types import CodeType, FunctionType, ModuleType
from typing import Any, Literal

from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import Replacement

__all__ = ["RuleFacts", "count_rule", "exact_rule", "examine"]

Rule = Callable[..., Any]

# (I, n, k, s): the exact and the approximate number of trials are at least 7 apart at each.
_KNOWN = ((6, 20, 2, 0.99), (12, 60, 4, 0.99), (9, 20, 7, 0.5), (30, 100, 8, 0.95))

# How far into the stack the loop can stand: the stand-in, and wrappers around it.
_FRAMES = 6


@dataclass(frozen=True, slots=True)
class RuleFacts:
    """What a rule does, as measured by calling it.

    Attributes
    ----------
    assumes : "approximate" or "exact"
        The probability that it assumes.
    number : type
        The type it returns.
    highest_confidence : float or None
        What it takes a confidence of 1 for; None where it has an answer of its own to that
        (infinity, an error).
    limit : float or None
        The largest number of trials it gives at s = 1/2, None where there is no limit.
    """

    assumes: Literal["approximate", "exact"]
    number: type
    highest_confidence: float | None
    limit: float | None


def count_rule(
    module: ModuleType, name: str, *, caller: str, parameters: tuple[str, ...], limit: str
) -> tuple[Replacement, ...]:
    """Return the plan of a library whose loop calls a function of I, n, k and s by name.

    Parameters
    ----------
    module : module
        A module through which the loop can be reached. It need not be the one that defines it.
    name : str
        The function. Its arguments are the number of inliers, of measurements, the size of a
        sample and the confidence, in this order.
    caller : str
        The function or method that holds the loop, as a dotted name in `module`.
    parameters : tuple of str
        The names of the function's arguments.
    limit : str
        The local variable of `caller` that holds the current bound on trials.

    Returns
    -------
    tuple of Replacement
        Empty when the library is exact already.

    Raises
    ------
    PatchNotApplicable
        When anything is not as described, or the function gives the numbers of neither rule.
    """
    loop = _resolve(module, caller)
    home = _home(loop, caller)
    code = loop.__code__
    rule = vars(home).get(name)
    if not callable(rule):
        raise PatchNotApplicable(f"{home.__name__} has no function {name}")
    if not _mentions(code, name) or limit not in code.co_varnames:
        raise PatchNotApplicable(
            f"{home.__name__}.{caller} does not bound {limit} by calling {name} from its module"
        )
    found = tuple(inspect.signature(rule).parameters)
    if found != parameters:
        raise PatchNotApplicable(
            f"{home.__name__}.{name} takes {', '.join(found)} and not {', '.join(parameters)}"
        )
    facts = examine(rule, f"{home.__name__}.{name}")
    if facts.assumes == "exact":
        return ()
    exact = exact_rule(rule, facts, running_limit=lambda: _running_limit(vars(home), limit))
    return (Replacement(holder=home, name=name, exact=exact),)


def examine(rule: Rule, name: str) -> RuleFacts:
    """Find out by calling a rule which probability it assumes, and its conventions.

    Raises
    ------
    PatchNotApplicable
        When it gives the numbers of neither rule.
    """
    values = [_call(rule, *known) for known in _KNOWN]
    assumes: Literal["approximate", "exact"]
    if _all_near(values, required_trials):
        assumes = "exact"
    elif _all_near(values, approximate_required_trials):
        assumes = "approximate"
    else:
        raise PatchNotApplicable(
            f"{name}{_KNOWN[0]} gives {values[0]!r}, and {name}{_KNOWN[1]} gives {values[1]!r}:"
            " that is neither the approximate nor the exact number of trials"
        )
    has_answer = not math.isfinite(_number(_call(rule, 5, 10, 2, 1)))
    largest = _number(_call(rule, 1, 10**9, 20, 0.5))
    limited = 0 < largest < math.inf and largest == _number(_call(rule, 1, 10**9, 19, 0.5))
    return RuleFacts(
        assumes=assumes,
        number=type(values[0]),
        highest_confidence=None if has_answer else 1.0 - sys.float_info.epsilon,
        limit=largest if limited else None,
    )


def exact_rule(
    rule: Rule, facts: RuleFacts, *, running_limit: Callable[[], float] = lambda: math.inf
) -> Rule:
    """Return the exact rule in the conventions of `rule`.

    Where the answer does not depend on the probability (no inlier, a confidence of 0 or of 1,
    arguments out of range) the library's own stands.

    Parameters
    ----------
    rule : callable
        The library's rule.
    facts : RuleFacts
        From `examine`.
    running_limit : callable
        Returns the current bound of the loop that asks, infinity where there is none. Asked
        only when there are fewer inliers than a sample holds: no number of trials is enough
        then, and a loop without any other bound would never end.
    """
    number = facts.number
    highest = facts.highest_confidence
    # The limit is where the rule takes P for some smallest probability: N grows with -log(1-s).
    per_log = None if facts.limit is None else facts.limit / math.log(2.0)

    bind = inspect.signature(rule).bind

    def exact(*args: Any, **kwargs: Any) -> Any:
        if kwargs or len(args) != 4:
            args = bind(*args, **kwargs).args
        n_inliers, n_samples, sample_size, confidence = args
        try:
            if not 0 < confidence <= 1 or 1.0 - confidence == 1.0 or n_inliers <= 0:
                return rule(*args)
            if highest is None:
                if confidence == 1:
                    return rule(*args)
            elif confidence > highest:
                confidence = highest
            trials = required_trials(n_inliers, n_samples, sample_size, confidence)
        except (TypeError, ValueError):  # what to say to such arguments is the library's affair
            return rule(*args)
        if trials == math.inf:
            limit = running_limit()
            smaller = range(1, int(n_inliers) + 1)
            if limit == math.inf or any(limit == rule(i, *args[1:]) for i in smaller):
                return rule(*args)  # no cap, or none but what was returned here before
            return math.inf
        if per_log is not None:
            trials = min(trials, math.ceil(-math.log1p(-confidence) * per_log))
        return number(trials)

    return exact


def _resolve(module: ModuleType, dotted: str) -> FunctionType:
    """Return the function of a dotted name, without what decorators wrapped around it."""
    value: Any = module
    for part in dotted.split("."):
        value = getattr(value, part, None)
    value = inspect.unwrap(value) if callable(value) else value
    if not isinstance(value, FunctionType):
        raise PatchNotApplicable(f"{module.__name__} has no function {dotted}")
    return value


def _home(function: FunctionType, caller: str) -> ModuleType:
    """Return the module in which a function looks names up."""
    home = sys.modules.get(str(function.__globals__.get("__name__")))
    if home is None or vars(home) is not function.__globals__:
        raise PatchNotApplicable(f"the module that defines {caller} cannot be found")
    return home


def _mentions(code: CodeType, name: str) -> bool:
    return name in code.co_names or any(
        _mentions(constant, name) for constant in code.co_consts if isinstance(constant, CodeType)
    )


def _call(rule: Rule, *args: object) -> Any:
    """Return what a rule returns or raises, without its warnings about dividing by zero."""
    numpy = sys.modules.get("numpy")
    try:
        if numpy is None:
            return rule(*args)
        with numpy.errstate(all="ignore"):
            return rule(*args)
    except Exception as error:  # noqa: BLE001 -- any answer of a stranger's function is a fact
        return error


def _number(value: Any) -> float:
    """Return what a rule returned as a float, not a number where it returned none."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _all_near(values: list[Any], law: Callable[..., int | float]) -> bool:
    """Return whether all values follow the law, up to rounding and an offset of one."""
    return all(
        abs(_number(value) - law(*known)) <= 1.0
        for value, known in zip(values, _KNOWN, strict=True)
    )


def _running_limit(namespace: dict[str, Any], limit: str) -> float:
    """Return the bound in the loop that is asking: a local variable, further up the stack."""
    frame = sys._getframe(1)  # noqa: SLF001 -- the loop does not pass its bound to its rule
    for _ in range(_FRAMES):
        outer = frame.f_back
        if outer is None:
            break
        frame = outer
        if frame.f_globals is namespace and limit in frame.f_locals:
            return float(frame.f_locals[limit])
    return math.inf
