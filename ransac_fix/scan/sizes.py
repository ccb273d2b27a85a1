"""The size of the sample that is drawn beside a rule, against the exponent of the rule."""

from ransac_fix.scan import algebra
from ransac_fix.scan.form import Expr, Fn, Ref
from ransac_fix.scan.reading import ReadSite


def size_drawn(read: ReadSite) -> int | None:
    """Give how many indices are drawn where the exponent of a site says otherwise, else None."""
    if read.draw is None or not read.near_draw or read.draw.size is None:
        return None
    probability = read.site.probability
    exponent = probability.exponent_value
    if exponent is None and probability.exponent is not None:
        exponent = algebra.number(probability.exponent)
        if exponent is None and _is_number_of_data(probability.exponent):
            return read.draw.size
    if exponent is None or exponent == read.draw.size or not 1 < read.draw.size <= 20:
        return None
    return read.draw.size


def _is_number_of_data(expr: Expr) -> bool:
    while isinstance(expr, Ref):
        expr = expr.value
    return isinstance(expr, Fn) and expr.name == "count"
