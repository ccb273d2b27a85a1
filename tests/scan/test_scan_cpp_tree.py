"""C++ that only the preprocessor understands, and code that is nested deeply."""

import pytest

from ransac_fix.scan import cpp_tree
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.scanner import scan_source

RULE = "int trials = (int) (log(1 - s) / log(1 - pow(w, k)));"
FUNCTION = f"int ransac(double w, double s, int k) {{ {RULE} return trials; }}"

HIDDEN = {
    "a namespace that a macro opens": f"""
int before;
NAMESPACE_BEGIN
template <class T>
int ransac(double w, double s, int k)
{{
  {RULE}
  return trials;
}}
NAMESPACE_END
""",
    "a value that depends on a condition": """
int ransac(double w, double s, int k) {
  double p =
#ifdef SINGLE
      powf(w, k);
#else
      pow(w, k);
#endif
  return (int) (log(1 - s) / log(1 - p));
}
""",
    "a loop that is opened twice": f"""
void ransac(double w, double s, int k) {{
#if FAST
  for (int i = 0; i < 10; i++) {{
#else
  for (int i = 0; i < 1000; i++) {{
#endif
    {RULE}
    if (i > trials) break;
  }}
}}
void after() {{}}
""",
    "an object that could be a function": """
int ransac(double w, double s, int k) {
  const double miss(s), good(pow(w, k));
  return log(miss) / log(1 - good);
}
""",
    "a long sum": f"std::string s = {' + '.join('a' for _ in range(600))};\n{FUNCTION}",
    "a long line of output": f"void f() {{ std::cout {'<< a ' * 600}; }}\n{FUNCTION}",
    "a long chain of conditions": (
        "int f(int x) { "
        + "".join(f"if (x == {i}) return {i}; else " for i in range(300))
        + f"return 0; }}\n{FUNCTION}"
    ),
    "a long chain of calls": "\n".join(
        [
            *(f"double f{i}(double x);" for i in range(201)),
            *(f"double f{i}(double x) {{ return x + f{i + 1}(x); }}" for i in range(200)),
            FUNCTION,
        ]
    ),
}


@pytest.mark.parametrize("source", HIDDEN.values(), ids=HIDDEN.keys())
def test_reads_the_rule_in(source):
    found, errors = scan_source(source, SourceFile("ransac.cpp", "c++", named=True))
    assert [one.code for one in found].count("RFX001") == 1
    assert not errors


def test_blanks_keep_every_place():
    source = HIDDEN["a namespace that a macro opens"].encode()
    root = cpp_tree.parse(source)
    assert not root.has_error
    start = source.index(b"int ransac")
    node = root.descendant_for_byte_range(start, start + 10)
    assert node is not None
    assert source[node.start_byte : node.end_byte].startswith(b"int ransac")


def test_a_source_that_parses_is_parsed_as_it_stands():
    source = b"#if A\nint f() { return 1; }\n#else\nint g() { return 2; }\n#endif\n"
    names = str(cpp_tree.parse(source))
    assert names.count("function_definition") == 2
