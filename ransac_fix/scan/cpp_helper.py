"""The function that a fix adds to a C or C++ file, and where it goes.

It takes its counts as doubles, which hold every count that a program can have: so nothing is
divided as integers, and ``n_inliers - i`` does not wrap around. It stands in the global scope
behind a guard of its own, because several fixed headers may meet in one file.
"""

from collections.abc import Sequence

import tree_sitter

Node = tree_sitter.Node

HELPER = "all_inlier_probability"
GUARD = "ALL_INLIER_PROBABILITY"
HELPER_SOURCE = """\
#ifndef {guard}
#define {guard}
/* The probability that all of sample_size distinct samples are inliers. With fewer inliers than a
   sample takes there is none; the factors stop at one then, so that the number of trials made of
   this stays finite; and 1 - p is less than 1 in a double. */
{kind} double {name}(double n_inliers, double n_samples, double sample_size)
{{
{indent}double p = n_inliers > 0 ? 1 : 0;
{indent}for (; sample_size > 0; sample_size -= 1) {{
{indent}{indent}p *= (n_inliers > 1 ? n_inliers : 1) / (n_samples > 1 ? n_samples : 1);
{indent}{indent}n_inliers -= 1;
{indent}{indent}n_samples -= 1;
{indent}}}
{indent}return p > 0 && p < 1.2e-16 ? 1.2e-16 : p;
}}
#endif
"""
FLOAT_SOURCE = """\
#ifndef {guard}F
#define {guard}F
/* The same in single precision, where 1 - p is less than 1 in a float. */
{kind} float {name}f(double n_inliers, double n_samples, double sample_size)
{{
{indent}const double p = {name}(n_inliers, n_samples, sample_size);
{indent}return (float) (p > 0 && p < 6e-8 ? 6e-8 : p);
}}
#endif
"""


def anchor(root: Node, target: int) -> tuple[int, str]:
    """Give the line to add the function at: behind the includes, or above what needs it."""
    container = root
    while True:
        guard = next(
            (
                child
                for child in container.children
                if child.type in ("preproc_ifdef", "preproc_if")
                and child.start_byte <= target < child.end_byte
            ),
            None,
        )
        if guard is None:
            break
        container = guard
    best: Node | None = None
    item: Node | None = None
    comments: list[Node] = []
    for child in container.children:
        if child.end_byte > target:
            item = child
            break
        if _includes_only(child):
            best = child
        comments = [*comments, child] if child.type == "comment" else []
    if best is not None:
        row, column = best.end_point
        return (row + 1 if column == 0 else row + 2), "\n"
    assert item is not None
    row = item.start_point[0]
    for comment in reversed(comments):
        if comment.end_point[0] == row - 1 and comment.start_point[1] == 0:
            row = comment.start_point[0]
    if row == 0:  # a licence opens the file
        row = item.start_point[0]
    return row + 1, ""


def indent(lines: Sequence[bytes]) -> str:
    """Give what the file indents with."""
    leads = [line[: len(line) - len(line.lstrip())] for line in lines if line.strip()]
    tabs = sum(lead.startswith(b"\t") for lead in leads)
    spaces = [len(lead) for lead in leads if lead.startswith(b" ")]
    if tabs > len(spaces):
        return "\t"
    return "  " if sum(one % 4 == 2 for one in spaces) * 4 > len(spaces) or not spaces else "    "


def _includes_only(node: Node) -> bool:
    """Whether a top-level node is an include, or a condition around includes."""
    if node.type == "preproc_include":
        return True
    if node.type not in ("preproc_if", "preproc_ifdef"):
        return False
    inside = [
        child
        for child in node.named_children
        if child.type not in ("identifier", "comment", "preproc_defined", "binary_expression")
        and child != node.child_by_field_name("condition")
    ]
    return bool(inside) and all(
        one.type in ("preproc_include", "preproc_else", "preproc_elif", "preproc_def")
        for one in inside
    )
