"""What a file says about each of its sites: roles, sampler, use, and how sure we are."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ransac_fix.scan import algebra, words
from ransac_fix.scan.findings import Certainty
from ransac_fix.scan.form import (
    Assign,
    Choice,
    Expr,
    Fn,
    Function,
    If,
    Item,
    Loop,
    Module,
    Name,
    Num,
    Op,
    Over,
    Ref,
    Span,
    Stmt,
)
from ransac_fix.scan.python import split_lines
from ransac_fix.scan.recogniser import Site
from ransac_fix.scan.sampler import Draw, draws, law_for, same_function
from ransac_fix.scan.walk import inside

_LEVELS: tuple[Certainty, ...] = ("low", "medium", "high")
_RANDOM = ("random", "rand", "next_double", "uniform", "standard_exponential", "exponential")


@dataclass(frozen=True, slots=True, eq=False)
class ReadSite:
    """A site, read in its file.

    Attributes
    ----------
    site : Site
    roles : mapping
        Source text of each role that was recognised.
    certainty : {"high", "medium", "low"} or None
        None where nothing speaks for RANSAC: the same algebra, used for something else.
    adaptive : bool
        Whether the rule is worked out again as inliers are found, or once from an assumed ratio.
    sampler : {"distinct", "replacement", "weighted", "unknown"}
    draw : Draw or None
        Where the minimal sample is drawn.
    near_draw : bool
        Whether that is in the function of the rule or in one that calls it.
    expression : str
        The source of the site on one line.
    """

    site: Site
    roles: Mapping[str, str]
    certainty: Certainty | None
    adaptive: bool
    sampler: str
    draw: Draw | None
    near_draw: bool
    expression: str


class Text:
    """The source of a file, by lines; of a notebook with the cell of each line."""

    def __init__(self, source: str, cells: Sequence[int] = ()) -> None:
        self.source = source
        self.cells = cells
        self.lines = split_lines(source)
        self.line_end = "\r\n" if "\r\n" in source else "\n"

    def at(self, span: Span) -> str:
        """Give the source of a span on one line."""
        if span.line == span.end_line:
            return self.lines[span.line - 1][span.column : span.end_column]
        first = self.lines[span.line - 1][span.column :]
        last = self.lines[span.end_line - 1][: span.end_column]
        parts = [first, *self.lines[span.line : span.end_line - 1], last]
        return " ".join(part.strip() for part in parts)

    def block(self, span: Span) -> str:
        """Give the whole lines of a span."""
        return "\n".join(self.lines[span.line - 1 : span.end_line])


def read_sites(
    sites: list[Site], whole: Callable[[], Module], text: Text, path: str
) -> list[ReadSite]:
    """Read each site in its file.

    Parameters
    ----------
    sites : list of Site
    whole : callable
        Gives the whole file in the small form: the sampler may stand where no rule could.
    text : Text
    path : str
    """
    if not sites:
        return []
    all_draws = draws(whole())
    file_speaks = words.speaks_strongly(text.source) or words.speaks_strongly(path)
    file_whispers = words.speaks_weakly(text.source) or words.speaks_weakly(path)
    out: list[ReadSite] = []
    for site in sites:
        near = [site.function, *(candidate.function for candidate in site.seen)]
        owner = site.function.owner if site.function else None
        law, draw = law_for(all_draws, near, owner)
        out.append(
            ReadSite(
                site,
                roles_of(site, text),
                _certainty(site, text, file_speaks=file_speaks, file_whispers=file_whispers),
                _is_adaptive(site),
                law,
                draw,
                draw is not None and any(same_function(draw.function, one) for one in near),
                text.at(site.span),
            )
        )
    return out


def roles_of(site: Site, text: Text) -> dict[str, str]:
    """Spell what a site names, as its file does."""
    probability = site.probability
    roles: dict[str, str] = {}
    n_inliers, n_samples = probability.n_inliers, probability.n_samples
    counts = algebra.counts_of(probability.ratio) if probability.ratio is not None else None
    if n_inliers is None and counts is not None:
        n_inliers, n_samples = counts.n_inliers, counts.n_samples
    for name, expr in (
        ("inlier_ratio", _ratio(site)),
        ("n_inliers", n_inliers),
        ("n_samples", n_samples),
        ("sample_size", probability.exponent),
        ("confidence", site.confidence),
        ("trials", site.trials),
    ):
        spelled = spell(expr, text) if expr is not None else None
        if name == "sample_size" and expr is None and probability.exponent_value is not None:
            spelled = f"{probability.exponent_value:g}"  # w*w*w
        if spelled:
            roles[name] = spelled
    return roles


def _ratio(site: Site) -> Expr | None:
    """Give the ratio of a site; where only its counts were raised, what was multiplied."""
    probability = site.probability
    if probability.ratio is None or probability.ratio is not probability.n_inliers:
        return probability.ratio
    match algebra.plain(site.assumed):
        case Op(op="mul", args=(_, Ref() as factor)):  # w*w, of w = I/n
            return factor
    return None


def spell(expr: Expr, text: Text) -> str | None:
    """Spell an expression as the file does: by its name, or by its source."""
    if isinstance(expr, Ref) and (expr.span is None or expr.span.line != expr.span.end_line):
        return expr.name
    if isinstance(expr, Fn) and expr.name == "same":
        return spell(expr.args[0], text)
    if isinstance(expr, Num):
        return f"{expr.value:g}"
    if expr.span is not None:
        source = " ".join(text.at(expr.span).split())
        return source if len(source) <= 120 else None
    if isinstance(expr, Op) and expr.op == "sub":
        parts = [spell(arg, text) for arg in expr.args]
        return f"{parts[0]} - {parts[1]}" if all(parts) else None
    name = getattr(expr, "name", None)
    return name if isinstance(name, str) else None


def _certainty(
    site: Site, text: Text, *, file_speaks: bool, file_whispers: bool
) -> Certainty | None:
    probability = site.probability
    for expr in (probability.ratio, probability.exponent):
        if expr is not None and any(_draws_chance(part) for part in _parts(expr, 6)):
            return None  # log(u)/log(1 - p**u) makes a random number
    around = text.at(site.span)
    if site.function is not None:
        around += text.block(site.function.span)
    around += " ".join(roles_of(site, text).values())
    if words.speaks_strongly(around):
        level = 2
    elif file_speaks:
        level = 1
    elif file_whispers:
        level = 0
    else:
        return None
    if probability.constant != 1.0 or probability.other_factors:
        level -= 1
    if site.form != "quotient" and level < 2:
        level -= 1
    if words.speaks_of_other(around):
        level -= 2
    return _LEVELS[level] if level >= 0 else None


def _draws_chance(expr: Expr) -> bool:
    return isinstance(expr, Fn) and expr.name.startswith("?") and expr.name[1:] in _RANDOM


def _parts(expr: Expr, levels: int) -> Iterator[Expr]:
    yield expr
    if levels == 0:
        return
    children: tuple[Expr, ...] = ()
    match expr:
        case Ref(value=value):
            children = (value,)
        case Op(args=args):
            children = args
        case Fn(name=name, args=args) if not name.startswith("?") and name != "count":
            children = args
        case Choice(options=options):
            children = options
        case Item(base=base):
            children = (base,)
        case Over(body=body):
            children = (body,)
        case _:
            pass
    for child in children:
        yield from _parts(child, levels - 1)


def _is_adaptive(site: Site) -> bool:
    """Whether the inlier ratio is found by the run itself."""
    if site.form != "quotient" or any(candidate.loops for candidate in site.seen):
        return True
    if site.function is not None and _bounds_a_later_loop(site, site.function.body):
        return False  # even of counts: what is counted once, before any sample, is an assumption
    ratio = site.probability.ratio
    for probability in (site.probability, *site.called_with):
        own = probability.ratio
        if own is not None and algebra.counts_of(own) is not None:
            return True
    if site.probability.n_inliers is not None:
        return True
    # A function of the ratio that nothing here calls: what it is called with is not known, and a
    # ratio that is a parameter without a default may be anything.
    called = any(candidate.call is not None for candidate in site.seen)
    if called or site.function is None or ratio is None:
        return False
    if algebra.number(ratio) is not None or _loops(site.function.body):
        return False  # a function that loops itself makes its budget first
    return _is_required(ratio, site.function)


def _bounds_a_later_loop(site: Site, body: tuple[Stmt, ...]) -> bool:
    """Whether what a rule gives is how often a loop behind it runs."""
    names = {one.target for one in site.seen if one.call is None and one.target is not None}

    def speaks(expr: Expr | None) -> bool:
        return expr is not None and any(
            isinstance(part, Name) and part.name in names for part in inside(expr)
        )

    def found(statements: tuple[Stmt, ...]) -> bool:
        for stmt in statements:
            match stmt:
                case Assign(target=str() as target, value=value) if speaks(value):
                    names.add(target)
                case If():
                    if found(stmt.body) or found(stmt.orelse):
                        return True
                case Loop(source=source, test=test, span=span):
                    if span.line > site.span.line and (speaks(source) or speaks(test)):
                        return True
        return False

    return bool(names) and found(body)


def _loops(body: tuple[Stmt, ...]) -> bool:
    return any(
        isinstance(stmt, Loop)
        or (isinstance(stmt, If) and (_loops(stmt.body) or _loops(stmt.orelse)))
        for stmt in body
    )


def _is_required(ratio: Expr, function: Function) -> bool:
    required = {one.name for one in function.parameters if one.default is None}
    return any(getattr(part, "name", None) in required for part in _parts(ratio, 6))
