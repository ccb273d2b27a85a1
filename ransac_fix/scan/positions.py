"""libcst confirms, and gives to the character, the places that ``ast`` found.

Only what has something to report is parsed a second time: the statements of the module that the
places stand in.
"""

import ast
from collections import defaultdict
from collections.abc import Collection

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider

from ransac_fix.scan.form import Span
from ransac_fix.scan.python import split_lines


def confirm(source: str, tree: ast.Module, spans: Collection[Span]) -> dict[Span, cst.CSTNode]:
    """Find the node of each span; a span without one is left out.

    Parameters
    ----------
    source : str
        A Python module.
    tree : ast.Module
        What ``ast`` made of it.
    spans : collection of Span
        Places of expressions, as the Python front end gives them.

    Returns
    -------
    dict
        The node that covers each span exactly.

    Raises
    ------
    libcst.ParserSyntaxError
        libcst does not read one of the statements.
    """
    lines = split_lines(source)
    inside: defaultdict[tuple[int, int], set[Span]] = defaultdict(set)
    for span in spans:
        inside[_lines_around(tree, span)].add(span)
    found: dict[Span, cst.CSTNode] = {}
    for (first, last), wanted in inside.items():
        module = cst.parse_module("\n".join(lines[first - 1 : last]))
        wrapper = MetadataWrapper(module, unsafe_skip_copy=True)
        for node, place in wrapper.resolve(PositionProvider).items():
            if isinstance(node, cst.BaseExpression | cst.BaseStatement | cst.BaseSmallStatement):
                start, end = place.start, place.end
                span = Span(start.line + first - 1, start.column, end.line + first - 1, end.column)
                if span in wanted:
                    # The innermost node of a place comes last: the name `x`, not the statement.
                    found[span] = node
    return found


def _lines_around(tree: ast.Module, span: Span) -> tuple[int, int]:
    """Give the lines of the statements of a module that share lines with a place."""
    first, last = span.line, span.end_line
    for node in tree.body:
        decorators = getattr(node, "decorator_list", [])
        start = min([node.lineno, *(one.lineno for one in decorators)])
        end = node.end_lineno or node.lineno
        if start <= last and end >= first:
            first, last = min(first, start), max(last, end)
    return first, last
