"""What a fix must know of a file: how values are spelled, where they still hold, how to add to it.

One implementation a language: ``python_source`` and ``cpp_source``. What is decided with these
answers is decided once, in ``fixes``.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal, TypeAlias

from ransac_fix.scan import algebra
from ransac_fix.scan.findings import Edit, FixStyle, Location
from ransac_fix.scan.form import Expr, Fn, Item, Name, Num, Op, Ref, Span
from ransac_fix.scan.reading import Text, spell
from ransac_fix.scan.sampler import Draw

Standing: TypeAlias = Literal["same", "unknown", "changed"]
"""Whether values are the same in two places: surely, for all that is seen, or not."""


_COUNT_NAME = re.compile(
    r"(?:^|_|\b)(?:n|N|num|count|number|total|size|len)(?:_|\b|$)|(?:^|_)n[_A-Z]|^[nN]\w{0,4}$"
    r"|inliers?_?$|points?_?$|samples_?$|matches_?$|pts$",
)
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a call: where it stands, with its keyword if it has one, and its value."""

    span: Span
    value: Span
    keyword: str = ""


@dataclass(frozen=True, slots=True)
class CallSite:
    """A call of a function of the file; no argument where the parameter is left to its default."""

    span: Span
    argument: Argument | None


@dataclass(frozen=True, slots=True)
class Signature:
    """A function whose parameter may be replaced by others.

    Attributes
    ----------
    parameters : tuple of Span
        Where the parameter is declared: the definition, and its other declarations.
    calls : tuple of CallSite
        Every call of it in the file.
    private : bool
        Whether nothing outside of the file can call it.
    declared : str
        How a parameter that holds a number is declared: ``{}``, or ``double {}``.
    body : Span
        The empty place before its first statement.
    statement : str
        How that statement is written, with ``{name}`` and ``{value}``.
    names : frozenset of str
        Every name used in it.
    uses : tuple of Span
        Where the function uses the parameter.
    """

    parameters: tuple[Span, ...]
    calls: tuple[CallSite, ...]
    private: bool
    declared: str
    body: Span
    statement: str
    names: frozenset[str]
    uses: tuple[Span, ...]


class Source(ABC):
    """A file that may be fixed."""

    comment_marks: ClassVar[tuple[str, ...]]
    """What begins a comment."""

    def __init__(self, text: Text) -> None:
        self.text = text

    @abstractmethod
    def standing(
        self, exprs: Sequence[Expr], start: Span, end: Span, *, anywhere: bool = False
    ) -> Standing:
        """Say whether expressions mean the same at ``end`` as where they were used, at ``start``.

        With ``anywhere`` the end may also be in a branch or loop that is not always reached.
        """

    @abstractmethod
    def probability(self, n_inliers: str, n_samples: str, sample_size: str, power: Span) -> str:
        """Spell the exact probability, in place of the power at ``power``."""

    @abstractmethod
    def support(self, power: Span, path: str) -> tuple[Edit, ...] | str:
        """Give what else the file needs for that, or say why it cannot have it."""

    @abstractmethod
    def is_repeatable(self, expr: Expr) -> bool:
        """Whether an expression may be evaluated once more: it is cheap and changes nothing."""

    @abstractmethod
    def signature(self, function: Span, parameter: str) -> Signature | str:
        """Find what changes with a parameter of a function, or say why it cannot change."""

    @abstractmethod
    def sole_definition(self, name: str, place: Span) -> tuple[Span, tuple[Span, ...]] | None:
        """Find the one statement that defines a variable of the function around ``place``.

        Returns its place and those of all uses of the variable, the definition's own among them;
        None where there is no such statement, or where it does more than that.
        """

    @abstractmethod
    def quotient(self, n_inliers: str, n_samples: str) -> str:
        """Spell the ratio of two numbers."""

    def is_array(self, expr: Expr, place: Span) -> bool:
        """Whether an expression of a place is an array of numbers, for all that is seen."""
        del expr, place
        return False

    def declared_count(self, name: str, near: Span | None) -> bool | None:
        """Say whether a name is declared as an integer; None where the language does not say."""
        del name, near
        return None

    def population(self, draw: Draw, place: Span) -> tuple[str, bool] | None:
        """Spell the number of data that a sampler draws from; say whether ``place`` knows it."""
        del draw, place
        return None

    def distinct_draw(self, draw: Draw, path: str) -> tuple[Edit, ...] | str:
        """Give the edits that make a sampler draw distinct samples, or say why there are none."""
        del draw, path
        return "the sampler has no form that draws distinct samples"

    def unused_without(self, expr: Expr, place: Span, new: str, path: str) -> tuple[Edit, ...]:
        """Take away the definitions in ``expr`` of what is used in ``place`` only, and not in new.

        ``place`` is where ``new`` will stand. What the power was made of is used by nothing then,
        and compilers and linters warn of that.
        """
        dead = [place]
        kept = set(re.findall(r"\w+", new))
        edits: list[Edit] = []
        for name in dict.fromkeys(names_in(expr)):
            found = None if name in kept else self.sole_definition(name, place)
            if found is None:
                continue
            own, uses = found
            if not all(any(is_inside(use, one) for one in (*dead, own)) for use in uses):
                continue
            rest = self.text.lines[own.end_line - 1][own.end_column :].strip()
            lead = self.text.lines[own.line - 1][: own.column].strip()
            if lead or (rest and not rest.startswith(self.comment_marks)):
                continue
            gone = Span(own.line, 0, own.end_line + 1, 0) if not rest else own
            dead.append(own)
            edits.append(self.edit(gone, "", path))
        return tuple(edits)

    def spell(self, expr: Expr) -> str | None:
        """Spell an expression as the file does, without what makes a float of a count."""
        match expr:
            case Fn(name="same", args=(inner, *_)):
                return self.spell(inner)
            case Op(op="mul", args=(left, right)):
                if algebra.number(left) == 1.0:
                    return self.spell(right)
                if algebra.number(right) == 1.0:
                    return self.spell(left)
                return spell(expr, self.text)
            case Op(op="add" | "sub" as operator, args=(left, right)) if expr.span is None:
                parts = self.spell(left), self.spell(right)
                sign = "+" if operator == "add" else "-"
                return f"{parts[0]} {sign} {parts[1]}" if all(parts) else None
        return spell(expr, self.text)

    def is_count(self, expr: Expr) -> bool:
        """Whether an expression is an integer by what it is, its declaration, or its name."""
        match expr:
            case Fn(name="count", span=span):
                # A sum along an axis is an array of counts.
                return span is None or not re.search(r"\b(?:axis|dim)\b", self.text.at(span))
            case Fn(name="same", args=(inner, *_)):
                return self.is_count(inner)
            case Fn(name=name) if name.startswith("?"):
                return _is_count_name(name[1:])
            case Ref(name=name, value=value, span=span):
                declared = self.declared_count(name, span)
                if declared is not None:
                    return declared
                if not isinstance(value, Name) and self.is_count(value):
                    return True
                return _is_count_name(name)
            case Name(name=name, span=span):
                declared = self.declared_count(name, span)
                if declared is not None:
                    return declared
                return name.endswith((".size", ".shape")) or _is_count_name(name)
            case Num(value=value):
                return value == int(value)
            case Item(base=base, span=span):
                plain = algebra.plain(base)
                if isinstance(plain, Name) and plain.name.endswith(".shape"):
                    return True
                name = base.name if isinstance(base, Ref | Name) else ""
                declared = self.declared_count(name, span)
                return bool(declared) if declared is not None else _is_count_name(name)
            case Op(op="mul", args=(left, right)):
                return (algebra.number(left) == 1.0 and self.is_count(right)) or (
                    algebra.number(right) == 1.0 and self.is_count(left)
                )
            case Op(op="add" | "sub", args=args):
                return all(self.is_count(arg) for arg in args)
        return False

    def location(self, span: Span, path: str) -> Location:
        """Give a span as a location of this file."""
        return Location(path, span.line, span.column + 1, span.end_line, span.end_column + 1)

    def edit(self, span: Span, content: str, path: str) -> Edit:
        """Give the edit that puts ``content`` into a place of this file."""
        return Edit(self.location(span, path), content.replace("\n", self.text.line_end))


def is_inside(inner: Span, outer: Span) -> bool:
    """Whether a place is a part of another, or the same."""
    return (inner.line, inner.column) >= (outer.line, outer.column) and (
        inner.end_line,
        inner.end_column,
    ) <= (outer.end_line, outer.end_column)


def names_in(expr: Expr) -> tuple[str, ...]:
    """Give the names that an expression is worked out through, the outermost first."""
    match expr:
        case Ref(name=name, value=value):
            return (name, *names_in(value))
        case Op(args=args):
            return tuple(name for arg in args for name in names_in(arg))
        case Fn(name="same" | "clamp", args=args):
            return tuple(name for arg in args for name in names_in(arg))
    return ()


def _is_count_name(name: str) -> bool:
    last = name.rpartition(".")[2]
    return bool(_COUNT_NAME.search(last) or _COUNT_NAME.search(_CAMEL.sub("_", last).lower()))


@lru_cache(maxsize=2)
def source_of(text: Text, language: str, path: str, style: FixStyle) -> Source | str:
    """Read a file for fixing, or say why its language is not fixed."""
    if language in ("python", "notebook"):
        from ransac_fix.scan.python_source import PythonSource

        cells = language == "notebook"
        return PythonSource(text, style=style, cells=text.cells if cells else None)
    if language == "c++":
        from ransac_fix.scan.cpp_source import CppSource

        if "\r" in text.source.replace("\r\n", ""):
            return "its lines end with carriage returns alone"
        return CppSource(text, path)
    return f"fixes are not written into {language} files"
