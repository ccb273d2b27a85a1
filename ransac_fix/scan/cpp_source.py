"""C, C++ and CUDA source as fixes see it: where values hold, and what types they have."""

import re
from collections.abc import Iterator, Sequence
from pathlib import PurePath

import tree_sitter

from ransac_fix.scan import cpp_tree
from ransac_fix.scan.cpp_helper import FLOAT_SOURCE, GUARD, HELPER, HELPER_SOURCE, anchor, indent
from ransac_fix.scan.cpp_nodes import (
    FUNCTIONS,
    LOOPS,
    ancestors,
    contains,
    declared,
    dominates,
    function_declarator,
    statement,
    walk,
)
from ransac_fix.scan.findings import Edit
from ransac_fix.scan.form import Expr, Fn, Name, Num, Op, Ref, Span
from ransac_fix.scan.reading import Text
from ransac_fix.scan.source import (
    Argument,
    CallSite,
    Signature,
    Source,
    Standing,
)

Node = tree_sitter.Node

_CPP_WORDS = re.compile(
    r"\b(?:namespace|template|class|typename|public:|private:|static_cast)\b|::"
)
_CUDA_WORDS = re.compile(r"__(?:device|global|host)__")
_INTEGER = re.compile(
    r"^(?:(?:std::)?(?:size_t|ssize_t|ptrdiff_t|u?int(?:_fast|_least)?\d*_t|int|long|short|unsigned"
    r"|signed|char|uint|index_t|uchar|ulong|ushort)\s*)+$|(?:^|::)Index$"
)
_ARRAY = re.compile(
    r"\b(?:Array|Matrix|Vector|RowVector)(?:X|\d|<)|\b(?:Mat|Mat_|Tensor|valarray)\b(?!::)"
)
_FLOAT = re.compile(r"^(?:long\s+)?double$|^float$|^half$")
# Functions that read their arguments and no more.
_LOOKS = frozenset(
    (
        *("abs", "acos", "assert", "atan", "atan2", "ceil", "ceilf", "clamp", "cos", "erf", "exp"),
        *(
            "fabs",
            "float",
            "floor",
            "floorf",
            "fmax",
            "fmin",
            "fprintf",
            "hypot",
            "int",
            "isfinite",
        ),
        *("isinf", "isnan", "lgamma", "log", "log10", "log1p", "log2", "logf", "lround", "max"),
        *(
            "min",
            "pow",
            "powf",
            "powi",
            "printf",
            "round",
            "sin",
            "snprintf",
            "sqrt",
            "static_cast",
        ),
        *("tan", "tgamma", "trunc", "double", "size_t", "unsigned", "sizeof", "epsilon"),
        *("cvCeil", "cvFloor", "cvRound", HELPER),
    )
)
# Methods that read their object and no more.
_READS = re.compile(
    r"^(?:at|back|begin|capacity|cbegin|cend|cols|count|data|empty|end|front|length|num\w*|rows"
    r"|size|total|use_count|get(?:[A-Z_]\w*)?|is[A-Z_]\w*|has[A-Z_]\w*|\w*_?(?:size|number|count)"
    r"|\w*(?:Size|Number|Count))$"
)
_SIMPLE = re.compile(
    r"(?:std::)?(?:size|ssize|abs|int|unsigned|double|float|size_t|static_cast\s*<[^()]*>)"
)


class CppSource(Source):
    """A C, C++ or CUDA file."""

    comment_marks = ("//", "/*")

    def __init__(self, text: Text, path: str) -> None:
        super().__init__(text)
        self._bytes = text.source.encode("utf-8", "surrogatepass")
        self._root, self._parsed = cpp_tree.parse_file(self._bytes)
        self._lines = self._bytes.split(b"\n")
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line) + 1)
        suffix = PurePath(path).suffix.lower()
        self._header = suffix not in (".c", ".cc", ".cpp", ".cxx", ".c++", ".cu")
        self._cuda = suffix in (".cu", ".cuh") or bool(_CUDA_WORDS.search(text.source))
        self._plain_c = suffix == ".c" or (
            suffix == ".h" and not self._cuda and not _CPP_WORDS.search(text.source)
        )

    # ---- places ---------------------------------------------------------------------------

    def _byte(self, line: int, column: int) -> int:
        own = self._lines[line - 1]
        if not own.isascii():
            column = len(own.decode("utf-8", "surrogatepass")[:column].encode("utf-8", "replace"))
        return self._starts[line - 1] + column

    def _node(self, span: Span) -> Node:
        start = self._byte(span.line, span.column)
        end = self._byte(span.end_line, span.end_column)
        node = self._root.descendant_for_byte_range(start, end)
        assert node is not None
        while node.parent is not None and node.parent.byte_range == node.byte_range:
            node = node.parent
        return node

    def _span(self, node: Node) -> Span:
        (line, column), (end_line, end_column) = node.start_point, node.end_point
        return Span(
            line + 1,
            self._character(line, column),
            end_line + 1,
            self._character(end_line, end_column),
        )

    def _character(self, line: int, column: int) -> int:
        own = self._lines[line]
        return column if own.isascii() else len(own[:column].decode("utf-8", "replace"))

    def _text(self, node: Node) -> str:
        return self._bytes[node.start_byte : node.end_byte].decode("utf-8", "replace")

    # ---- values ---------------------------------------------------------------------------

    def spell(self, expr: Expr) -> str | None:
        """Spell an expression as the file does; a name is a path here, which may not be spelled."""
        if isinstance(expr, Ref) and expr.span is not None:
            return " ".join(self.text.at(expr.span).split())
        if isinstance(expr, Ref | Name) and expr.span is None and "." in expr.name:
            return None
        return super().spell(expr)

    def standing(
        self, exprs: Sequence[Expr], start: Span, end: Span, *, anywhere: bool = False
    ) -> Standing:
        """Say whether expressions mean the same at ``end`` as they did at ``start``."""
        first, last = self._node(start), self._node(end)
        nodes = [self._node(span) for expr in exprs for span in _spans(expr)]
        paths = {path for node in nodes for path in self._paths(node)}
        if contains(last, first) or not paths:
            return "same"
        if last.start_byte < first.end_byte:
            return "changed"
        if not anywhere and not dominates(first, last):
            return "changed"
        ranges = [(first.end_byte, last.start_byte)]
        ranges += [
            above.byte_range
            for above in ancestors(last)
            if above.type in LOOPS and not contains(above, first)
        ]
        function = next((one for one in ancestors(last) if one.type in FUNCTIONS), self._root)
        if not contains(function, first):
            return "unknown"  # in a lambda, which runs at another time
        verdict: Standing = "same"
        own = statement(first)
        foreign = {path for path in paths if not self._is_local(path[0], function)}
        for node in walk(function):
            if not any(low <= node.start_byte < high for low, high in ranges):
                continue
            if contains(own, node):
                continue
            for written, sure in self._writes(node):
                if written is None:
                    if foreign:
                        verdict = "unknown"
                elif any(_meet(written, path) for path in paths):
                    if sure:
                        return "changed"
                    verdict = "unknown"
        return verdict

    def _paths(self, node: Node) -> Iterator[tuple[str, ...]]:
        """Yield the variables and members that an expression reads, without the calls on them."""
        if node.type == "call_expression":
            function = node.child_by_field_name("function")
            if function is not None and function.type == "field_expression":
                argument = function.child_by_field_name("argument")
                if argument is not None:
                    yield from self._paths(argument)
            arguments = node.child_by_field_name("arguments")
            if arguments is not None:
                for one in arguments.named_children:
                    yield from self._paths(one)
            return
        path = self._path(node)
        if path is not None:
            yield path
            return
        for child in node.named_children:
            if child.type not in ("type_descriptor", "template_argument_list", "comment"):
                yield from self._paths(child)

    def _path(self, node: Node) -> tuple[str, ...] | None:
        match node.type:
            case "identifier" | "qualified_identifier" | "field_identifier":
                return (self._text(node),)
            case "field_expression":
                argument = node.child_by_field_name("argument")
                field = node.child_by_field_name("field")
                if argument is None or field is None:
                    return None
                if argument.type == "this":
                    return (self._text(field),)
                before = self._path(argument)
                return None if before is None else (*before, self._text(field))
            case "parenthesized_expression" | "pointer_expression" | "subscript_expression":
                inner = node.child_by_field_name("argument") or next(
                    iter(node.named_children), None
                )
                return None if inner is None else self._path(inner)
        return None

    def _writes(self, node: Node) -> Iterator[tuple[tuple[str, ...] | None, bool]]:
        """Yield what a node may change, and whether it surely does; None is any member."""
        match node.type:
            case "assignment_expression":
                left = node.child_by_field_name("left")
                path = None if left is None else self._path(left)
                if path is not None:
                    yield path, True
            case "update_expression":
                argument = node.child_by_field_name("argument")
                path = None if argument is None else self._path(argument)
                if path is not None:
                    yield path, True
            case "declaration" | "init_declarator":
                for one in node.children_by_field_name("declarator"):
                    if one.type == "identifier":
                        yield (self._text(one),), True  # another variable of that name
            case "binary_expression":
                operator = node.child_by_field_name("operator")
                right = node.child_by_field_name("right")
                if operator is not None and self._text(operator) == ">>" and right is not None:
                    path = self._path(right)
                    if path is not None:
                        yield path, False
            case "call_expression":
                yield from self._call_writes(node)

    def _call_writes(self, node: Node) -> Iterator[tuple[tuple[str, ...] | None, bool]]:
        function = node.child_by_field_name("function")
        arguments = node.child_by_field_name("arguments")
        if function is None:
            return
        name = re.sub(r"<.*", "", self._text(function)).rpartition("::")[2].strip()
        name = re.split(r"\.|->", name)[-1].strip().strip("()")
        if function.type == "field_expression":
            argument = function.child_by_field_name("argument")
            field = function.child_by_field_name("field")
            if argument is None or field is None or _READS.match(self._text(field)):
                return
            path = self._path(argument)
            if path is not None:
                yield path, False
        elif name in _LOOKS or function.type == "primitive_type":
            return
        yield None, False
        for one in arguments.named_children if arguments is not None else ():
            path = self._path(one)
            if path is not None:
                yield path, False

    def _is_local(self, name: str, function: Node) -> bool:
        return any(self._text(found) == name for _, found in declared(function))

    def is_repeatable(self, expr: Expr) -> bool:
        """Whether an expression only looks at something."""
        spans = _spans(expr)
        if not spans:
            return isinstance(expr, Name | Num)
        return all(self._only_looks(self._node(span)) for span in spans)

    def _only_looks(self, whole: Node) -> bool:
        for node in walk(whole):
            if node.type in ("assignment_expression", "update_expression", "new_expression"):
                return False
            if node.type != "call_expression":
                continue
            function = node.child_by_field_name("function")
            arguments = node.child_by_field_name("arguments")
            if function is None or arguments is None:
                return False
            if function.type == "field_expression":
                field = function.child_by_field_name("field")
                reads = field is not None and _READS.match(self._text(field))
                if not reads or arguments.named_children:
                    return False
            elif not _SIMPLE.fullmatch(self._text(function)):
                return False
        return True

    def is_array(self, expr: Expr, place: Span) -> bool:
        """Whether a name in an expression is declared as an array, by the function around it."""
        match expr:
            case Name(name=name) | Ref(name=name):
                around = (one for one in ancestors(self._node(place)) if one.type in FUNCTIONS)
                kinds = [kind for one in around for kind in self._types_in(one, name)]
                return any(map(_ARRAY.search, kinds))
            case Op(args=args) | Fn(name="same" | "clamp", args=args):
                return any(self.is_array(arg, place) for arg in args)
        return False

    def declared_count(self, name: str, near: Span | None) -> bool | None:
        """Say whether a name is declared as an integer."""
        last = name.rpartition(".")[2]
        kinds = self._types(last, None if near is None else self._node(near))
        known = [kind for kind in kinds if _INTEGER.match(kind) or _FLOAT.match(kind)]
        if not known:
            return None
        return all(_INTEGER.match(kind) for kind in known)

    def _types(self, name: str, near: Node | None) -> list[str]:
        """Give the types that a name is declared with, by its function if that does."""
        if near is not None:
            for above in ancestors(near):
                if above.type in FUNCTIONS:
                    own = self._types_in(above, name)
                    if own:
                        return own
        return self._types_in(self._root, name)

    def _types_in(self, scope: Node, name: str) -> list[str]:
        found: list[str] = []
        for declaration, named in declared(scope):
            if self._text(named) != name:
                continue
            kind = declaration.child_by_field_name("type")
            if kind is not None:
                text = " ".join(self._text(kind).split())
                pointer = "*" in self._bytes[kind.end_byte : named.start_byte].decode("latin-1")
                found.append(f"{text}*" if pointer else _element(text))
        return found

    def quotient(self, n_inliers: str, n_samples: str) -> str:
        """Spell a division of the two doubles that the function takes."""
        return f"{n_inliers} / {n_samples}"

    # ---- what is written ------------------------------------------------------------------

    def probability(self, n_inliers: str, n_samples: str, sample_size: str, power: Span) -> str:
        """Spell the call that takes the place of a power, in the power's type."""
        kind = self._type_of_power(self._node(power))
        call = f"({n_inliers}, {n_samples}, {sample_size})"
        if kind == "float":
            return f"{HELPER}f{call}"
        call = f"{HELPER}{call}"
        if kind is None:
            return call
        return f"({kind}){call}" if self._plain_c else f"static_cast<{kind}>({call})"

    def _type_of_power(self, node: Node) -> str | None:
        """Give the type of a power where it is not double: templates may depend on it."""
        while node.type == "parenthesized_expression" and node.named_children:
            node = node.named_children[0]
        if node.type == "call_expression":
            function = node.child_by_field_name("function")
            arguments = node.child_by_field_name("arguments")
            name = "" if function is None else self._text(function)
            if name.endswith(("powf", "powf_")):
                return "float"
            if name.endswith("powl"):
                return "long double"
            if arguments is None or self._plain_c:
                return None
            kinds = [self._type_of(one) for one in arguments.named_children]
            same = len(kinds) == 2 and kinds[0] == kinds[1]
            return kinds[0] if same and kinds[0] not in (None, "double") else None
        kind = self._type_of(node)
        return None if kind == "double" else kind

    def _type_of(self, node: Node) -> str | None:
        """Give the floating type of an expression, as far as it is written down."""
        match node.type:
            case "number_literal":
                text = self._text(node)
                if not re.search(r"[.eE]", text) or text[:2] in ("0x", "0X"):
                    return None
                return "float" if text[-1] in "fF" else "double"
            case "cast_expression":
                kind = node.child_by_field_name("type")
                return None if kind is None else _floating(self._text(kind))
            case "call_expression":
                function = node.child_by_field_name("function")
                text = "" if function is None else self._text(function)
                cast = re.fullmatch(r"static_cast\s*<\s*(.*?)\s*>", text)
                return _floating(cast[1] if cast else text)
            case "identifier" | "field_expression" | "subscript_expression":
                path = self._path(node)
                kinds = {_floating(kind) for kind in self._types(path[-1], node)} if path else set()
                return kinds.pop() if len(kinds) == 1 else None
            case "binary_expression" | "parenthesized_expression" | "unary_expression":
                kinds = {self._type_of(child) for child in node.named_children} - {None}
                if "double" in kinds:
                    return "double"
                return kinds.pop() if len(kinds) == 1 else None
        return None

    def support(self, power: Span, path: str) -> tuple[Edit, ...] | str:
        """Give the edit that adds the function, where the file has none yet."""
        if self._node(power).type == "preproc_arg":
            return "the power stands in a macro, whose names may be anything"
        if self._has_other_branches(power):
            return "the power stands in a branch of a condition of the preprocessor"
        target = self._byte(power.line, power.column)
        before = self._bytes[:target].replace(b"\r\n", b"\n")
        single = self._type_of_power(self._node(power)) == "float"
        wanted = [("", HELPER_SOURCE), *([("F", FLOAT_SOURCE)] if single else [])]
        missing = [
            (mark, template)
            for mark, template in wanted
            if f"#define {GUARD}{mark}\n".encode() not in before
        ]
        if not missing:
            return ()
        if f"#define {GUARD}" not in self.text.source and HELPER in self.text.source:
            return f"the file has something else named {HELPER}"
        line, lead = anchor(self._root, target)
        kind = "static" if self._plain_c and not self._header else "static inline"
        if not self._plain_c:
            kind = "__host__ __device__ inline" if self._cuda else "inline"
        names = {"guard": GUARD, "kind": kind, "name": HELPER, "indent": indent(self._lines)}
        follows = self._lines[line - 1].strip() if line <= len(self._lines) else b""
        trail = "\n" if follows or single else ""
        return tuple(
            self.edit(Span(line, 0, line, 0), f"{lead}{template.format_map(names)}{trail}", path)
            for _, template in missing
        )

    def _has_other_branches(self, power: Span) -> bool:
        """Whether a power stands in a branch that was read without the others."""
        parsed = self._parsed.split(b"\n")
        for row in range(power.line - 2, -1, -1):
            words = self._lines[row].replace(b"#", b" # ").split()[:2]
            if words[:1] == [b"#"] and words[-1] in (b"if", b"ifdef", b"ifndef", b"endif"):
                return words[-1] != b"endif" and not parsed[row].strip()
        return False

    def sole_definition(self, name: str, place: Span) -> tuple[Span, tuple[Span, ...]] | None:
        """Find the one declaration of a variable of the function around ``place``."""
        above = ancestors(self._node(place))
        function = next((one for one in above if one.type in FUNCTIONS), None)
        if function is None or "." in name:
            return None
        found = [node for node, own in declared(function) if self._text(own) == name]
        uses = tuple(
            self._span(node)
            for node in walk(function)
            if node.type == "identifier" and self._text(node) == name
        )
        if len(found) != 1 or found[0].type != "declaration" or not uses:
            return None
        alone = len(found[0].children_by_field_name("declarator")) == 1
        in_block = found[0].parent is not None and found[0].parent.type == "compound_statement"
        if not alone or not in_block or not self._only_looks(found[0]):
            return None
        return self._span(found[0]), uses

    # ---- signatures -----------------------------------------------------------------------

    def signature(self, function: Span, parameter: str) -> Signature | str:
        """Find what changes with a parameter of a function."""
        definition = self._node(function)
        while definition.type not in FUNCTIONS and definition.named_children:
            inner = [one for one in definition.named_children if one.type in FUNCTIONS]
            if not inner:
                return "its function is not a plain one"
            definition = inner[0]
        if definition.type != "function_definition":
            return "its function is not a plain one"
        declarator = function_declarator(definition)
        named = None if declarator is None else declarator.child_by_field_name("declarator")
        block = definition.child_by_field_name("body")
        if declarator is None or named is None or block is None:
            return "its function is not a plain one"
        full = re.sub(r"<[^<>]*>", "", self._text(named))
        name = full.rpartition("::")[2].strip()
        place, own = self._parameter(declarator, parameter)
        if own is None or place is None:
            return f"{parameter} is not a plain parameter of {name}"
        kind = own.child_by_field_name("type")
        declared = "" if kind is None else self._text(kind)
        if not (_FLOAT.match(declared) or re.fullmatch(r"[A-Z]\w*", declared)):
            return f"{parameter} is not declared as a number"
        spans: list[Span] = []
        calls: list[CallSite] = []
        definitions = 0
        for node in walk(self._root):
            if node.type not in ("identifier", "field_identifier") or self._text(node) != name:
                continue
            use = node
            while use.parent is not None and (
                use.parent.type in ("qualified_identifier", "template_function")
                or (
                    use.parent.type == "field_expression"
                    and use.parent.child_by_field_name("field") == use
                )
            ):
                use = use.parent
            parent = use.parent
            if parent is None:
                continue
            if parent.type == "function_declarator":
                whole = parent.parent
                other_place, other = self._parameter(parent, None, place)
                del other_place
                if other is None:
                    return f"{name} is declared otherwise in line {node.start_point[0] + 1}"
                while whole is not None and whole.type.endswith("declarator"):
                    whole = whole.parent
                definitions += whole is not None and whole.type == "function_definition"
                if other.type == "optional_parameter_declaration":
                    return f"{parameter} has a default in {name}"
                spans.append(self._span(other))
            elif parent.type == "call_expression":
                arguments = parent.child_by_field_name("arguments")
                given = [] if arguments is None else arguments.named_children
                given = [one for one in given if one.type != "comment"]
                value = self._span(given[place]) if place < len(given) else None
                argument = None if value is None else Argument(value, value)
                calls.append(CallSite(self._span(parent), argument))
            else:
                return f"{name} is used in line {node.start_point[0] + 1} without a call"
        if definitions > 1:
            return f"there are {definitions} functions named {name}"
        first = next((one for one in block.named_children), None)
        if first is None or first.start_point[0] == block.start_point[0]:
            return f"{name} is written on one line"
        row, column = first.start_point
        lead = self._lines[row][:column].decode("utf-8", "replace")
        if lead.strip():
            return f"{name} is written on one line"
        names = frozenset(
            self._text(node) for node in walk(definition) if node.type == "identifier"
        )
        return Signature(
            parameters=tuple(spans),
            calls=tuple(calls),
            private=self._is_private(definition),
            declared=f"{declared} {{}}",
            body=Span(row + 1, 0, row + 1, 0),
            statement=f"{lead}{declared} {{name}} = {{value}};\n",
            names=names,
            uses=tuple(
                self._span(node)
                for node in walk(block)
                if node.type == "identifier" and self._text(node) == parameter
            ),
        )

    def _parameter(
        self, declarator: Node, name: str | None, place: int | None = None
    ) -> tuple[int | None, Node | None]:
        listed = declarator.child_by_field_name("parameters")
        nodes = [] if listed is None else listed.named_children
        nodes = [one for one in nodes if one.type.endswith("parameter_declaration")]
        if place is not None:
            return place, nodes[place] if place < len(nodes) else None
        for number, node in enumerate(nodes):
            inner = node.child_by_field_name("declarator")
            if inner is not None and self._text(inner) == name:
                return number, node
        return None, None

    def _is_private(self, definition: Node) -> bool:
        """Whether only this file can call a function: a static one, or of no named namespace."""
        static = any(
            child.type == "storage_class_specifier" and self._text(child) == "static"
            for child in definition.children
        )
        above = list(ancestors(definition))
        in_class = any(one.type.endswith("_specifier") for one in above)
        nameless = any(
            one.type == "namespace_definition" and one.child_by_field_name("name") is None
            for one in above
        )
        return not self._header and ((static and not in_class) or nameless)


def _spans(expr: Expr) -> tuple[Span, ...]:
    """Give the places that an expression is written in."""
    if isinstance(expr, Fn) and expr.name == "same":
        return _spans(expr.args[0])
    if expr.span is not None:
        return (expr.span,)
    if isinstance(expr, Op):
        return tuple(span for arg in expr.args for span in _spans(arg))
    return ()


def _element(kind: str) -> str:
    """Give the type of the entries of a container, or the type itself."""
    found = re.fullmatch(r"(?:std::)?(?:vector|array|unique_ptr|deque)<\s*(.+?)\s*(?:,.*)?>", kind)
    return found[1].removesuffix("[]").strip() if found else kind


def _floating(kind: str) -> str | None:
    kind = re.sub(r"\b(?:const|constexpr|static)\b|&", "", kind).strip()
    if _FLOAT.match(kind) or re.fullmatch(r"[A-Z]|[A-Z]\w*_?[Tt](?:ype)?|Scalar|Real|FT", kind):
        return kind
    return None


def _meet(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    short = min(len(one), len(other))
    return one[:short] == other[:short]
