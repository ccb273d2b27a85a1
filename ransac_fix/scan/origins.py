"""Where a ratio comes from that has no counts, and what its author could do about it."""

import re

from ransac_fix.scan.form import Choice, Expr, Fn, Name, Num, Op, Ref
from ransac_fix.scan.reading import Text

_STEPS = 24


def origin(ratio: Expr | None, text: Text) -> str:
    """Say where a ratio comes from and what would have to be done there, where that is known."""
    expr = ratio
    for _ in range(_STEPS):
        match expr:
            case Ref(value=value):
                expr = value
            case Fn(name="same", args=(inner, *_)):
                expr = inner
            case _:
                break
    match expr:
        case Num(value=number):
            return f"it is assumed to be {number:g}"
        case Name(name=name) if "." in name:
            return f"it is the member {_member(name, text)}"
        case Fn(name=name, span=span) if name.startswith("?") and span is not None:
            called = f"it is what {name[1:]} gives, called in line {span.line}"
            return f"{called}: let that give the number of inliers too"
        case Fn(name="clamp", span=span) if span is not None:
            return f"it is bounded in line {span.line}: do that to the probability instead"
        case Op(op="add" | "sub" | "mul", span=span) if span is not None and _holds_counts(expr):
            changed = f"it is changed in line {span.line}"
            return f"{changed}, and what it is then is no ratio of two counts"
        case Choice(options=options):
            lines = sorted({one.span.line for one in options if one.span is not None})
            if len(lines) > 1:
                listed = f"{', '.join(map(str, lines[:-1]))} and {lines[-1]}"
                return f"it is set in lines {listed}: keep both counts there"
    return ""


def _member(name: str, text: Text) -> str:
    """Spell a member, and where the file sets it."""
    head, _, last = name.rpartition(".")
    spelled = last if head in ("this", "self") else f"{last} of {head.removeprefix('this.')}"
    sets = re.compile(rf"(?:\.|->|^\s*|\bthis->){re.escape(last)}\s*=[^=]")
    lines = [number for number, line in enumerate(text.lines, 1) if sets.search(line)]
    if not lines:
        return f"{spelled}, which this file does not set: keep both counts beside it"
    where = f"line {lines[0]}" if len(lines) == 1 else f"lines {', '.join(map(str, lines[:4]))}"
    return f"{spelled}, set in {where}: keep both counts beside it"


def _holds_counts(expr: Expr) -> bool:
    match expr:
        case Op(op="div"):
            return True
        case Op(args=args) | Fn(name="same", args=args):
            return any(_holds_counts(arg) for arg in args)
        case Ref(value=value):
            return _holds_counts(value)
    return False
