"""What fixes ask of tree-sitter's nodes of C++: where they stand, and what has run before them."""

from collections.abc import Iterator

import tree_sitter

Node = tree_sitter.Node

_CONDITIONS = {"condition", "initializer", "right", "value"}
_BRANCHES = frozenset(
    (
        "if_statement",
        "for_statement",
        "for_range_loop",
        "while_statement",
        "do_statement",
        "switch_statement",
        "case_statement",
        "conditional_expression",
        "catch_clause",
        "else_clause",
        "function_definition",
        "lambda_expression",
    )
)
LOOPS = frozenset(("for_statement", "for_range_loop", "while_statement", "do_statement"))
FUNCTIONS = frozenset(("function_definition", "lambda_expression"))


def contains(outer: Node, inner: Node) -> bool:
    """Whether one node lies within another."""
    return outer.start_byte <= inner.start_byte and inner.end_byte <= outer.end_byte


def ancestors(node: Node) -> Iterator[Node]:
    """Yield the nodes around a node, from the inside."""
    current = node.parent
    while current is not None:
        yield current
        current = current.parent


def walk(node: Node) -> Iterator[Node]:
    """Yield a node and all in it, in the order of the source."""
    stack = [node]
    while stack:
        current = stack.pop()
        yield current
        stack.extend(reversed(current.named_children))


def statement(node: Node) -> Node:
    """Give the statement that a node stands in."""
    current = node
    for above in ancestors(node):
        if above.type in ("compound_statement", "translation_unit", "declaration_list"):
            break
        current = above
    return current


def dominates(first: Node, last: Node) -> bool:
    """Whether ``first`` has always run when ``last`` does, in the same run of its block."""
    child = first
    for above in ancestors(first):
        if contains(above, last):
            return above.type not in ("if_statement", "conditional_expression") or (
                above.child_by_field_name("condition") is not None
                and contains(above.child_by_field_name("condition") or above, child)
            )
        if above.type in _BRANCHES:
            fields = [above.child_by_field_name(name) for name in _CONDITIONS]
            if not any(one is not None and contains(one, child) for one in fields):
                return False
        child = above
    return False


def declared(scope: Node) -> Iterator[tuple[Node, Node]]:
    """Yield each declaration of a scope with the names it declares."""
    for node in walk(scope):
        if node.type not in (
            "declaration",
            "field_declaration",
            "parameter_declaration",
            "optional_parameter_declaration",
            "for_range_loop",
        ):
            continue
        for declarator in node.children_by_field_name("declarator"):
            inner: Node | None = declarator
            while inner is not None and inner.type not in ("identifier", "field_identifier"):
                inner = inner.child_by_field_name("declarator") or next(
                    (
                        one
                        for one in inner.named_children
                        if one.type.endswith(("declarator", "identifier"))
                    ),
                    None,
                )
            if inner is not None:
                yield node, inner


def function_declarator(definition: Node) -> Node | None:
    """Give the part of a definition that has its name and parameters."""
    found = definition.child_by_field_name("declarator")
    while found is not None and found.type != "function_declarator":
        found = found.child_by_field_name("declarator") or next(
            (one for one in found.named_children if one.type.endswith("declarator")), None
        )
    return found
