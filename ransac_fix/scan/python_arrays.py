"""Which expressions of a Python file are arrays, or lists, by what the file says of them.

A fix passes counts to a function of numbers. Where the file computes with many counts at once, for
a plot or a table, what it passes would be an array.
"""

import ast
import re
from collections.abc import Sequence
from typing import TypeAlias

_ANNOTATED = re.compile(
    r"ndarray|NDArray|ArrayLike|Tensor|Series|\bArray|\b[Ll]ist\b|\b[Tt]uple\b|Sequence|Iterable"
)
# Functions that give arrays.
_MAKES = frozenset(
    (
        *("arange", "array", "asarray", "argsort", "bincount", "concatenate", "cumprod", "cumsum"),
        *("diff", "empty", "flatnonzero", "from_numpy", "full", "full_like", "geomspace", "hstack"),
        *("histogram", "linspace", "list", "logspace", "nonzero", "ones", "ones_like", "range"),
        *("sort", "sorted", "stack", "tensor", "tolist", "tuple", "unique", "vstack", "zeros"),
        *("value_counts", "zeros_like", "as_tensor", "repeat", "tile", "cat", "meshgrid"),
    )
)
# Those that give one number of an array, but along an axis an array.
_REDUCES = frozenset(
    (
        *("all", "amax", "amin", "any", "count_nonzero", "max", "mean", "median", "min", "nansum"),
        *("prod", "sum"),
    )
)
# Those that give for each entry of an array one entry.
_KEEPS = frozenset(
    (
        *("abs", "absolute", "astype", "ceil", "clamp", "clip", "copy", "cpu", "detach", "divide"),
        *("double", "exp", "flatten", "float", "floor", "int", "long", "log", "maximum", "minimum"),
        *("multiply", "numpy", "power", "ravel", "reshape", "rint", "round", "sqrt", "square"),
        *("squeeze", "subtract", "to", "true_divide", "where", "add", "float32", "float64"),
    )
)
# Those that give several arrays, one for each name.
_SEVERAL = frozenset(("histogram", "meshgrid", "nonzero", "sort", "topk", "unique", "where"))
_AXES = ("axis", "dim")
_MODULES = ("np", "numpy", "torch", "jnp", "cp")

Scope: TypeAlias = ast.Module | ast.FunctionDef | ast.AsyncFunctionDef


class Arrays:
    """What is an array in a place of a file.

    Parameters
    ----------
    scopes : sequence of ast.Module, ast.FunctionDef or ast.AsyncFunctionDef
        What the place stands in, from the inside.
    """

    def __init__(self, scopes: Sequence[Scope]) -> None:
        self._scopes = scopes
        self._seen: set[str] = set()

    def has(self, node: ast.expr) -> bool:
        """Whether an expression is an array, by how it is written and what its names are."""
        match node:
            case ast.Name(id=name):
                return self._has_name(name)
            case ast.List() | ast.Tuple() | ast.ListComp() | ast.Set() | ast.SetComp():
                return True
            case ast.BinOp(left=left, right=right):
                return self.has(left) or self.has(right)
            case ast.UnaryOp(operand=operand):
                return self.has(operand)
            case ast.Compare(left=left, comparators=others):
                return any(map(self.has, (left, *others)))
            case ast.IfExp(body=body, orelse=other):
                return self.has(body) or self.has(other)
            case ast.Subscript(value=base, slice=index):
                parts = index.elts if isinstance(index, ast.Tuple) else [index]
                several = any(isinstance(one, ast.Slice | ast.Compare) for one in parts)
                return several and self.has(base)
            case ast.Attribute(value=base, attr="T" | "values" | "real" | "data"):
                return self.has(base)
            case ast.Call():
                return self._has_call(node)
        return False

    def _has_name(self, name: str) -> bool:
        if name in self._seen:
            return False  # it is made of itself
        self._seen.add(name)
        for scope in self._scopes:
            if _is_tested(name, scope):
                return False
            kinds, values = _set_to(name, scope)
            if any(map(_ANNOTATED.search, kinds)) or any(map(self.has, values)):
                return True
            if kinds or values:
                return False
        return False

    def _has_call(self, node: ast.Call) -> bool:
        function = node.func
        if isinstance(function, ast.Name):
            return function.id in _MAKES
        if not isinstance(function, ast.Attribute):
            return False
        name, base = function.attr, function.value
        of_module = isinstance(base, ast.Name) and base.id in _MODULES
        if name in _REDUCES:
            words = [word.value for word in node.keywords if word.arg in _AXES]
            axes = [*words, *node.args[of_module:]]
            return any(not (isinstance(one, ast.Constant) and one.value is None) for one in axes)
        if name in _KEEPS:
            return any(map(self.has, node.args if of_module else [base, *node.args]))
        return name in _MAKES


def _is_tested(name: str, scope: Scope) -> bool:
    """Whether a branch or a loop compares a name by itself, which no array can stand."""
    tests = [one.test for one in ast.walk(scope) if isinstance(one, ast.If | ast.While | ast.IfExp)]
    for test in tests:
        match test:
            case ast.BoolOp(values=values):
                tests += values
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                tests.append(operand)
            case ast.Compare(left=left, ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE()]):
                sides = (left, *test.comparators)
                if any(isinstance(one, ast.Name) and one.id == name for one in sides):
                    return True
    return False


def _set_to(name: str, scope: Scope) -> tuple[list[str], list[ast.expr]]:
    """Give the annotations of a name in a scope, and what it is set to there."""
    kinds: list[str] = []
    values: list[ast.expr] = []
    for node in ast.walk(scope):
        match node:
            case ast.arg(arg=own) if own == name:
                kinds.append("" if node.annotation is None else ast.unparse(node.annotation))
            case ast.AnnAssign(target=ast.Name(id=own), annotation=kind) if own == name:
                kinds.append(ast.unparse(kind))
                values += [] if node.value is None else [node.value]
            case ast.Assign(targets=targets, value=value):
                for target in targets:
                    values += _part(name, target, value)
    return kinds, values


def _part(name: str, target: ast.expr, value: ast.expr) -> list[ast.expr]:
    """Give what a name gets of an assignment."""
    if isinstance(target, ast.Name):
        return [value] if target.id == name else []
    if not isinstance(target, ast.Tuple | ast.List):
        return []
    parts = value.elts if isinstance(value, ast.Tuple | ast.List) else []
    if len(parts) == len(target.elts):
        return [
            part
            for one, own in zip(target.elts, parts, strict=True)
            for part in _part(name, one, own)
        ]
    named = any(isinstance(one, ast.Name) and one.id == name for one in target.elts)
    function = getattr(value, "func", None)
    several = getattr(function, "attr", getattr(function, "id", "")) in _SEVERAL
    return [value] if named and several else []
