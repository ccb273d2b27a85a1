"""What ``--fix`` makes of labelled sites of public repositories.

    python benchmarks/scan_fixes.py CORPUS.tsv MIRROR [--verbose]

CORPUS.tsv and MIRROR are those of ``scan_corpus.py``. Each file with an approximate site is fixed,
unsafe fixes included, in memory. The table says how many findings have a safe fix, an unsafe one or
none, and why not; whether every result can be read and holds no rule that was fixed; that a second
run changes nothing; and, for sites that can be worked out by arithmetic alone, that they are exact
by execution: the original gives the approximate number over a grid of (n, I, k, s), and the fixed
one the exact number.
"""

import argparse
import ast
import csv
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scan_corpus import Row, content, overlaps

from ransac_fix import all_inlier_probability
from ransac_fix.scan.files import SourceFile
from ransac_fix.scan.findings import Finding
from ransac_fix.scan.fixes import apply_edits
from ransac_fix.scan.fixing import fix_findings
from ransac_fix.scan.python_source import _HELPER_SOURCE
from ransac_fix.scan.scanner import encoding_of, scan_source

RULES = ("RFX001", "RFX002", "RFX003")
GRID = [
    (n, i, k, s)
    for n in (9, 20, 57, 200)
    for i in sorted({4, 6, n // 3, n // 2, n - 2})
    for k in (2, 3, 4)
    for s in (0.9, 0.99)
    if k < i < n
]


class NotAlone(Exception):  # noqa: N818 -- a site that needs more of its program than arithmetic
    pass


class Site:
    """The value of the expression at a finding, worked out from the counts by its own source.

    Of the program only arithmetic is evaluated: the expression, and the assignments of its function
    that it is made of, with the counts, the size and the confidence put in where they are spelled.
    """

    def __init__(self, source: str, finding: Finding, call: str = "") -> None:
        self._finding = finding
        # Where the fix takes its counts from: both, or the number of data and the ratio.
        self._counts: list[str] = []
        if call:
            parsed = ast.parse(call, mode="eval").body
            assert isinstance(parsed, ast.Call)
            self._counts = [ast.unparse(one) for one in parsed.args[:2]]
        place = finding.location
        lines = source.splitlines()
        column = len(lines[place.start_line - 1][: place.start_column - 1].encode())
        tree = ast.parse(source)
        self._expr = max(
            (
                node
                for node in ast.walk(tree)
                if isinstance(node, ast.BinOp)
                and (node.lineno, node.col_offset) == (place.start_line, column)
            ),
            key=lambda node: (node.end_lineno or 0, node.end_col_offset or 0),
            default=None,
        )
        self._scope: ast.AST = tree
        for node in ast.walk(tree):
            inside = isinstance(node, ast.FunctionDef) and (
                node.lineno <= place.start_line <= (node.end_lineno or 0)
            )
            self._scope = node if inside else self._scope
        self._helper: dict[str, Any] = {}
        exec(_HELPER_SOURCE, self._helper)

    def __call__(self, n: int, i: int, k: int, s: float) -> float:
        if self._expr is None:
            raise NotAlone("not one expression")
        values = {"n_inliers": i, "n_samples": n, "sample_size": k, "confidence": s}
        known: dict[str, float] = {}
        spelled = {self._finding.roles.get(role): value for role, value in values.items()}
        spelled |= {self._finding.roles.get("inlier_ratio"): i / n}
        spelled |= dict(zip(self._counts, (i, n), strict=True)) if self._counts else {}
        for text, value in spelled.items():
            if text is not None and not text.replace(".", "").isdigit():
                known[ast.dump(ast.parse(text.strip(), mode="eval").body)] = value
        value = self._value(self._expr, known, self._expr.lineno, 0)
        if not isinstance(value, int | float):
            raise NotAlone("not a number")
        return float(value)

    def _value(self, node: ast.expr, known: dict[str, float], line: int, depth: int) -> Any:
        own = known.get(ast.dump(_loaded(node)))
        if own is not None:
            return own
        parts = {}
        match node:
            case ast.Constant(value=int() | float() as value):
                return value
            case ast.Name(id=name):
                return self._name(name, known, line, depth)
            case ast.BinOp(left=left, op=op, right=right):
                parts = {
                    "a": self._value(left, known, line, depth),
                    "b": self._value(right, known, line, depth),
                }
                return eval(f"a {OPERATORS[type(op)]} b", {}, parts)
            case ast.Attribute() if ast.unparse(node) == "sys.float_info.epsilon":
                return 2.0**-52
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self._value(operand, known, line, depth)
            case ast.Call(func=function, args=args, keywords=[]):
                name = ast.unparse(function).rpartition(".")[2]
                if name not in FUNCTIONS and name not in self._helper:
                    raise NotAlone(name)
                called = FUNCTIONS.get(name) or self._helper[name]
                return called(*(self._value(one, known, line, depth) for one in args))
        raise NotAlone(ast.unparse(node))

    def _name(self, name: str, known: dict[str, float], line: int, depth: int) -> Any:
        before = [
            node
            for node in ast.walk(self._scope)
            if isinstance(node, ast.Assign)
            and node.lineno < line
            and any(isinstance(one, ast.Name) and one.id == name for one in node.targets)
        ]
        if not before or depth > 9:
            raise NotAlone(name)
        last = max(before, key=lambda node: node.lineno)
        return self._value(last.value, known, last.lineno, depth + 1)


def _loaded(node: ast.expr) -> ast.expr:
    return ast.parse(ast.unparse(node), mode="eval").body


OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in ("exp", "log", "log10", "log1p", "log2", "pow")},
    "power": math.pow,
    "float": float,
    "float64": float,
    "abs": abs,
    "max": max,
    "min": min,
    "round": round,
}


def execute(before: str, finding: Finding, count: Counter[str], where: str) -> None:
    """Work a site out before and after its fix, where that takes arithmetic only."""
    assert finding.fix is not None
    edits = [edit for edit in finding.fix.edits if "_all_inlier_probability(" in edit.content]
    (power,) = [edit for edit in edits if "def _all_inlier" not in edit.content]
    after = apply_edits(before, [power])
    size, s_text = finding.roles.get("sample_size", ""), finding.roles.get("confidence", "")
    try:
        old, new = Site(before, finding), Site(after, finding, power.content)
        worst = [0.0, 0.0]
        for n, i, k, s in GRID:
            k = int(size) if size.isdigit() else k
            s = float(s_text) if re.fullmatch(r"[0-9.]+", s_text) else s
            if i <= k:
                continue
            for place, (site, p) in enumerate(
                ((old, (i / n) ** k), (new, all_inlier_probability(i, n, k)))
            ):
                rule = math.log1p(-s) / math.log1p(-p)
                worst[place] = max(worst[place], abs(site(n, i, k, s) / rule - 1))
    except (NotAlone, SyntaxError, TypeError, ValueError, ZeroDivisionError) as error:
        print(f"NOT RUN  {where}: {error}")
        return
    if worst[0] > 1e-6:
        count["other to begin with"] += 1
        print(f"OTHER    {where}: the original does not give the approximate number")
        return
    count["executed"] += 1
    count["exact by execution"] += worst[1] < 1e-6
    verdict = "EXACT   " if worst[1] < 1e-6 else "DIFFERS "
    print(f"{verdict} {where}: within {worst[1]:.0e} of the exact number")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("mirror", type=Path)
    parser.add_argument("--verbose", action="store_true", help="Show every change.")
    options = parser.parse_args()
    with options.corpus.open(newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    files: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if row["label"] == "approx":
            files[row["repo"], row["commit"], row["path"]].append(row)
    count: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    for (repo, _, path), sites in files.items():
        data = content(options.mirror, sites[0])
        language = "notebook" if path.endswith(".ipynb") else "python"
        name = f"{repo}/{path}"
        file = SourceFile(name, language, named=True)
        before = data.decode(encoding_of(data, language))
        findings = [
            one
            for one in scan_source(before, file)[0]
            if one.code in RULES and any(overlaps(one, row) for row in sites)
        ]
        for one in findings:
            kind = "none" if one.fix is None else "safe" if one.fix.safe else "unsafe"
            count[kind] += 1
            if one.fix is None:
                reasons[one.no_fix] += 1
            if options.verbose:
                print(f"{kind.upper():8} {name}:{one.location.start_line} {one.no_fix}")
        fixed, errors = fix_findings(findings, unsafe=True, contents={name: data})
        for error in errors:
            count["left alone"] += 1
            print(f"LEFT     {name}: {error.message}")
        for result in fixed:
            if options.verbose:
                print(result.diff())
            count["fixed"] += len(result.fixed)
            again, unread = scan_source(result.after, file)
            count["unreadable"] += len(unread) > 0
            repeated, _ = fix_findings(again, unsafe=True, contents={name: result.encoded()})
            if repeated:
                count["not idempotent"] += 1
                print(f"AGAIN    {name}")
            if language == "python":
                for one in result.fixed:
                    where = f"{name}:{one.location.start_line}"
                    execute(before, one, count, where)
    total = sum(count[kind] for kind in ("safe", "unsafe", "none"))
    print(f"{total} findings: {count['safe']} safe, {count['unsafe']} unsafe, {count['none']} none")
    for name in (
        *("fixed", "left alone", "unreadable", "not idempotent"),
        *("executed", "exact by execution", "other to begin with"),
    ):
        print(f"{name}: {count[name]}")
    for reason, number in reasons.most_common():
        print(f"{number:4} {reason}")


if __name__ == "__main__":
    main()
