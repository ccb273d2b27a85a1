"""libcst confirms, and gives to the character, the places that ``ast`` found.

Only files with something to report are parsed a second time.
"""

from collections.abc import Collection

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider

from ransac_fix.scan.form import Span


def confirm(source: str, spans: Collection[Span]) -> dict[Span, cst.CSTNode]:
    """Find the node of each span; a span without one is left out.

    Parameters
    ----------
    source : str
        A Python module.
    spans : collection of Span
        Places of expressions, as the Python front end gives them.

    Returns
    -------
    dict
        The node that covers each span exactly.

    Raises
    ------
    libcst.ParserSyntaxError
        libcst does not read this module.
    """
    wrapper = MetadataWrapper(cst.parse_module(source), unsafe_skip_copy=True)
    wanted = set(spans)
    found: dict[Span, cst.CSTNode] = {}
    for node, place in wrapper.resolve(PositionProvider).items():
        if isinstance(node, cst.BaseExpression | cst.BaseStatement | cst.BaseSmallStatement):
            span = Span(place.start.line, place.start.column, place.end.line, place.end.column)
            if span in wanted:
                # The innermost node of a place comes last: `x` the name, not `x` the statement.
                found[span] = node
    return found
