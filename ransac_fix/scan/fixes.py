"""Changes to Python source that make a rule exact.

A fix replaces the power by a call of a small function that it adds to the file, and touches
nothing else: guards, rounding and limits stay as they are. It needs both counts where the power
stands, with the values that the ratio was made of. Text outside of the edits is never written
anew, so formatting, comments, line ends and encoding stay.
"""

import ast
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from ransac_fix.scan import algebra
from ransac_fix.scan.algebra import Counts
from ransac_fix.scan.findings import Edit, Fix, Location
from ransac_fix.scan.form import Expr, Fn, Item, Name, Op, Ref, Span
from ransac_fix.scan.python import tree
from ransac_fix.scan.reading import ReadSite, Text, spell

HELPER = "_all_inlier_probability"
_HELPER_SOURCE = f'''\
def {HELPER}(n_inliers, n_samples, sample_size):
    """Return the probability that all of sample_size distinct samples are inliers.

    With fewer inliers than a sample takes there is none; the factors stop at one then, so that
    the number of trials made of this stays finite; and 1 - p is less than 1 in a float.
    """
    p = 1.0
    for i in range(int(sample_size)):
        p *= max(n_inliers - i, 1) / max(n_samples - i, 1)
    return max(p, 2.0**-53)
'''

_COUNT_NAME = re.compile(
    r"(?:^|_|\b)(?:n|N|num|count|number|total|size|len)(?:_|\b|$)|(?:^|_)n[_A-Z]|^[nN]\w{0,4}$"
    r"|inliers?$|points?$|samples$|matches$|pts$",
)


def fix_probability(read: ReadSite, text: Text, path: str) -> Fix | str:
    """Replace the power of a site, or say why that cannot be done."""
    site = read.site
    probability = site.probability
    alone = probability.constant == 1.0 and not probability.other_factors
    target = algebra.plain(site.assumed) if alone else probability.power
    if target is None or target.span is None:
        return "the power is not written in one place"
    size = read.roles.get("sample_size")
    if not size:
        return "the sample size cannot be spelled here"
    flow = _flow_of(text)
    found = _counts(read)
    if found is None:
        return _with_expected_counts(read, text, path, flow, target.span, size)
    inliers, samples = (spell(one, text) for one in (found.n_inliers, found.n_samples))
    if not inliers or not samples:
        return "the counts cannot be spelled here"
    division = found.division.span
    if division is None or not flow.holds_until(f"{inliers} {samples}", division, target.span):
        return "the counts may have changed since the ratio was made of them"
    call = f"{HELPER}({inliers}, {samples}, {size})"
    safe = _is_count(found.n_inliers) and _is_count(found.n_samples)
    edits = _edits(path, flow, target.span, text, call)
    return Fix("use the probability for distinct samples", safe, edits)


def _edits(path: str, flow: "_Flow", span: Span, text: Text, call: str) -> tuple[Edit, ...]:
    edit = Edit(_location(path, span), call)
    if HELPER in {name for name, _ in flow.functions()}:
        return (edit,)
    return (_insertion(path, flow.module, text), edit)


def _with_expected_counts(
    read: ReadSite, text: Text, path: str, flow: "_Flow", span: Span, size: str
) -> Fix | str:
    """Make the counts of an assumed ratio and of the number of data that the sampler draws from."""
    only = "only the ratio of inliers is known here, not the two counts it is made of"
    ratio = read.roles.get("inlier_ratio")
    if read.adaptive or ratio is None:
        return only
    population = _population(read, flow.module, text)
    if population is None or read.draw is None:
        return f"{only}, and not how many data there are"
    if not flow.is_known_at(population, span) or not flow.holds_until(
        population, span, read.draw.span, anywhere=True
    ):
        return f"{only}, and the number of data is not known yet"
    if population == size:
        return "the exponent is the number of data, not the size of a sample"
    call = f"{HELPER}(round({_factor(ratio)} * {_factor(population)}), {population}, {size})"
    return Fix(
        "use the probability for distinct samples, with the number of inliers to be expected",
        safe=False,
        edits=_edits(path, flow, span, text, call),
    )


def _factor(text: str) -> str:
    return text if re.fullmatch(r"[\w.]+(?:\[[\w]+\]|\([\w.]*\))?", text) else f"({text})"


def _population(read: ReadSite, module: ast.Module, text: Text) -> str | None:
    """Spell the number of data that the sampler of a site draws from."""
    call = _call_at(module, read.draw.span, text) if read.draw is not None else None
    if call is None or not isinstance(call.func, ast.Attribute | ast.Name):
        return None
    name = call.func.attr if isinstance(call.func, ast.Attribute) else call.func.id
    arguments = call.args
    if not arguments:
        return None
    match name:
        case "sample" | "choices":
            if isinstance(call.func, ast.Attribute) and ast.unparse(call.func.value) != "random":
                return None
            return _size_of(arguments[0]) or f"len({ast.unparse(arguments[0])})"
        case "choice" | "permutation" | "randperm" | "sample_without_replacement":
            return _size_of(arguments[0])
        case "randint" | "integers" | "random_integers":
            ends = arguments[:2]
            single = isinstance(call.func, ast.Name) or ast.unparse(call.func.value) == "random"
            if len(ends) == 2 and ast.unparse(ends[0]) != "0":
                return None
            return _one_more(ends[-1]) if single else ast.unparse(ends[-1])
        case "randrange":
            return ast.unparse(arguments[0]) if len(arguments) == 1 else None
    return None


def _size_of(node: ast.expr) -> str | None:
    """Spell how many entries ``range(n)``, ``arange(n)`` or a number of data stands for."""
    match node:
        case ast.Call(func=ast.Name(id="range") | ast.Attribute(attr="arange"), args=[size]):
            return ast.unparse(size)
        case ast.Call(func=ast.Name(id="range") | ast.Attribute(attr="arange"), args=[low, size]):
            return ast.unparse(size) if ast.unparse(low) == "0" else None
        case ast.Call(func=ast.Name(id="len")) | ast.Attribute(attr="size"):
            return ast.unparse(node)
        case ast.Subscript(value=ast.Attribute(attr="shape")):
            return ast.unparse(node)
    return None


def _one_more(node: ast.expr) -> str | None:
    """Read n out of n - 1, the largest index."""
    match node:
        case ast.BinOp(left=left, op=ast.Sub(), right=ast.Constant(value=1)):
            return ast.unparse(left)
    return None


def _counts(read: ReadSite) -> Counts | None:
    probability = read.site.probability
    if probability.n_inliers is not None and probability.n_samples is not None:
        if probability.ratio is not None:
            own = algebra.counts_of(probability.ratio)
            if own is not None:
                return own
        match algebra.plain(read.site.assumed):
            case Op(op="div", args=(top, bottom)) as assumed:  # I**k / n**k
                match algebra.plain(top), algebra.plain(bottom):
                    case Op(op="pow", args=(one, _)), Op(op="pow", args=(other, _)):
                        return Counts(one, other, assumed)
        return None
    return algebra.counts_of(probability.ratio) if probability.ratio is not None else None


def _is_count(expr: Expr) -> bool:
    """Whether an expression is an integer by what it is, or by its name where it is a parameter."""
    match expr:
        case Fn(name="count"):
            return True
        case Fn(name="same", args=(inner, *_)):
            return _is_count(inner)
        case Ref(name=name, value=value):
            if isinstance(value, Name):  # a parameter
                return bool(_COUNT_NAME.search(name.rpartition(".")[2]))
            return _is_count(value) or bool(_COUNT_NAME.search(name.rpartition(".")[2]))
        case Name(name=name):
            return name.endswith((".size", ".shape")) or bool(
                _COUNT_NAME.search(name.rpartition(".")[2])
            )
        case Item(base=base):
            plain = algebra.plain(base)
            return isinstance(plain, Name) and plain.name.endswith(".shape")
        case Op(op="add" | "sub", args=args):
            return all(_is_count(arg) or algebra.number(arg) is not None for arg in args)
    return False


def fix_sampler(read: ReadSite, text: Text, path: str) -> Fix | str:
    """Make the sampler of a site draw distinct samples, or say why that cannot be done."""
    if read.draw is None:
        return "the sampler was not found"
    call = _call_at(_flow_of(text).module, read.draw.span, text)
    if call is None or not isinstance(call.func, ast.Attribute):
        return "the sampler has no form that draws distinct samples"
    span = read.draw.span
    base = ast.unparse(call.func.value)
    names = {word.arg: word.value for word in call.keywords}

    def whole(content: str) -> Fix:
        edit = Edit(_location(path, span), content)
        return Fix("draw distinct samples", safe=False, edits=(edit,))

    arguments = [ast.unparse(argument) for argument in call.args]
    match call.func.attr:
        case "choice":
            words = [f"{word.arg}={ast.unparse(word.value)}" for word in call.keywords]
            words = [word for word in words if not word.startswith("replace=")]
            return whole(f"{base}.choice({', '.join([*arguments[:2], *words, 'replace=False'])})")
        case "choices" if "k" in names and len(arguments) == 1 and "weights" not in names:
            return whole(f"{base}.sample({arguments[0]}, k={ast.unparse(names['k'])})")
        case "randint" | "integers" if base != "torch" and not {"endpoint", "dtype"} & set(names):
            size = arguments[2] if len(arguments) > 2 else None
            if "size" in names:
                size = ast.unparse(names["size"])
            low, high = ("0", arguments[0]) if len(arguments) == 1 else arguments[:2]
            if size is not None and low == "0":
                return whole(f"{base}.choice({high}, size={size}, replace=False)")
    return "the sampler has no form that draws distinct samples"


def _call_at(module: ast.Module, span: Span, text: Text) -> ast.Call | None:
    for node in ast.walk(module):
        if isinstance(node, ast.Call) and _span(node, text) == span:
            return node
    return None


def _span(node: ast.expr | ast.stmt, text: Text) -> Span:
    end = node.end_lineno or node.lineno
    return Span(
        node.lineno,
        _character(text, node.lineno, node.col_offset),
        end,
        _character(text, end, node.end_col_offset or 0),
    )


def _character(text: Text, line: int, column: int) -> int:
    """Turn a column in bytes, as ``ast`` counts, into one in characters."""
    own = text.lines[line - 1]
    return column if own.isascii() else len(own.encode()[:column].decode("utf-8", "replace"))


# ---- where values hold ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """A statement, and the block it stands in."""

    node: ast.stmt
    block: int
    index: int
    parent: "_Step | None"


@lru_cache(maxsize=1)
def _flow_of(text: Text) -> "_Flow":
    return _Flow(tree(text.source), text)


class _Flow:
    """The statements of a module, to see whether a value still holds somewhere else."""

    def __init__(self, module: ast.Module, text: Text) -> None:
        self.module = module
        self._text = text
        self._steps: list[_Step] = []
        self._read(module.body, None)

    def _read(self, body: Sequence[ast.stmt], parent: _Step | None) -> None:
        for index, node in enumerate(body):
            step = _Step(node, id(body), index, parent)
            self._steps.append(step)
            for name in ("body", "orelse", "finalbody"):
                self._read(getattr(node, name, []), step)
            for handler in getattr(node, "handlers", []):
                self._read(handler.body, step)
            for case in getattr(node, "cases", []):
                self._read(case.body, step)

    def functions(self) -> Iterator[tuple[str, ast.stmt]]:
        """Yield the functions of the module itself."""
        for node in self.module.body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield node.name, node

    def is_known_at(self, names_in: str, span: Span) -> bool:
        """Whether the names in a text have a value at a place, by what stands before it."""
        step = self._at(span)
        if step is None:
            return False
        function = _function(step)
        known = {name for name, _ in self.functions()} | {"len"}
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = function.args
            every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
            known |= {argument.arg for argument in every}
        start = function.lineno if function is not None else 0
        for node in ast.walk(self.module):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                inside = start <= node.lineno < span.line
                if inside and self._dominates_line(node.lineno, step):
                    known.add(node.id)
        bare = re.sub(r"\.\s*\w+", "", names_in)  # attributes belong to what they are of
        return set(re.findall(r"[A-Za-z_]\w*", bare)) <= known

    def _dominates_line(self, line: int, last: "_Step") -> bool:
        return any(
            step.node.lineno <= line <= (step.node.end_lineno or line) and _dominates(step, last)
            for step in self._steps
            if not isinstance(step.node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        )

    def holds_until(self, names_in: str, start: Span, end: Span, *, anywhere: bool = False) -> bool:
        """Whether the names in a text mean the same at ``end`` as at ``start``.

        With ``anywhere`` the end may also be in a branch or loop that is not always reached.
        """
        if (start.line, start.column) >= (end.line, end.column) and (
            start.end_line,
            start.end_column,
        ) <= (end.end_line, end.end_column):
            return True  # the one stands inside the other
        first, last = self._at(start), self._at(end)
        if first is None or last is None or _function(first) is not _function(last):
            return False
        if not anywhere and not _dominates(first, last):
            return False
        names = set(re.findall(r"[A-Za-z_]\w*", names_in))
        loops = [
            step.node
            for step in _ancestors(last)
            if isinstance(step.node, ast.For | ast.While) and step not in _ancestors(first)
        ]
        for node, line, column in self._writes(names):
            between = (start.line, start.column) < (line, column) < (end.line, end.column)
            looped = any(loop.lineno <= line <= (loop.end_lineno or line) for loop in loops)
            own = first.node.lineno <= line <= (first.node.end_lineno or line)
            if (between or looped) and not own and node is not first.node:
                return False
        return True

    def _writes(self, names: set[str]) -> Iterator[tuple[ast.AST, int, int]]:
        for node in ast.walk(self.module):
            written = (isinstance(node, ast.Name) and node.id in names) or (
                isinstance(node, ast.Attribute) and node.attr in names
            )
            if written and isinstance(node.ctx, ast.Store | ast.Del):  # type: ignore[attr-defined]
                yield node, node.lineno, node.col_offset  # type: ignore[attr-defined]

    def _at(self, span: Span) -> _Step | None:
        """Find the innermost statement that holds a span."""
        best: _Step | None = None
        for step in self._steps:
            line, column, end_line, end_column = _span(step.node, self._text)
            starts = (line, column) <= (span.line, span.column)
            if starts and (span.end_line, span.end_column) <= (end_line, end_column):
                best = step  # inner statements come after the one they stand in
        return best


def _ancestors(step: _Step) -> list[_Step]:
    found: list[_Step] = []
    current: _Step | None = step
    while current is not None:
        found.append(current)
        current = current.parent
    return found


def _function(step: _Step) -> ast.stmt | None:
    for above in _ancestors(step):
        if isinstance(above.node, ast.FunctionDef | ast.AsyncFunctionDef):
            return above.node
    return None


def _dominates(first: _Step, last: _Step) -> bool:
    """Whether ``first`` has always run, in the same run of its block, when ``last`` does."""
    return any(
        above.block == first.block and above.index >= first.index for above in _ancestors(last)
    )


# ---- edits ----------------------------------------------------------------------------------


def _location(path: str, span: Span) -> Location:
    return Location(path, span.line, span.column + 1, span.end_line, span.end_column + 1)


def _insertion(path: str, module: ast.Module, text: Text) -> Edit:
    """Put the function after the imports that open the module, once for all that use it."""
    node = next((one for one in module.body if not _opens(one)), module.body[0])
    decorators = [one.lineno for one in getattr(node, "decorator_list", [])]
    line = first = min([node.lineno, *decorators])
    while line > 1 and text.lines[line - 2].startswith("#"):
        line -= 1  # comments above belong to what they stand above
    if line == 1:
        line = first  # ... but a coding line or a licence opens the file
    blank = "" if line == 1 or not text.lines[line - 2].strip() else "\n\n"
    content = f"{blank}{_HELPER_SOURCE}\n\n".replace("\n", text.line_end)
    return Edit(Location(path, line, 1, line, 1), content)


def _opens(node: ast.stmt) -> bool:
    """Whether a statement belongs to the opening of a module: docstring, imports, their guards."""
    match node:
        case ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant(value=str())):
            return True
        case ast.Try(body=body) | ast.If(body=body):
            return all(isinstance(one, ast.Import | ast.ImportFrom) for one in body)
    return False


def apply_edits(source: str, edits: Iterable[Edit]) -> str:
    """Make changes to a text; of the same edit twice one is made, and so of two that overlap."""
    starts = [0, *(found.end() for found in re.finditer(r"\r\n|\r|\n", source))]
    pieces: list[str] = []
    done = 0
    spans = {
        (
            starts[edit.location.start_line - 1] + edit.location.start_column - 1,
            starts[edit.location.end_line - 1] + edit.location.end_column - 1,
            edit.content,
        )
        for edit in edits
    }
    for start, end, content in sorted(spans):
        if start >= done:
            pieces += [source[done:start], content]
            done = end
    return "".join([*pieces, source[done:]])
