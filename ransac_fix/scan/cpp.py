"""The C, C++ and CUDA front end: tree-sitter's syntax trees into the small form.

The source is parsed as it stands, before the preprocessor; what tree-sitter cannot read costs that
statement and no more. A name that a function does not declare is a member of its class.
"""

import re
from collections.abc import Iterator, Sequence

import tree_sitter

from ransac_fix.scan import cpp_tree, form, functions
from ransac_fix.scan.form import Expr, Span, Stmt
from ransac_fix.scan.suppressions import Comment

_BINARY = {"+": "add", "-": "sub", "*": "mul", "/": "div", "%": "mod", "&&": "and", "||": "or"}
_COMPARE = frozenset(("<", "<=", ">", ">=", "==", "!="))
_NUMBER = re.compile(r"([-+]?)\s*(0[xX][0-9a-fA-F]+|[0-9.]+(?:[eE][-+]?[0-9]+)?)")
_TYPES = frozenset(
    (
        "primitive_type",
        "sized_type_specifier",
        "type_identifier",
        "template_type",
        "type_descriptor",
    )
)
_BLOCKS = frozenset(
    (
        "translation_unit",
        "declaration_list",
        "namespace_definition",
        "linkage_specification",
        "template_declaration",
        "preproc_if",
        "preproc_ifdef",
        "preproc_else",
        "preproc_elif",
        "compound_statement",
        "ERROR",
        "labeled_statement",
        "case_statement",
        "else_clause",
        "catch_clause",
        "field_declaration_list",
        "export_declaration",
        "concept_definition",
        "attributed_statement",
        "init_statement",
    )
)
# What holds no declaration, where it has been read without an error.
_WITHOUT_DECLARATIONS = frozenset(
    ("init_declarator", "expression_statement", "return_statement", "comment", "using_declaration")
)
_MAX_DEPTH = 120
# The names that a file gives to types, and how those of other files end.
_NAMED_TYPE = re.compile(
    r"\b(?:typename|class|using)\s+(\w+)\s*[,>=]|\btypedef\b[^;{}]*\b(\w+)\s*;"
)
_DISTRIBUTION = re.compile(r"\buniform_(?:int|smallint)(?:_distribution)?\b")
_TUPLES = frozenset(("make_pair", "make_tuple", "forward_as_tuple"))
_SAYS_TYPE = re.compile(r"T|FT|RT|Float|Double|\w*(?:Scalar|Real|Type|_type|_t)")

# What a macro needs for it to be read, and what is no part of its value: the mark of a line that
# goes on, and comments.
_COMPUTES = re.compile(r"[*/?]|\b\w*(?:pow|log|exp)\w*\s*\(|^\(?\s*[-+]?[\d.]+[\w.]*\s*\)?$")
_MARGIN = re.compile(r"\\(?=\r?\n)|/\*[^\n]*?\*/|//[^\n]*")

Node = tree_sitter.Node


def parse(source: str) -> form.Module:
    """Read one C, C++ or CUDA file; what is nested too deeply is left out."""
    return _Reader.of_file(source).module()


def comments(source: str) -> Iterator[Comment]:
    """Yield the comments of a file."""
    reader = _Reader.of_file(source)
    stack = [reader.root]
    while stack:
        node = stack.pop()
        if node.type == "comment":
            yield Comment(reader.text(node), reader.span(node))
        stack.extend(reversed(node.children))


class _Reader:
    def __init__(self, source: str, data: bytes, root: Node, types: frozenset[str]) -> None:
        self._bytes = data
        self.root = root
        self._lines: list[bytes] | None = None
        if not source.isascii():
            self._lines = self._bytes.split(b"\n")
        self._owner: str | None = None
        self._locals: set[str] | None = None
        self._depth = 0
        self._distributions: set[str] = set()
        self._fields: dict[str, list[str]] = {}
        self._globals: set[str] = set()
        self._types = types

    @classmethod
    def of_file(cls, source: str) -> "_Reader":
        data = source.encode("utf-8", "surrogatepass")
        named = _NAMED_TYPE.findall(source)
        types = frozenset(name for pair in named for name in pair if name)
        return cls(source, data, cpp_tree.parse_file(data)[0], types)

    def _part(self, source: str) -> "_Reader":
        """Read what stands by itself in a file, with the types that the file names."""
        data = source.encode("utf-8", "surrogatepass")
        return _Reader(source, data, cpp_tree.parse(data), self._types)

    def module(self) -> form.Module:
        return form.Module(tuple(self._statements(self.root.named_children)))

    def text(self, node: Node) -> str:
        return self._bytes[node.start_byte : node.end_byte].decode("utf-8", "replace")

    def span(self, node: Node) -> Span:
        (line, column), (end_line, end_column) = node.start_point, node.end_point
        if self._lines is not None:
            column = len(self._lines[line][:column].decode("utf-8", "replace"))
            end_column = len(self._lines[end_line][:end_column].decode("utf-8", "replace"))
        return Span(line + 1, column, end_line + 1, end_column)

    # ---- statements -----------------------------------------------------------------------

    def _statements(self, nodes: Sequence[Node]) -> list[Stmt]:
        out: list[Stmt] = []
        for node in nodes:
            self._statement(node, out)
        return out

    def _block(self, node: Node | None) -> tuple[Stmt, ...]:
        return tuple(self._statements([node])) if node is not None else ()

    def _statement(self, node: Node, out: list[Stmt]) -> None:
        if self._depth >= _MAX_DEPTH:
            return
        self._depth += 1
        self._one_statement(node, out)
        self._depth -= 1

    def _one_statement(self, node: Node, out: list[Stmt]) -> None:
        match node.type:
            case "compound_statement":
                self._braces(node, out)
            case kind if kind in _BLOCKS:
                for child in node.named_children:
                    self._statement(child, out)
            case "function_definition":
                self._function(node, out)
            case "class_specifier" | "struct_specifier" | "union_specifier":
                self._class(node, out)
            case "declaration" | "field_declaration":
                self._declaration(node, out)
            case "expression_statement":
                for child in node.named_children:
                    self._effect(child, out)
                    if child.type != "update_expression":
                        self._steps(child, out)
            case "if_statement":
                test = self._condition(node.child_by_field_name("condition"), out)
                self._steps(node.child_by_field_name("condition"), out)
                out.append(
                    form.If(
                        test,
                        self._block(node.child_by_field_name("consequence")),
                        self._block(node.child_by_field_name("alternative")),
                    )
                )
            case "for_statement":
                self._for(node, out)
            case "for_range_loop":
                declarator = node.child_by_field_name("declarator")
                name = self._declared(declarator)
                if name:
                    self._declare(name)
                source = node.child_by_field_name("right")
                out.append(
                    form.Loop(
                        (name or "",),
                        self.expr(source) if source is not None else form.Unknown(),
                        None,
                        self._block(node.child_by_field_name("body")),
                        self.span(node),
                    )
                )
            case "while_statement" | "do_statement":
                before: list[Stmt] = []
                test = self._condition(node.child_by_field_name("condition"), before)
                out.extend(before)
                run: list[Stmt] = []
                self._steps(node.child_by_field_name("condition"), run)
                run += self._block(node.child_by_field_name("body"))
                out.append(form.Loop((), None, test, tuple(run), self.span(node)))
            case "return_statement" | "co_return_statement":
                value = next(iter(node.named_children), None)
                out.append(form.Leave("return", self.expr(value) if value is not None else None))
            case "throw_statement" | "goto_statement":
                out.append(form.Leave("raise"))
            case "break_statement":
                out.append(form.Leave("break"))
            case "continue_statement":
                out.append(form.Leave("continue"))
            case "switch_statement":
                body_node = node.child_by_field_name("body")
                for case in body_node.named_children if body_node is not None else ():
                    inner = [one for one in self._statements([case]) if not _is_break(one)]
                    out.append(form.If(form.Unknown(), tuple(inner), ()))
            case "try_statement":
                for child in node.named_children:
                    inner_block = tuple(self._statements([child]))
                    if child.type == "catch_clause":
                        out.append(form.If(form.Unknown(), inner_block, ()))
                    else:
                        out.extend(inner_block)
            case "preproc_def" | "preproc_function_def":
                self._macro(node, out)
            case "comment" | "preproc_include":
                pass
            case "using_declaration" | "alias_declaration" | "type_definition":
                for child in node.named_children:
                    if child.type.endswith("_specifier"):
                        self._statement(child, out)
            case kind if kind.endswith(("_expression", "_literal")):
                self._effect(node, out)
            case _:
                pass

    def _braces(self, node: Node, out: list[Stmt]) -> None:
        inner = self._statements(node.named_children)
        # Braces that always leave, with code behind them: the `if` before them was lost in a
        # macro (`CHECK_START if (n < k) { return; }`).
        behind = node.next_named_sibling is not None and _is_block(node.parent)
        if behind and inner and isinstance(inner[-1], form.Leave):
            out.append(form.If(form.Unknown(), tuple(inner), ()))
        else:
            out += inner

    def _for(self, node: Node, out: list[Stmt]) -> None:
        initializer = node.child_by_field_name("initializer")
        if initializer is not None:
            if initializer.type == "declaration":
                self._declaration(initializer, out)
            else:
                self._effect(initializer, out)
        condition = node.child_by_field_name("condition")
        body = list(self._block(node.child_by_field_name("body")))
        update = node.child_by_field_name("update")
        if update is not None:
            self._effect(update, body)
        test = self.expr(condition) if condition is not None else form.Unknown()
        out.append(form.Loop((), None, test, tuple(body), self.span(node)))

    def _condition(self, node: Node | None, out: list[Stmt]) -> Expr:
        if node is None:
            return form.Unknown()
        if node.type == "condition_clause":
            initializer = node.child_by_field_name("initializer")
            if initializer is not None:
                self._statement(initializer, out)
            node = node.child_by_field_name("value") or node
        if node.type == "declaration":
            self._declaration(node, out)
            return form.Unknown()
        return self.expr(node)

    def _declaration(self, node: Node, out: list[Stmt]) -> None:
        for child in node.named_children:
            if child.type.endswith("_specifier") and child.child_by_field_name("body") is not None:
                self._statement(child, out)
        default = node.child_by_field_name("default_value")
        kind = node.child_by_field_name("type")
        draws = kind is not None and _DISTRIBUTION.search(self.text(kind)) is not None
        for declarator in node.children_by_field_name("declarator"):
            if _unpacks(declarator):
                self._unpack(declarator, out)
            name = self._declared(declarator)
            if not name:
                continue
            self._declare(name)
            if draws:
                self._distributions.add(name)
            value = default
            if declarator.type == "init_declarator":
                value = declarator.child_by_field_name("value")
            elif declarator.type == "function_declarator":
                vexed = self._vexed(declarator)
                if vexed is not None:
                    out.append(form.Assign(name, vexed))
            if value is None:
                continue
            if value.type == "lambda_expression":
                self._lambda(name, value, out)
                continue
            out.append(form.Assign(name, self._initial(value)))
            if value.type == "initializer_list" and kind is not None:
                self._members(name, self._spelled(kind), value, out)
            self._steps(declarator, out)

    def _vexed(self, declarator: Node) -> Expr | None:
        """Read ``double q(w)`` and ``double q(pow(w, k))`` of variables as what is meant."""
        listed = declarator.child_by_field_name("parameters")
        if self._locals is None or listed is None or len(listed.named_children) != 1:
            return None
        only = listed.named_children[0]
        kind, inner = only.child_by_field_name("type"), only.child_by_field_name("declarator")
        if kind is None or kind.type not in ("type_identifier", "qualified_identifier"):
            return None
        name, span = self._spelled(kind), self.span(only)
        if inner is None:
            return form.Name(name, span) if name in self._locals else None
        given = inner.child_by_field_name("parameters")
        if inner.type != "abstract_function_declarator" or given is None:
            return None
        args = [one.child_by_field_name("type") for one in given.named_children]
        names = tuple(form.Name(self._spelled(one), self.span(one)) for one in args if one)
        if not any(one.name in self._locals for one in names):
            return None
        scope, _, function = name.rpartition(".")
        return form.Call(form.Name(scope) if scope else None, function, names, (), span)

    def _unpack(self, declarator: Node, out: list[Stmt]) -> None:
        """Give each name of ``auto [a, b] = ...`` its part."""
        names = declarator.child_by_field_name("declarator")
        value = declarator.child_by_field_name("value")
        if names is None or value is None:
            return
        whole = self._initial(value)
        listed = [self.text(one) for one in names.named_children if one.type == "identifier"]
        for number, name in enumerate(listed):
            self._declare(name)
            part: Expr = form.Item(whole, form.Num(float(number)), whole.span)
            if isinstance(whole, form.Seq) and number < len(whole.items):
                part = whole.items[number]
            out.append(form.Assign(name, part))

    def _members(self, name: str, kind: str, value: Node, out: list[Stmt]) -> None:
        """Set the members of a struct of this file that is initialised with a list."""
        names = self._fields.get(kind, [])
        for number, child in enumerate(value.named_children):
            part: Node | None = child
            own = names[number] if number < len(names) else None
            if child.type == "initializer_pair":
                designator = child.child_by_field_name("designator")
                part = child.child_by_field_name("value")
                own = None if designator is None else self.text(designator).lstrip(".").strip()
            if own and part is not None and part.type != "comment":
                out.append(form.Assign(f"{name}.{own}", self._initial(part)))

    def _initial(self, value: Node) -> Expr:
        if value.type in ("argument_list", "initializer_list"):
            inner = value.named_children
            if len(inner) == 1:
                return self.expr(inner[0])
            return form.Seq(tuple(self.expr(one) for one in inner), self.span(value))
        return self.expr(value)

    def _declared(self, node: Node | None) -> str | None:
        """Give the name that a declarator declares."""
        named = _declared_node(node)
        return None if named is None else self.text(named)

    def _declare(self, name: str) -> None:
        if self._locals is not None:
            self._locals.add(name)
        elif not self._owner:
            self._globals.add(name)

    def _effect(self, node: Node, out: list[Stmt]) -> None:
        match node.type:
            case "assignment_expression":
                left, right = node.child_by_field_name("left"), node.child_by_field_name("right")
                operator = node.child_by_field_name("operator")
                if left is None or right is None:
                    return
                sign = self.text(operator) if operator is not None else "="
                if sign == "=" and right.type == "lambda_expression":
                    self._lambda(self.text(left), right, out)
                    return
                if sign == "=" and right.type == "assignment_expression":  # a = b = c
                    self._effect(right, out)
                    inner = right.child_by_field_name("left")
                    right = inner if inner is not None else right
                value = self.expr(right)
                if sign != "=":
                    name = _BINARY.get(sign[:-1])
                    parts = (self.expr(left), value)
                    span = self.span(node)
                    value = form.Op(name, parts, span) if name else form.Unknown(parts, span)
                self._assign(left, value, out)
            case "update_expression":
                argument = node.child_by_field_name("argument")
                if argument is not None:
                    self._assign(argument, self._step(node, argument), out)
            case "comma_expression":
                for child in node.named_children:
                    self._effect(child, out)
            case "parenthesized_expression":
                for child in node.named_children:
                    self._effect(child, out)
            case _:
                out.append(form.Evaluate(self.expr(node)))

    def _steps(self, node: Node | None, out: list[Stmt]) -> None:
        """Count what an expression counts in passing: ``kept[n++] = i``."""
        if node is None:
            return
        text = self._bytes[node.start_byte : node.end_byte]
        if b"++" not in text and b"--" not in text:
            return
        stack = list(reversed(node.named_children))
        while stack:
            inner = stack.pop()
            if inner.type == "update_expression":
                self._effect(inner, out)
            elif inner.type != "lambda_expression":
                stack.extend(reversed(inner.named_children))

    def _assign(self, left: Node, value: Expr, out: list[Stmt]) -> None:
        if left.type == "subscript_expression":
            argument = left.child_by_field_name("argument")
            array = self._path(argument) if argument is not None else None
            if array is not None:
                value = form.Choice((form.Name(array), value), self.span(left))
            out.append(form.Assign(array, value))
            return
        if left.type in ("pointer_expression", "parenthesized_expression"):
            inner = next(iter(left.named_children), None)
            out.append(form.Assign(self._path(inner) if inner is not None else None, value))
            return
        out.append(form.Assign(self._path(left), value))

    def _lambda(self, name: str, node: Node, out: list[Stmt]) -> None:
        out.append(self._anonymous(node, name))

    def _anonymous(self, node: Node, name: str) -> form.Function:
        declarator = node.child_by_field_name("declarator")
        body = node.child_by_field_name("body")
        outer = self._locals
        self._locals = set(outer or ())
        parameters = self._parameters(declarator)
        inner = self._block(body)
        self._locals = outer
        return form.Function(name, parameters, inner, self.span(node), self._owner)

    def _function(self, node: Node, out: list[Stmt]) -> None:
        declarator = node.child_by_field_name("declarator")
        while declarator is not None and declarator.type != "function_declarator":
            declarator = declarator.child_by_field_name("declarator") or next(
                (one for one in declarator.named_children if one.type.endswith("declarator")), None
            )
        if declarator is None:
            self._statement_children(node, out)
            return
        named = declarator.child_by_field_name("declarator")
        full = self._spelled(named) if named is not None else ""
        scope, _, name = full.rpartition(".")
        owner = scope.rpartition(".")[2] or self._owner
        outer = self._owner, self._locals
        self._owner, self._locals = owner, set()
        parameters = self._parameters(declarator)
        body: list[Stmt] = []
        for child in node.named_children:
            if child.type == "field_initializer_list":
                self._initializers(child, body)
        block = node.child_by_field_name("body")
        if block is not None:
            self._collect_locals(block)
            self._statement(block, body)
        self._owner, self._locals = outer
        function = form.Function(name or full, parameters, tuple(body), self.span(node), owner)
        out.append(function)

    def _statement_children(self, node: Node, out: list[Stmt]) -> None:
        # A macro made something else of it: read what is inside.
        block = node.child_by_field_name("body")
        if block is not None:
            self._statement(block, out)

    def _macro(self, node: Node, out: list[Stmt]) -> None:
        """Read a macro as what it is used as: a value, a function, or statements."""
        named, value = node.child_by_field_name("name"), node.child_by_field_name("value")
        listed = node.child_by_field_name("parameters")
        if named is None or value is None or not _COMPUTES.search(self.text(value)):
            return
        name = self.text(named)
        parameters = tuple(
            form.Parameter(self.text(one), None, self.span(one), by_reference=True)
            for one in (listed.named_children if listed is not None else ())
            if one.type == "identifier"
        )
        for opened, closed in (("auto _ =", ";"), ("void _() {", ";}")):
            inner = self._part(self._alone(value, opened, closed))
            if inner.root.has_error:
                continue
            match inner.module().body:
                case (form.Assign(value=read),) if listed is None:
                    out.append(form.Assign(name, read))
                case (form.Assign(value=read),):
                    body = (form.Leave("return", read),)
                    out.append(form.Function(name, parameters, body, self.span(node)))
                case (form.Function(body=block),):
                    out.append(form.Function(name, parameters, block, self.span(node)))
            return

    def _alone(self, node: Node, opened: str, closed: str) -> str:
        """Give a source that has a node where it stands, between two words, and nothing else."""
        row, column = node.start_point
        text = _MARGIN.sub(lambda found: " " * len(found[0]), self.text(node))
        before = "\n" * row + " " * column
        if row:
            return f"{before[: row - 1]}{opened}\n{' ' * column}{text}{closed}"
        return f"{before[: column - len(opened)]}{opened}{text}{closed}"

    def _collect_locals(self, block: Node) -> None:
        """Declare what a body declares anywhere, so that members are told apart from it."""
        stack = [block]
        while stack:
            node = stack.pop()
            if node.type in ("declaration", "for_range_loop"):
                for declarator in node.children_by_field_name("declarator"):
                    name = self._declared(declarator)
                    if name:
                        self._declare(name)
            kind = node.type
            if kind == "lambda_expression":
                continue
            if kind not in _WITHOUT_DECLARATIONS or node.has_error:
                stack.extend(node.named_children)

    def _initializers(self, node: Node, out: list[Stmt]) -> None:
        for child in node.named_children:
            parts = child.named_children
            if child.type == "field_initializer" and len(parts) == 2:
                out.append(form.Assign(f"this.{self.text(parts[0])}", self._initial(parts[1])))

    def _parameters(self, declarator: Node | None) -> tuple[form.Parameter, ...]:
        listed = declarator.child_by_field_name("parameters") if declarator is not None else None
        found: list[form.Parameter] = []
        for child in listed.named_children if listed is not None else ():
            named = _declared_node(child.child_by_field_name("declarator"))
            if child.type.endswith("parameter_declaration") and named is not None:
                name = self.text(named)
                self._declare(name)
                default = child.child_by_field_name("default_value")
                value = self.expr(default) if default is not None else None
                reference = _is_reference(child.child_by_field_name("declarator"))
                found.append(form.Parameter(name, value, self.span(named), reference))
        return tuple(found)

    def _class(self, node: Node, out: list[Stmt]) -> None:
        named, body = node.child_by_field_name("name"), node.child_by_field_name("body")
        if body is None:
            return
        name = self._spelled(named).rpartition(".")[2] if named is not None else ""
        self._fields[name] = [
            declared
            for child in body.named_children
            if child.type == "field_declaration"
            for declarator in child.children_by_field_name("declarator")
            if declarator.type != "function_declarator"
            and (declared := self._declared(declarator)) is not None
        ]
        outer = self._owner, self._locals
        self._owner, self._locals = name, None
        inner = self._statements(body.named_children)
        self._owner, self._locals = outer
        out.append(form.Class(name, tuple(inner), self.span(node)))

    # ---- names ----------------------------------------------------------------------------

    def _spelled(self, node: Node) -> str:
        """Spell a qualified name with dots and without template arguments."""
        if node.type == "qualified_identifier":
            scope, name = node.child_by_field_name("scope"), node.child_by_field_name("name")
            parts = [self._spelled(part) for part in (scope, name) if part is not None]
            return ".".join(part for part in parts if part)
        if node.type in ("template_type", "template_function", "template_method"):
            name = node.child_by_field_name("name")
            return self._spelled(name) if name is not None else ""
        if node.type == "dependent_name":
            return self._spelled(node.named_children[-1]) if node.named_children else ""
        return self.text(node)

    def _path(self, node: Node) -> str | None:
        """Spell a variable or member as a dotted path; None for anything else."""
        match node.type:
            case "identifier":
                name = self.text(node)
                if self._locals is not None and name not in self._locals:
                    if self._owner:
                        return f"this.{name}"
                    if name in self._globals:
                        return f"global.{name}"
                return name
            case "field_identifier":
                return self.text(node)
            case "this":
                return "this"
            case "qualified_identifier":
                return self._spelled(node)
            case "field_expression":
                argument = node.child_by_field_name("argument")
                field = node.child_by_field_name("field")
                if argument is None or field is None:
                    return None
                before = self._path(argument)
                return None if before is None else f"{before}.{self._spelled(field)}"
            case "parenthesized_expression" | "pointer_expression":
                inner = node.named_children
                return self._path(inner[0]) if len(inner) == 1 else None
        return None

    # ---- expressions ----------------------------------------------------------------------

    def expr(self, node: Node) -> Expr:
        if self._depth >= _MAX_DEPTH:
            return form.Unknown((), self.span(node))
        self._depth += 1
        read = self._one_expr(node)
        self._depth -= 1
        return read

    def _one_expr(self, node: Node) -> Expr:
        span = self.span(node)
        match node.type:
            case "number_literal":
                text = self.text(node)
                if text.startswith("-"):  # in a subscript the sign is part of the literal
                    unsigned = span._replace(column=span.column + 1)
                    return form.Op("neg", (form.Num(_number(text[1:]), unsigned),), span)
                return form.Num(_number(text), span)
            case "parenthesized_expression":
                inner = [one for one in node.named_children if one.type != "comment"]
                return self.expr(inner[0]) if inner else form.Unknown((), span)
            case "identifier" | "field_expression" | "qualified_identifier" | "this":
                path = self._path(node)
                if path is not None:
                    return form.Name(path, span)
                argument = node.child_by_field_name("argument")
                field = node.child_by_field_name("field")
                if argument is None or field is None:
                    return form.Unknown((), span)
                return form.Item(self.expr(argument), form.Name(self.text(field)), span)
            case "true" | "false":
                return form.Name(self.text(node).capitalize(), span)
            case "binary_expression":
                return self._binary(node, span)
            case "unary_expression":
                return self._unary(node, span)
            case "conditional_expression":
                options = (
                    node.child_by_field_name("consequence"),
                    node.child_by_field_name("alternative"),
                )
                asked = node.child_by_field_name("condition")
                return form.Choice(
                    tuple(self.expr(one) for one in options if one is not None),
                    span,
                    self.expr(asked) if asked is not None else None,
                )
            case "call_expression":
                return self._call(node, span)
            case "cast_expression":
                value = node.child_by_field_name("value")
                if value is None:
                    return form.Unknown((), span)
                return form.Call(None, "static_cast", (self.expr(value),), (), span)
            case "compound_literal_expression":
                value = node.child_by_field_name("value")
                inner_value = self._initial(value) if value is not None else form.Unknown()
                return form.Call(None, "static_cast", (inner_value,), (), span)
            case "initializer_list":
                return self._initial(node)
            case "subscript_expression":
                argument = node.child_by_field_name("argument")
                indices = node.child_by_field_name("indices")
                parts = list(indices.named_children) if indices is not None else []
                if argument is None:
                    return form.Unknown((), span)
                index = self.expr(parts[0]) if parts else form.Unknown()
                return form.Item(self.expr(argument), index, span)
            case "pointer_expression":
                inner = node.named_children
                return self.expr(inner[0]) if inner else form.Unknown((), span)
            case "assignment_expression":
                left, right = node.child_by_field_name("left"), node.child_by_field_name("right")
                path = self._path(left) if left is not None else None
                if path is None or right is None:
                    return form.Unknown((), span)
                return form.Ref(path, self.expr(right), span)
            case "comma_expression":
                return self.expr(node.named_children[-1])
            case "update_expression":
                argument = node.child_by_field_name("argument")
                if argument is None:
                    return form.Unknown((), span)
                first = node.child(0)  # ++n gives what n becomes, n++ what it was
                before = first is not None and first.type in ("++", "--")
                return self._step(node, argument) if before else self.expr(argument)
            case "lambda_expression":
                return form.Lambda(self._anonymous(node, "<lambda>"), span)
            case _:
                parts_read = [
                    self.expr(child)
                    for child in node.named_children
                    if child.type.endswith(("_expression", "identifier"))
                ]
                return form.Unknown(tuple(parts_read), span)

    def _step(self, node: Node, argument: Node) -> Expr:
        sign = "add" if "++" in self.text(node) else "sub"
        return form.Op(sign, (self.expr(argument), form.Num(1.0)), self.span(node))

    def _binary(self, node: Node, span: Span) -> Expr:
        left, right = node.child_by_field_name("left"), node.child_by_field_name("right")
        operator = node.child_by_field_name("operator")
        if left is None or right is None or operator is None:
            return form.Unknown((), span)
        sign = self.text(operator)
        if sign == "<<":  # what is written to a stream may be long
            return form.Unknown(tuple(self.expr(one) for one in _shifted(node)), span)
        parts = (self.expr(left), self.expr(right))
        if sign in _COMPARE:
            return form.Op(sign, parts, span)
        name = _BINARY.get(sign)
        return form.Op(name, parts, span) if name else form.Unknown(parts, span)

    def _unary(self, node: Node, span: Span) -> Expr:
        argument = node.child_by_field_name("argument")
        operator = node.child_by_field_name("operator")
        if argument is None or operator is None:
            return form.Unknown((), span)
        value = self.expr(argument)
        match self.text(operator):
            case "-":
                return form.Op("neg", (value,), span)
            case "+":
                return value
            case "!" | "not":
                return form.Op("not", (value,), span)
        return form.Unknown((value,), span)

    def _is_type(self, node: Node) -> bool:
        """Whether what is called is a type: ``T(1)``, ``double(n)``, ``typename M::Scalar(1)``."""
        if node.type in _TYPES or node.type == "dependent_type":
            return True
        if node.type not in ("identifier", "qualified_identifier"):
            return False
        name = self._spelled(node).rpartition(".")[2]
        if self._locals is not None and name in self._locals:
            return False  # an entry of T, a vector
        return name in self._types or _SAYS_TYPE.fullmatch(name) is not None

    def _call(self, node: Node, span: Span) -> Expr:
        function = node.child_by_field_name("function")
        while function is not None and function.type == "parenthesized_expression":
            function = next(iter(function.named_children), None)  # (std::max)(a, b)
        listed = node.child_by_field_name("arguments")
        inside = listed.named_children if listed is not None else []
        args = tuple(self.expr(one) for one in inside if one.type != "comment")
        if function is None:
            return form.Unknown(args, span)
        if len(args) == 1 and self._is_type(function):
            return form.Call(None, "static_cast", args, (), span)
        if function.type in ("identifier", "qualified_identifier", "template_function"):
            scope, _, name = self._spelled(function).rpartition(".")
            limit = _limit(scope, name, span)
            if limit is not None:
                return limit
            if len(args) == 1 and functions.is_power(name):
                exponent = _template_argument(function)  # boost::math::pow<3>(w)
                if exponent is not None:
                    return form.Call(None, "pow", (*args, self.expr(exponent)), (), span)
            if name in self._distributions and not scope:
                name = "randInt"  # dist(engine) draws one
            if name in _TUPLES:
                names = ("first", "second") if name == "make_pair" else ()
                return form.Seq(args, span, names)
            if functions.UNARY.get(name) == "same":
                scope = ""  # cv::saturate_cast<float>(x)
            return form.Call(form.Name(scope) if scope else None, name, args, (), span)
        if function.type == "field_expression":
            argument = function.child_by_field_name("argument")
            field = function.child_by_field_name("field")
            if argument is not None and field is not None:
                name = self._spelled(field)
                if name == "uniform" and len(args) == 2 and self.text(inside[0]) == "0":
                    name = "randInt"  # of cv::RNG, of integers
                return form.Call(self.expr(argument), name, args, (), span)
        return form.Call(self.expr(function), "", args, (), span)


def _declared_node(node: Node | None) -> Node | None:
    """Find the name in a declarator."""
    while node is not None:
        if node.type in ("identifier", "field_identifier"):
            return node
        if node.type == "structured_binding_declarator":
            return None
        inner = node.child_by_field_name("declarator")
        if inner is None:
            named = [
                child
                for child in node.named_children
                if child.type.endswith(("declarator", "identifier"))
            ]
            inner = named[-1] if named else None
        node = inner
    return None


def _is_reference(declarator: Node | None) -> bool:
    return declarator is not None and declarator.type in (
        "reference_declarator",
        "pointer_declarator",
    )


def _shifted(node: Node) -> list[Node]:
    """Give what a chain of << has between its signs."""
    found: list[Node] = []
    while True:
        left, right = node.child_by_field_name("left"), node.child_by_field_name("right")
        operator = node.child_by_field_name("operator")
        if left is None or right is None or operator is None or operator.type != "<<":
            return [node, *reversed(found)]
        found.append(right)
        node = left


def _unpacks(declarator: Node) -> bool:
    named = declarator.child_by_field_name("declarator")
    return named is not None and named.type == "structured_binding_declarator"


def _limit(scope: str, name: str, span: Span) -> Expr | None:
    """Read the limits of the number types."""
    if not scope.endswith("numeric_limits"):
        return None
    if name in ("epsilon", "min", "denorm_min"):
        return form.Num(1e-16, span)
    return form.Name("inf", span)


def _template_argument(function: Node) -> Node | None:
    """Give N of ``f<N>``, where that is all there is."""
    while function.type == "qualified_identifier":
        named = function.child_by_field_name("name")
        if named is None:
            return None
        function = named
    listed = function.child_by_field_name("arguments")
    if function.type != "template_function" or listed is None or len(listed.named_children) != 1:
        return None
    return listed.named_children[0]


def _number(text: str) -> float:
    found = _NUMBER.match(text.replace("'", ""))
    if found is None:
        return float("nan")
    sign = -1.0 if found[1] == "-" else 1.0  # the parser takes it for a part of the number
    try:
        return sign * (int(found[2], 16) if found[2][:2] in ("0x", "0X") else float(found[2]))
    except ValueError:
        return float("nan")


def _is_block(node: Node | None) -> bool:
    return node is not None and node.type in ("compound_statement", "ERROR", "translation_unit")


def _is_break(stmt: Stmt) -> bool:
    return isinstance(stmt, form.Leave) and stmt.kind == "break"
