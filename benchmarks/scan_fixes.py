"""What ``--fix`` makes of labelled sites of public repositories.

    python benchmarks/scan_fixes.py CORPUS.tsv MIRROR [--verbose]
    python benchmarks/scan_fixes.py systems MIRROR [--tree SYSTEM=FOLDER] [--at SYSTEM=REVISION]

CORPUS.tsv and MIRROR are those of ``scan_corpus.py``; ``systems`` takes the files that
``systems.toml`` names instead, as ``scan_systems.py`` does. Each file with an approximate site is
fixed, unsafe fixes included, in memory. The table says how many findings have a safe fix, an unsafe
one or none, and why not; whether every result can be read and holds no rule that was fixed; that a
second run changes nothing; and, for sites that can be worked out by arithmetic alone, that they are
exact by execution: the original gives the approximate number over a grid of (n, I, k, s), and the
fixed one the exact number. Python is evaluated; C and C++ are cut out and compiled by g++
(``cpp_site.py``), and where a site cannot be, what it needs is named.
"""

import argparse
import ast
import csv
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from cpp_site import CppSite, NotAlone, arguments
from scan_corpus import Row, content, overlaps
from scan_systems import sources

from ransac_fix import all_inlier_probability
from ransac_fix.scan.files import LANGUAGES, SourceFile
from ransac_fix.scan.findings import Edit, Finding, Location
from ransac_fix.scan.fixes import apply_edits
from ransac_fix.scan.fixing import fix_findings
from ransac_fix.scan.python_source import _HELPER_SOURCE
from ransac_fix.scan.scanner import encoding_of, scan_source
from ransac_fix.systems import load_systems

RULES = ("RFX001", "RFX002", "RFX003")
MIN_SINGLE = 3e-3
GRID = [
    (n, i, k, s)
    for n in (9, 20, 57, 200)
    for i in sorted({4, 6, n // 3, n // 2, n - 2})
    for k in (2, 3, 4)
    for s in (0.9, 0.99)
    if k < i < n
]


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
        self._module = tree
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
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                parts = {
                    "a": self._value(left, known, line, depth),
                    "b": self._value(right, known, line, depth),
                }
                return eval(f"a {OPERATORS[type(op)]} b", {}, parts)
            case ast.Attribute() if ast.unparse(node) == "sys.float_info.epsilon":
                return 2.0**-52
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self._value(operand, known, line, depth)
            case ast.Call(func=function, args=args, keywords=keywords) if all(
                one.arg in ("a_min", "a_max") for one in keywords
            ):
                args = [*args, *(one.value for one in keywords)]
                name = ast.unparse(function).rpartition(".")[2]
                if name not in FUNCTIONS and name not in self._helper:
                    raise NotAlone(name)
                called = FUNCTIONS.get(name) or self._helper[name]
                return called(*(self._value(one, known, line, depth) for one in args))
        raise NotAlone(ast.unparse(node))

    def _name(self, name: str, known: dict[str, float], line: int, depth: int) -> Any:
        before = [
            node
            for scope in (self._scope, self._module)
            for node in ast.walk(scope)
            if isinstance(node, ast.Assign)
            and (node.lineno < line if scope is self._scope else node.col_offset == 0)
            and any(isinstance(one, ast.Name) and one.id == name for one in node.targets)
        ]
        if not before or depth > 9:
            raise NotAlone(name)
        last = max(before, key=lambda node: (node.col_offset > 0, node.lineno))
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
    "spacing": math.ulp,
    "clip": lambda value, low, high: min(max(value, low), high),
}


def execute(before: str, finding: Finding, language: str) -> str:
    """Work a site out before and after its fix, where that takes arithmetic only."""
    verdict = _execute(before, finding, language, missed=False)
    if verdict.startswith("OTHER"):  # what is called p may be the chance of a miss
        other = _execute(before, finding, language, missed=True)
        verdict = verdict if other.startswith("OTHER") else other
    return verdict


def _execute(before: str, finding: Finding, language: str, *, missed: bool) -> str:
    assert finding.fix is not None
    calls = [edit for edit in finding.fix.edits if "all_inlier_probability" in edit.content]
    (power,) = [edit for edit in calls if "\n" not in edit.content]
    after = apply_edits(before, [power])
    size, s_text = finding.roles.get("sample_size", ""), finding.roles.get("confidence", "")
    given_count = arguments(power.content)[0]  # a first budget may be for so many inliers
    points: list[tuple[int, int, int, float]] = []
    for n, i, k, s in GRID:
        k = int(size) if size.isdigit() else k
        s = float(s_text) if re.fullmatch(r"[0-9.]+", s_text) else s
        i = int(given_count) if given_count.isdigit() else i
        if k <= i < n:
            points.append((n, i, k, s))
    worst = [0.0, 0.0]
    single, given = False, ""
    for place, source in enumerate((before, after)):
        if language == "c++":
            site = _cpp_site(source, finding, power, fixed=place == 1)
            single |= site.single
            given = site.given
            # In single precision 1 - p keeps no digits of a small p.
            points = [one for one in points if not single or _exact(*one[:3]) > MIN_SINGLE]
            values = site.run([(n, i, k, 1 - s if missed else s) for n, i, k, s in points])
        else:
            evaluated = Site(source, finding, power.content if place else "")
            values = [evaluated(n, i, k, 1 - s if missed else s) for n, i, k, s in points]
        for (n, i, k, s), value in zip(points, values, strict=True):
            p = _exact(n, i, k) if place else (i / n) ** k
            rule = math.log1p(-s) / math.log1p(-p)
            worst[place] = max(worst[place], abs(value / rule - 1))
    tolerance = 1e-3 if single else 1e-6
    if not worst[0] <= tolerance:
        return f"OTHER    the original is off the approximate number by {worst[0]:.0e}"
    verdict = "EXACT   " if worst[1] <= tolerance else "DIFFERS "
    stands = f", with log(1 - s) for {given}" if given else ""
    return f"{verdict} within {worst[1]:.0e} of the exact number at {len(points)} points{stands}"


def _exact(n: int, i: int, k: int) -> float:
    return all_inlier_probability(i, n, k)


def _cpp_site(source: str, finding: Finding, power: Edit, *, fixed: bool) -> CppSite:
    """Cut out a site, of the original or with the power replaced."""
    roles = finding.roles
    named = {"sample_size": "k", "confidence": "s", "n_inliers": "I", "n_samples": "n"}
    known = {
        roles[role]: value
        for role, value in {"inlier_ratio": "I / n", **named}.items()
        if role in roles and not re.fullmatch(r"[0-9.]+", roles[role])
    }
    place = finding.location
    if fixed:
        given = arguments(power.content)
        known = {one: known[one] for one in known if known[one] in ("k", "s")}
        known |= {given[1]: "n"} if given[0].isdigit() else {given[0]: "I", given[1]: "n"}
        place = _moved(place, power)
    return CppSite(source, place, known)


def _moved(place: Location, edit: Edit) -> Location:
    """Give a place after an edit of one line inside or before it."""
    at = edit.location
    grown = len(edit.content) - (at.end_column - at.start_column)
    rows = at.end_line - at.start_line  # what was on several lines is on one

    def point(line: int, column: int) -> tuple[int, int]:
        if (line, column) < (at.end_line, at.end_column):
            return line, column
        if line > at.end_line:
            return line - rows, column
        if rows:
            return line - rows, at.start_column + len(edit.content) + column - at.end_column
        return line, column + grown

    start = point(place.start_line, place.start_column)
    end = point(place.end_line, place.end_column)
    return Location(place.path, *start, *end)


Case = tuple[str, bytes, Callable[[Finding], bool]]


def _corpus(options: argparse.Namespace) -> Iterator[Case]:
    with Path(options.corpus).open(newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    files: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        if row["label"] == "approx":
            files[row["repo"], row["commit"], row["path"]].append(row)
    for (repo, _, path), sites in files.items():

        def wanted(finding: Finding, sites: list[Row] = sites) -> bool:
            return any(overlaps(finding, row) for row in sites)

        yield f"{repo}/{path}", content(options.mirror, sites[0]), wanted


def _systems(options: argparse.Namespace) -> Iterator[Case]:
    trees = {name: Path(folder) for name, _, folder in (one.partition("=") for one in options.tree)}
    revisions = dict(one.split("=", 1) for one in options.at)
    seen: set[str] = set()
    for system in load_systems():
        for site in system.sites:
            if PurePosixPath(site.path).suffix.lower() not in LANGUAGES:
                continue
            found = list(
                sources(
                    options.mirror,
                    system.upstream,
                    trees.get(system.name),
                    site.path,
                    revisions.get(system.name, "HEAD"),
                )
            )
            if not found:
                print(f"NOT HERE {system.name}/{site.path}")
            for path, data in found:
                name = f"{system.name}/{path}"
                if name not in seen:
                    seen.add(name)
                    yield name, data, lambda _: True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("corpus", help="A table of labelled sites, or `systems`.")
    parser.add_argument("mirror", type=Path)
    parser.add_argument("--tree", action="append", default=[], metavar="SYSTEM=FOLDER")
    parser.add_argument("--at", action="append", default=[], metavar="SYSTEM=REVISION")
    parser.add_argument("--verbose", action="store_true", help="Show every change.")
    options = parser.parse_args()
    count: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    cases = _systems(options) if options.corpus == "systems" else _corpus(options)
    for name, data, wanted in cases:
        language = LANGUAGES[PurePosixPath(name).suffix.lower()]
        file = SourceFile(name, language, named=True)
        before = data.decode(encoding_of(data, language))
        findings = [
            one for one in scan_source(before, file)[0] if one.code in RULES and wanted(one)
        ]
        for one in findings:
            kind = "none" if one.fix is None else "safe" if one.fix.safe else "unsafe"
            count[kind] += 1
            if one.fix is None:
                reasons[one.no_fix] += 1
            if options.verbose or options.corpus == "systems":
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
            for one in result.fixed if language != "notebook" else ():
                try:
                    verdict = execute(before, one, language)
                except (ArithmeticError, NotAlone, SyntaxError, TypeError, ValueError) as error:
                    verdict = f"NOT RUN  it needs {error}"
                count[verdict[:8].strip()] += 1
                print(f"{verdict[:8]} {name}:{one.location.start_line}{verdict[8:]}")
    total = sum(count[kind] for kind in ("safe", "unsafe", "none"))
    print(f"{total} findings: {count['safe']} safe, {count['unsafe']} unsafe, {count['none']} none")
    for name in (*("fixed", "left alone", "unreadable", "not idempotent"),):
        print(f"{name}: {count[name]}")
    print(f"executed: {count['EXACT'] + count['DIFFERS']}, exact by execution: {count['EXACT']}")
    print(f"another number to begin with: {count['OTHER']}, not executed: {count['NOT RUN']}")
    for reason, number in reasons.most_common():
        print(f"{number:4} {reason}")


if __name__ == "__main__":
    main()
