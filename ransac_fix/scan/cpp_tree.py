"""Syntax trees of C, C++ and CUDA, from the source as it stands before the preprocessor.

Most of what the preprocessor makes of a file can be left to it. Where the parser fails nearby, what
stands for nothing in the language is blanked out and the file is parsed once more: lines that are a
macro by itself, and of a condition all but the first branch. Blanks keep every place where it is.
"""

import re
from collections.abc import Iterator
from functools import lru_cache

import tree_sitter
import tree_sitter_cpp

LANGUAGE = tree_sitter.Language(tree_sitter_cpp.language())

Node = tree_sitter.Node

# A line that is a macro by itself: BEGIN_NAMESPACE(x), IMPLEMENT_DYNAMIC(a, b), MY_NAMESPACE_END
_LONE_MACRO = re.compile(
    rb"^[ \t]*[A-Z][A-Z0-9_]{2,}(?:[ \t]*\([^()\n;{}]*\))?[ \t]*\r?$", re.MULTILINE
)
_DIRECTIVE = re.compile(rb"^[ \t]*#[ \t]*(if|ifdef|ifndef|elif|else|endif)\b[^\n]*", re.MULTILINE)
_NOT_LINE_END = re.compile(rb"[^\r\n]")


def parse(source: bytes) -> Node:
    """Parse a part of a file; where that fails, without what only the preprocessor understands."""
    return _parse_and_blank(source)[0]


@lru_cache(maxsize=1)  # its comments, its code and its fixes are read one after the other
def parse_file(source: bytes) -> tuple[Node, bytes]:
    """Parse a file, and give the source as it was parsed, with blanks."""
    return _parse_and_blank(source)


def _parse_and_blank(source: bytes) -> tuple[Node, bytes]:
    root = _tree(source)
    for without in (_without_lone_macros, _without_branches):
        if not root.has_error:
            break
        errors = list(_errors(root))
        blanked = without(source, errors)
        if blanked == source:
            continue
        other = _tree(blanked)
        if _extent(_errors(other)) < _extent(errors):
            root, source = other, blanked
    return root, source


def _tree(source: bytes) -> Node:
    return tree_sitter.Parser(LANGUAGE).parse(source).root_node


def _errors(root: Node) -> Iterator[tuple[int, int]]:
    """Yield where the parser failed: what it could not make out, or what it missed."""
    stack = [root]
    while stack:
        node = stack.pop()
        if node.is_error or node.is_missing:
            yield node.byte_range
        elif node.has_error:
            stack.extend(node.children)


def _extent(errors: Iterator[tuple[int, int]] | list[tuple[int, int]]) -> int:
    return sum(end - start + 1 for start, end in errors)


def _blank(source: bytes, ranges: list[tuple[int, int]]) -> bytes:
    out = bytearray(source)
    for start, end in ranges:
        out[start:end] = _NOT_LINE_END.sub(b" ", source[start:end])
    return bytes(out)


def _without_lone_macros(source: bytes, errors: list[tuple[int, int]]) -> bytes:
    del errors  # a macro may be far from where the parser notices
    return _blank(source, [found.span() for found in _LONE_MACRO.finditer(source)])


def _without_branches(source: bytes, errors: list[tuple[int, int]]) -> bytes:
    """Blank out the marks of conditions next to errors, and all but their first branches."""
    ranges: list[tuple[int, int]] = []
    opened: list[list[re.Match[bytes]]] = []
    for found in _DIRECTIVE.finditer(source):
        word = found[1]
        if word.startswith(b"if"):
            opened.append([found])
        elif opened:
            opened[-1].append(found)
            if word == b"endif":
                marks = opened.pop()
                if any(_touch(mark.span(), error) for mark in marks for error in errors):
                    ranges += (marks[0].span(), (marks[1].start(), marks[-1].end()))
    return _blank(source, ranges)


def _touch(one: tuple[int, int], other: tuple[int, int]) -> bool:
    return one[0] - 2 <= other[1] and other[0] <= one[1] + 2
