"""Execute a stopping rule out of C or C++ source.

The expression at a finding is cut out with the definitions that it is made of, the counts, the size
and the confidence are put in where they are spelled, and what comes of it is compiled on its own.
Nothing of the project is built, and nothing of it is kept: the text goes to the compiler through a
temporary folder.
"""

import re
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import tree_sitter

from ransac_fix.scan.cpp_helper import FLOAT_SOURCE, HELPER, HELPER_SOURCE
from ransac_fix.scan.cpp_nodes import walk
from ransac_fix.scan.cpp_tree import LANGUAGE
from ransac_fix.scan.findings import Location

Node = tree_sitter.Node
Point = tuple[int, int, int, float]

_MATHEMATICS = frozenset(
    (
        *("log", "log10", "log2", "log1p", "logf", "log10f", "exp", "pow", "powf", "sqrt"),
        *("abs", "fabs", "fabsf", "min", "max", "fmin", "fmax", "fminf", "fmaxf", "clamp"),
        *("ceil", "ceilf", "floor", "floorf", "round", "lround"),
    )
)
_TYPES = re.compile(
    r"(?:const|constexpr|static|\s)*((?:unsigned|signed|long|short|int|float|double|size_t"
    r"|std::size_t|u?int\d+_t|\s)+)&?"
)
_CONSTANTS = frozenset(("DBL_MIN", "DBL_EPSILON", "FLT_EPSILON", "FLT_MIN", "DBL_MAX", "FLT_MAX"))
_DEPTH = 12
_NAMES = {"guard": "RULE_PROBABILITY", "kind": "static", "name": HELPER, "indent": "  "}
_HEAD = "#include <algorithm>\n#include <cfloat>\n#include <cmath>\n#include <cstdint>\n"
_HEAD += "#include <cstdio>\n#include <limits>\nusing namespace std;\n"
_MAIN = """
int main() {
  double i, n, k, s;
  while (std::scanf("%lf %lf %lf %lf", &n, &i, &k, &s) == 4)
    std::printf("%.17g\\n", rule(i, n, k, s));
}
"""


class NotAlone(Exception):  # noqa: N818 -- a site that needs more of its program than arithmetic
    """The site needs more of its program than arithmetic; says what."""


def arguments(call: str) -> list[str]:
    """Split the arguments of a call."""
    tree = _parse(f"x = {call};".encode())
    listed = next((node for node in walk(tree) if node.type == "argument_list"), None)
    return [] if listed is None else [_squeezed(_text(one)) for one in listed.named_children]


class CppSite:
    """The value of the expression at a finding as a function of (n, I, k, s).

    Parameters
    ----------
    source : str
    place : Location
        Of the expression.
    known : mapping of str to str
        C++ for what is spelled so: ``I``, ``n``, ``k``, ``s`` or an expression of these.

    Raises
    ------
    NotAlone
    """

    def __init__(self, source: str, place: Location, known: Mapping[str, str]) -> None:
        data = source.encode("utf-8", "surrogatepass")
        lines = source.replace("\r\n", " \n").split("\n")
        self._known = {_squeezed(text): value for text, value in known.items()}
        self._root = _parse(data)
        start = _byte(lines, place.start_line, place.start_column)
        end = _byte(lines, place.end_line, place.end_column)
        node = self._root.descendant_for_byte_range(start, end)
        if node is None or node.type not in ("binary_expression", "parenthesized_expression"):
            raise NotAlone("not one expression")
        operator = node.child_by_field_name("operator")
        if operator is not None and _text(operator) in ("<", ">", "<=", ">=", "==", "&&", "||"):
            raise NotAlone("a test, not a number of trials")
        self.single = False
        self.given = ""
        """What of the numerator is set outside of what could be read, and stands for log(1 - s)."""
        self._body = self._quotient(node)

    def run(self, points: Sequence[Point]) -> list[float]:
        """Compile the expression and work it out at every point."""
        program = _HEAD + HELPER_SOURCE.format_map(_NAMES) + FLOAT_SOURCE.format_map(_NAMES)
        program += "static double rule(double I, double n, double k, double s) {\n"
        program += f"  return (double)({self._body});\n}}\n{_MAIN}"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rule.cpp"
            path.write_text(program)
            built = subprocess.run(
                ["g++", "-std=c++17", "-O0", "-w", str(path), "-o", f"{folder}/rule"],
                capture_output=True,
                text=True,
            )
            if built.returncode:
                found = re.search(r"error: (.*)", built.stderr)
                raise NotAlone(f"g++: {found[1] if found else 'fails'}")
            given = "".join(f"{n} {i} {k} {s!r}\n" for n, i, k, s in points)
            ran = subprocess.run(
                [f"{folder}/rule"],
                input=given,
                capture_output=True,
                text=True,
                timeout=60,
                check=True,
            )
        return [float(line) for line in ran.stdout.split()]

    def _quotient(self, node: Node) -> str:
        sides = [node.child_by_field_name(one) for one in ("left", "right", "operator")]
        top, bottom, sign = sides
        if top is None or bottom is None or sign is None or _text(sign) != "/":
            return self._spell(node, node, 0)
        try:
            above = self._spell(top, node, 0)
        except NotAlone:
            # The fix does not touch it. That it is log(1 - s) shows before the fix.
            self.given = _shown(top)
            above = "log(1 - s)"
        return f"({above} / {self._spell(bottom, node, 0)})"

    # ---- spelling ---------------------------------------------------------------------------

    def _spell(self, node: Node, at: Node, depth: int) -> str:
        """Spell an expression that stands at ``at`` in terms of what is known."""
        if depth > _DEPTH:
            raise NotAlone("too deep")
        own = self._known.get(_squeezed(_text(node)))
        if own is not None:
            return f"({own})"
        match node.type:
            case "number_literal":
                return _text(node)
            case "parenthesized_expression":
                return f"({self._spell(node.named_children[0], at, depth)})"
            case "binary_expression":
                left, right = (node.child_by_field_name(one) for one in ("left", "right"))
                sign = node.child_by_field_name("operator")
                assert left
                assert right
                assert sign
                parts = self._spell(left, at, depth), self._spell(right, at, depth)
                return f"({parts[0]} {_text(sign)} {parts[1]})"
            case "unary_expression":
                argument = node.child_by_field_name("argument")
                sign = node.child_by_field_name("operator")
                assert argument
                assert sign
                return f"({_text(sign)}{self._spell(argument, at, depth)})"
            case "cast_expression":
                kind, value = (node.child_by_field_name(one) for one in ("type", "value"))
                assert kind
                assert value
                function = _squeezed(_text(kind)).rpartition("::")[2]
                if function in ("min", "max"):  # (std::max)(a, b)
                    given = list(_commas(value))
                    return f"f{function}({', '.join(self._spell(one, at, depth) for one in given)})"
                return f"(({self._type(_text(kind))})({self._spell(value, at, depth)}))"
            case "conditional_expression":
                fields = ("condition", "consequence", "alternative")
                options = [node.child_by_field_name(one) for one in fields]
                test, one, other = (self._spell(part, at, depth) for part in options if part)
                return f"({test} ? {one} : {other})"
            case "call_expression":
                return self._call(node, at, depth)
            case "identifier" | "field_expression" | "qualified_identifier":
                return self._name(node, at, depth)
        raise NotAlone(_shown(node))

    def _call(self, node: Node, at: Node, depth: int) -> str:
        function = node.child_by_field_name("function")
        listed = node.child_by_field_name("arguments")
        if function is None or listed is None:
            raise NotAlone(_shown(node))
        text = _squeezed(_text(function)).strip("()")
        given = [one for one in listed.named_children if one.type != "comment"]
        args = ", ".join(self._spell(one, at, depth) for one in given)
        cast = re.fullmatch(r"(?:static_cast<(.+)>)", text)
        if cast or text in ("double", "float", "int") or text in ("T", "Scalar"):
            return f"(({self._type(cast[1] if cast else text)})({args}))"
        name = re.sub(r"<.*?>", "", text).rpartition("::")[2]
        if "numeric_limits<" in text:
            return f"std::numeric_limits<{self._type(text.split('<')[1].split('>')[0])}>::{name}()"
        if name in (HELPER, f"{HELPER}f"):
            self.single |= name.endswith("f")
            return f"{name}({args})"
        mixed = {"max": "fmax", "min": "fmin", "abs": "fabs", "maximum": "fmax", "minimum": "fmin"}
        if name not in _MATHEMATICS | mixed.keys():
            raise NotAlone(f"{name}()")
        self.single |= name in ("logf", "powf", "log10f")
        return f"{mixed.get(name, name)}({args})"

    def _type(self, text: str) -> str:
        """Keep a type of the language; a parameter of a template is double."""
        found = _TYPES.fullmatch(text.strip())
        kind = " ".join(found[1].split()) if found else "double"
        self.single |= kind == "float"
        return kind or "double"

    def _name(self, node: Node, at: Node, depth: int) -> str:
        name = _squeezed(_text(node)).removeprefix("this->")
        if name in _CONSTANTS:
            return name
        function = _function(at)
        if function is not None:
            found = [
                one for one in _definitions(function, name) if one[0].end_byte <= at.start_byte
            ]
            if found:
                statement, value, kind = max(found, key=lambda one: one[0].start_byte)
                if not _always_run(statement, at):
                    raise NotAlone(f"{name} is set in a branch")
                return self._defined(value, kind, statement, depth)
        elsewhere = [
            one
            for one in _definitions(self._root, name)
            if function is None or _function(one[0]) != function
        ]
        spelled = {self._defined(one[1], one[2], one[0], depth) for one in elsewhere}
        if len(spelled) == 1:
            return spelled.pop()
        raise NotAlone(name if not elsewhere else f"{name}, set in {len(elsewhere)} places")

    def _defined(self, value: Node, kind: str, statement: Node, depth: int) -> str:
        if value.type in ("argument_list", "initializer_list"):
            value = value.named_children[0]
        spelled = self._spell(value, statement, depth + 1)
        if kind in ("", "auto"):
            return spelled
        return f"(({self._type(kind)})({spelled}))"


def _definitions(scope: Node, name: str) -> Iterator[tuple[Node, Node, str]]:
    """Yield each statement that gives a name its value, with the value and the declared type."""
    for node in walk(scope):
        match node.type:
            case "init_declarator":
                target, value = (
                    node.child_by_field_name("declarator"),
                    node.child_by_field_name("value"),
                )
                whole = node.parent
                kind = None if whole is None else whole.child_by_field_name("type")
                if value is not None and whole is not None and _is(target, name):
                    yield whole, value, "" if kind is None else _text(kind)
            case "field_declaration":
                target = node.child_by_field_name("declarator")
                value = node.child_by_field_name("default_value")
                kind = node.child_by_field_name("type")
                if value is not None and _is(target, name):
                    yield node, value, "" if kind is None else _text(kind)
            case "assignment_expression":
                target, value = node.child_by_field_name("left"), node.child_by_field_name("right")
                sign = node.child_by_field_name("operator")
                if value is not None and _is(target, name):
                    if sign is not None and _text(sign) != "=":
                        raise NotAlone(f"{name} {_text(sign)}")
                    yield node, value, ""
            case "field_initializer":
                parts = node.named_children
                if len(parts) == 2 and _is(parts[0], name):
                    yield node, parts[1], ""


def _commas(node: Node) -> Iterator[Node]:
    """Yield what commas separate."""
    if node.type in ("comma_expression", "parenthesized_expression"):
        for child in node.named_children:
            yield from _commas(child)
    else:
        yield node


def _is(node: Node | None, name: str) -> bool:
    return node is not None and _squeezed(_text(node)).removeprefix("this->") == name


def _always_run(statement: Node, at: Node) -> bool:
    """Whether a statement has run wherever ``at`` is reached."""
    above = statement.parent
    while above is not None and not (
        above.start_byte <= at.start_byte and at.end_byte <= above.end_byte
    ):
        if above.type in ("if_statement", "for_statement", "while_statement", "switch_statement"):
            return False
        above = above.parent
    return True


def _function(node: Node) -> Node | None:
    above: Node | None = node
    while above is not None and above.type not in ("function_definition", "lambda_expression"):
        above = above.parent
    return above


def _parse(data: bytes) -> Node:
    return tree_sitter.Parser(LANGUAGE).parse(data).root_node


def _text(node: Node) -> str:
    return (node.text or b"").decode("utf-8", "replace")


def _shown(node: Node) -> str:
    return " ".join(_text(node).split())[:60]


def _squeezed(text: str) -> str:
    return "".join(text.split())


def _byte(lines: Sequence[str], line: int, column: int) -> int:
    before = sum(len(one.encode("utf-8", "surrogatepass")) + 1 for one in lines[: line - 1])
    return before + len(lines[line - 1][: column - 1].encode("utf-8", "surrogatepass"))
