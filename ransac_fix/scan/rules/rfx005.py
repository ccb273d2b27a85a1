"""RFX005, the rule that ends the loop at once, or never."""

import re
from collections.abc import Iterable, Iterator
from typing import ClassVar

from ransac_fix.scan import algebra
from ransac_fix.scan.findings import Certainty, Finding
from ransac_fix.scan.form import Assign, Choice, Expr, Fn, If, Item, Name, Num, Op, Ref, Stmt
from ransac_fix.scan.logarithms import quotients
from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.rules.base import Rule, ScannedFile, power_of
from ransac_fix.scan.walk import expressions, functions, statements

_COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))
# What catches a number that is none, or takes its sign away.
_CATCHES = re.compile(
    r"^\s*(?:try\b|except\b)|\b(?:is(?:inf|nan|finite|normal)|errstate|nan_to_num)\b", re.MULTILINE
)
_ABSOLUTE = re.compile(r"\b(?:f?abs|absolute)\b")
_LOWER = re.compile(r"(?:f?max(?:imum)?f?|clamp_min_?)\b", re.IGNORECASE)
_INTEGER = (
    r"(?:static_cast\s*<\s*(?:std::)?(?:unsigned|int|u?int\d+_t|size_t|long)[^<>]*>"
    r"|\(\s*(?:unsigned|int|u?int\d+_t|size_t|long)[\w\s]*\)"
    r"|\b(?:unsigned(?:\s+int)?|int|u?int\d+_t|size_t|long)\s+\w+\s*=)"
)
_TO_INTEGER = re.compile(_INTEGER + r"[^;{}]*$")
_IDENTIFIER = re.compile(r"[^\W\d]\w*")
_HELPER = "all_inlier_probability"  # of a fix
_SMALL_SAMPLE = 4
_LEVELS = 24


class EndsAtOnce(Rule):
    """Stopping rule that ends the loop at once, or never, for some numbers of inliers.

    What it does
    ------------
    Finds stopping rules whose quotient of logarithms goes wrong where it is not guarded:

    - a guard of the wrong sign, ``max(eps, log(1 - w**k))``. A logarithm of a probability is never
      positive, so the guard always wins and the number of trials is negative.
    - ``log(1 - w**k + eps)``, which is positive as soon as ``w**k`` is smaller than eps.
    - small ``w**k``. Below 1.1e-16 (half the machine epsilon) ``1 - w**k`` is one, its logarithm
      zero, and the number of trials minus infinity, an error, or in C++ whatever the conversion to
      an integer makes of it. With seven points a sample that is an inlier ratio below 0.005: the
      first model of 1,500 points, with nothing but its own sample as inliers. Reported for samples
      of five points or more; where their size is not known, only for a conversion to an integer in
      C++, and where the code guards the other end, or zero inliers, and not this.
    - Python's own ``math.log`` of zero, in a loop, where all data are inliers.

    A rule is left alone where anything looks like a guard: a clamp that bounds ``1 - w**k`` on that
    side, a comparison of the power or of the result with a constant, ``abs``, ``isinf``, ``try``.
    A test for zero inliers is no guard against a small power.

    Why is this bad
    ---------------
    The loop ends after one trial and returns the model of a random sample; or it never ends; or it
    raises an error on data that are too good. OpenMVG stops after one trial at 1,500 points, 60 %
    of them inliers; scikit-image before 0.25, Open3D before 0.19 and kornia 0.7.1 had the same.

    Use instead
    -----------
    ``ransac_fix.required_trials(n_inliers, n_samples, sample_size, confidence)``, right for every
    argument; or ``log1p(-p)``, which is not zero before p is, with p = 0 and p = 1 apart and the
    limit on trials applied before the conversion to an integer.

    Fix safety
    ----------
    There is no fix: what the loop should do at that end, go on to its limit or stop, is for the
    author to say.

    References
    ----------
    scikit-image pull requests 7065 and 7496; Open3D issue 6709.
    """

    code = "RFX005"
    name = "ends-at-once"
    summary = "logarithm of zero, division by zero or wrong sign: the loop ends at once, or never"
    valid: ClassVar[dict[str, str]] = {
        "Clamped on both sides.": """
import numpy as np

def ransac_trials(n_inliers, n_samples, k, s):
    eps = np.spacing(1)
    denom = np.clip(1 - (n_inliers / n_samples) ** k, eps, 1 - eps)
    return np.ceil(np.log(1 - s) / np.log(denom))
""",
        "Tested before it is used.": """
import math

def ransac_trials(n_inliers, n_samples, k, s, max_trials):
    denom = 1 - (n_inliers / n_samples) ** k
    if denom <= 0 or denom >= 1:
        return max_trials
    return math.ceil(math.log(1 - s) / math.log(denom))
""",
        "An error is caught.": """
import math

def ransac_trials(n_inliers, n_samples, k, s, max_trials):
    try:
        return math.log(1 - s) / math.log(1 - (n_inliers / n_samples) ** k)
    except (ValueError, ZeroDivisionError):
        return max_trials
""",
        "A budget from an assumed ratio meets neither end.": """
import numpy as np

def ransac(points, fit, k=8, w=0.6):
    for _ in range(int(np.log(0.01) / np.log(1 - w**k))):
        fit(points)
""",
        "A guard of the right sign.": """
import math

def ransac_trials(n_inliers, n_samples, k, s):
    p = (n_inliers / n_samples) ** k
    return math.log(1 - s) / min(-1e-9, math.log(max(1e-9, 1 - p)))
""",
        "With two points a power is never that small.": """
import numpy as np

def ransac_trials(n_inliers, n_samples, s):
    return np.log(1 - s) / np.log(1 - (n_inliers / n_samples) ** 2)
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "The guard always wins.": """
import math

def ransac_trials(n_inliers, n_samples, k, s):
    eps = 1e-9
    p = (n_inliers / n_samples) ** k
    return math.log(1 - s) / max(eps, math.log(max(eps, 1 - p)))
""",
        "Clamped on the other side only.": """
import numpy as np

def ransac_trials(n_inliers, n_samples, k, s):
    if n_inliers == 0:
        return np.inf
    denom = max(1e-16, 1 - (n_inliers / n_samples) ** k)
    return np.ceil(np.log(1 - s) / np.log(denom))
""",
        "The addition makes it larger than one.": """
import numpy as np

def ransac_trials(n_inliers, n_samples, k, s):
    return np.log(1 - s) / np.log(1 - (n_inliers / n_samples) ** k + 1e-10)
""",
        "All inliers, and math.log.": """
import math

def ransac(points, fit, s):
    trials, best, t = 1000, 0, 0
    while t < trials:
        inliers = fit(points)
        if len(inliers) > best:
            best = len(inliers)
            trials = math.log(1 - s) / math.log(1 - (best / len(points)) ** 3)
        t += 1
""",
    }

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find the rules that are wrong at an end, exact ones too."""
        for read in file.sites:
            if read.certainty is None or read.site.form != "quotient":
                continue
            message = _hazard(read, file)
            if message:
                yield Finding(
                    self.code,
                    file.location(read.site.span),
                    _certainty(read, sure="always wins" in message),
                    message,
                    dict(read.roles),
                    " ".join(read.expression.split()),
                    no_fix="what the loop should do then is for its author to say",
                )


def _certainty(read: ReadSite, *, sure: bool) -> Certainty:
    """Say how sure: a ratio that callers pass may be one that never comes near an end."""
    if sure:
        return read.certainty or "low"
    return "medium" if _has_counts(read) and read.certainty != "low" else "low"


def _has_counts(read: ReadSite) -> bool:
    """Whether the rule is made of numbers of inliers and samples, which can be the same."""
    probability = read.site.probability
    return probability.n_inliers is not None or (
        probability.ratio is not None and algebra.counts_of(probability.ratio) is not None
    )


def _hazard(read: ReadSite, file: ScannedFile) -> str | None:
    """Say what goes wrong at a site; None where nothing does, or something guards it."""
    site = read.site
    candidate = next((one for one in site.seen if one.call is None), site.seen[0])
    path = _Path(candidate.expr, site.assumed)
    if path.log is None:
        return None
    wrong = _wrong_sign(path.above, file)
    if wrong is not None:
        return (
            f"the logarithm is never positive, so {wrong} always wins over it: the number of trials"
            " is negative and the loop ends at once"
        )
    power = power_of(read) if site.probability.kind == "approximate" else "p"
    if not read.adaptive or _is_caught(read, file):
        return None
    names = {*path.names, *([candidate.target] if candidate.target else [])}
    names.update(_ratios(read, file))
    if _is_fixed(read):  # the counts are not on the way to a product, but in the call of it
        for role in ("n_inliers", "n_samples"):
            names.update(_IDENTIFIER.findall(read.roles.get(role, "")))
    tests = list(_tests(read, file))
    if any(_guards(test, names, read) for test in tests):
        return None
    if path.added is not None:
        return (
            f"with {path.added} added the argument is larger than one where {power} is smaller than"
            " that: the number of trials is negative and the loop ends at once"
        )
    if not path.bounded_above(file) and _comes_near_one(read, path, tests, file):
        return (
            f"1 - {power} rounds to one where {power} is below 1.1e-16; its logarithm is then zero,"
            " and the loop ends at once, never, or in an error"
        )
    if _fails_on_all_inliers(read, path, file) and not any(_compares(one, names) for one in tests):
        return f"where all data are inliers, 1 - {power} is zero and math.log raises ValueError"
    return None


def _comes_near_one(
    read: ReadSite, path: "_Path", tests: Iterable[Expr], file: ScannedFile
) -> bool:
    """Whether small powers are to be expected, or were guarded against and are not kept away."""
    size = _sample_size(read)
    if size is not None:
        return size > _SMALL_SAMPLE
    if path.bounded:
        return True  # on the other side only
    if file.language == "c++":
        start = read.site.span
        before = " ".join(file.text.lines[max(0, start.line - 3) : start.line - 1])
        before += " " + file.text.lines[start.line - 1][: start.column]
        if _TO_INTEGER.search(before):
            return True
        # double N = log(s) / log(q); ... static_cast<int>(std::ceil(N))
        target = next((one.target for one in read.site.seen if one.target), None)
        own = read.site.function
        if target is None or own is None:
            return False
        used = rf"{_INTEGER}[\w\s:(]*\b{re.escape(target.rpartition('.')[2])}\b"
        return re.search(used, file.text.block(own.span)) is not None
    inliers = {read.roles.get("n_inliers"), read.roles.get("inlier_ratio")}
    for test in tests:
        match test:
            case Op(args=(left, Num(value=0))) if _spelled(left) in inliers:
                return True
    return False


def _fails_on_all_inliers(read: ReadSite, path: "_Path", file: ScannedFile) -> bool:
    log = path.log
    if file.language not in ("python", "notebook") or log is None or path.bounded_by(read, file):
        return False
    if not _has_counts(read) or log.span is None:
        return False
    if not any(one.loops for one in read.site.seen):
        return False  # whoever calls it may know better
    spelled = file.text.at(log.span)
    if spelled.startswith("math.log"):
        return True
    return spelled.startswith("log") and "from math import" in file.text.source


class _Path:
    """What stands between a quotient and the probability in it.

    Attributes
    ----------
    above : list of Expr
        From the quotient down to the logarithm of the bottom.
    log : Fn or None
        That logarithm.
    below : list of Expr
        From there down to the probability.
    names : set of str
        Every name on the way, and those the probability is made of.
    """

    def __init__(self, quotient: Expr, assumed: Expr) -> None:
        self.names: set[str] = set()
        self.above: list[Expr] = []
        self.below: list[Expr] = []
        self.log: Fn | None = None
        bottom = next(iter(quotients(quotient)), None)
        way = _way(quotient, bottom.bottom) if bottom is not None else None
        if bottom is None or way is None or not isinstance(bottom.bottom, Fn):
            return
        self.log = bottom.bottom
        self.above = way
        self.below = _way(self.log.args[0], assumed) or _all(self.log.args[0])
        for expr in (*self.above, *self.below, *_made_of(assumed)):
            if isinstance(expr, Ref | Name):
                self.names.add(expr.name)

    @property
    def bounded(self) -> bool:
        """Whether any clamp or choice stands on the way."""
        return any(_is_bound(one) for one in (*self.above, *self.below))

    def bounded_by(self, read: ReadSite, file: ScannedFile) -> bool:
        """Whether the code itself bounds it: what a fix calls guards the other end only."""
        if not _is_fixed(read):
            return self.bounded
        added = [one.span for one in functions(file.module.body) if _HELPER in one.name]
        return any(
            _is_bound(one)
            and one.span is not None
            and not any(span.line <= one.span.line <= span.end_line for span in added)
            for one in (*self.above, *self.below)
        )

    def bounded_above(self, file: ScannedFile) -> bool:
        """Whether something may keep ``1 - P`` from being one."""
        for one in (*self.above, *self.below):
            if isinstance(one, Choice):
                return True
            if isinstance(one, Fn) and one.name == "clamp":
                spelled = file.text.at(one.span) if one.span is not None else ""
                if not _LOWER.search(spelled.partition("(")[0]):
                    return True
            if isinstance(one, Op) and one.op in ("add", "sub"):
                tiny = [part for part in one.args if algebra.is_tiny(part)]
                if tiny and algebra.number(tiny[0]) is None:
                    return True
                if one.op == "sub" and algebra.is_tiny(one.args[1]):
                    return True
        return False

    @property
    def added(self) -> str | None:
        """Give what is added to ``1 - P`` inside the logarithm, if it is a number that counts."""
        for one in self.below:
            match one:
                case Op(op="add", args=(left, right)):
                    for part, other in ((left, right), (right, left)):
                        value = algebra.number(part)
                        complement = any(True for _ in algebra.complement(other))
                        if value is not None and 2.3e-16 < value < 1e-3 and complement:
                            return f"{value:g}"
        return None


def _is_bound(expr: Expr) -> bool:
    return isinstance(expr, Choice) or (isinstance(expr, Fn) and expr.name == "clamp")


def _is_fixed(read: ReadSite) -> bool:
    return f"{_HELPER}(" in read.expression


def _wrong_sign(above: Iterable[Expr], file: ScannedFile) -> str | None:
    """Find a clamp of a logarithm from below to something positive."""
    for one in above:
        if not (isinstance(one, Fn) and one.name == "clamp" and one.span is not None):
            continue
        if not _LOWER.search(file.text.at(one.span).partition("(")[0]):
            continue
        for bound in one.args:
            value = algebra.number(bound)
            if value is not None and 0 < value < 1e-3:
                return f"{value:g}"
    return None


def _way(start: Expr, goal: Expr, level: int = 0) -> list[Expr] | None:
    """Give the expressions from one down to another in it."""
    if start is goal:
        return [start]
    if level > _LEVELS:
        return None
    for child in _children(start):
        rest = _way(child, goal, level + 1)
        if rest is not None:
            return [start, *rest]
    return None


def _all(expr: Expr, level: int = 0) -> list[Expr]:
    if level > 6:
        return [expr]
    found = [expr]
    for child in _children(expr):
        found += _all(child, level + 1)
    return found


def _made_of(expr: Expr, level: int = 0) -> Iterator[Expr]:
    """Yield what makes a probability small: its power, the ratio, the inliers; not the exponent."""
    yield expr
    if level > _LEVELS:
        return
    inner: tuple[Expr, ...] = ()
    match expr:
        case Ref(value=value):
            inner = (value,)
        case Op(op="pow" | "div" | "floordiv", args=(first, *_)):
            inner = (first,)
        case Op(args=args):
            inner = args
        case Fn(name="same" | "clamp" | "exp", args=args):
            inner = args
    for one in inner:
        yield from _made_of(one, level + 1)


def _children(expr: Expr) -> tuple[Expr, ...]:
    match expr:
        case Ref(value=value):
            return (value,)
        case Op(args=args) | Fn(args=args):
            return args
        case Item(base=base):
            return (base,)
        case Choice(options=options):
            return options
    return ()


def _sample_size(read: ReadSite) -> float | None:
    """Give the smallest exponent that is known for a site."""
    known: list[float] = []
    for one in (read.site.probability, *read.site.called_with):
        value = one.exponent_value
        if value is None and one.exponent is not None:
            value = algebra.number(one.exponent)
        if value is not None:
            known.append(value)
    return min(known, default=None)


def _is_caught(read: ReadSite, file: ScannedFile) -> bool:
    own = read.site.function
    blocks = [
        file.text.block(one.span) if one is not None else file.text.source
        for one in (own, *(one.function for one in read.site.seen))
    ]
    return _ABSOLUTE.search(blocks[0]) is not None or any(
        _CATCHES.search(block) for block in blocks
    )


def _bodies(read: ReadSite, file: ScannedFile) -> list[tuple[Stmt, ...]]:
    """Give the bodies of the functions around a site."""
    functions = {
        id(one): one
        for one in (read.site.function, *(one.function for one in read.site.seen))
        if one is not None
    }
    return [one.body for one in functions.values()] or [file.module.body]


def _tests(read: ReadSite, file: ScannedFile) -> Iterator[Expr]:
    """Yield what the functions around a site compare and test."""
    for body in _bodies(read, file):
        for expr, _, _ in expressions(body, None, 0):
            if isinstance(expr, Op) and expr.op in _COMPARISONS:
                yield expr
        for stmt in statements(body):
            if isinstance(stmt, If) and not (
                isinstance(stmt.test, Op) and stmt.test.op in _COMPARISONS
            ):
                yield stmt.test


def _ratios(read: ReadSite, file: ScannedFile) -> Iterator[str]:
    """Yield the names of what is made of both counts: a test of one keeps the same ends away."""
    counts = (read.roles.get("n_inliers"), read.roles.get("n_samples"))
    for body in _bodies(read, file):
        for stmt in statements(body):
            if isinstance(stmt, Assign) and stmt.target and stmt.value.span is not None:
                made_of = file.text.at(stmt.value.span)
                if all(count is not None and count in made_of for count in counts):
                    yield stmt.target


def _guards(test: Expr, names: set[str], read: ReadSite) -> bool:
    """Whether a test keeps a small power away: of it, or of what it gives, with a constant."""
    counts = {read.roles.get(role) for role in ("inlier_ratio", "n_inliers", "n_samples")}
    match test:
        case Op(op=operator, args=(left, right)) if operator in _COMPARISONS:
            for one, other in ((left, right), (right, left)):
                if not _mentions(one, names) or _spelled(one) == read.roles.get("n_samples"):
                    continue
                zero = isinstance(other, Num) and other.value == 0
                if _is_constant(other, read) and not (zero and _spelled(one) in counts):
                    return True
        case Name(name=name):
            return name in names and name not in counts
        case Op(op="not", args=(inner,)):
            return _guards(inner, names, read)
    return False


def _compares(test: Expr, names: set[str]) -> bool:
    """Whether a test compares anything on the way for equality, or with a constant."""
    match test:
        case Op(op=operator, args=args) if operator in _COMPARISONS:
            constant = any(isinstance(one, Num) for one in args)
            return (constant or operator in ("==", "!=")) and any(
                _mentions(one, names) for one in args
            )
    return False


def _mentions(expr: Expr, names: set[str]) -> bool:
    return any(isinstance(one, Name) and one.name in names for one in _inside(expr))


def _inside(expr: Expr, level: int = 0) -> Iterator[Expr]:
    yield expr
    if level < 6:
        children = _children(expr) or getattr(expr, "args", ())
        base = getattr(expr, "base", None)
        for child in (*children, *((base,) if base is not None else ())):
            yield from _inside(child, level + 1)


def _spelled(expr: Expr) -> str | None:
    return expr.name if isinstance(expr, Name) else None


def _is_constant(expr: Expr, read: ReadSite) -> bool:
    match expr:
        case Num():
            return True
        case Name(name=name):
            last = name.rpartition(".")[2]
            return (
                algebra.is_tiny(expr)
                or last.isupper()
                or last.lower() in ("inf", "infinity")
                or name == read.roles.get("sample_size")
            )
        case Op(op="neg" | "sub" | "add" | "mul" | "div", args=args):
            return all(_is_constant(one, read) for one in args)
        case Item():
            return algebra.is_tiny(expr)
    return algebra.is_tiny(expr)
