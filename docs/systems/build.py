"""Make the pages of this folder and ``ransac_fix/verdicts.json`` from the results stored here.

ransac-fix audit --matrix kornia --output-format json > report.json
python docs/systems/build.py report.json

stores what the reports say of each release in place of what was stored of it, one file a system,
and writes the pages. Without a report it only writes them.
"""

import json
import math
import re
import sys
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import msgspec
from packaging.version import Version

from ransac_fix.audit.drawing import Drawing
from ransac_fix.audit.model import OutcomeEvidence
from ransac_fix.criterion import approximate_all_inlier_probability
from ransac_fix.report.markdown import escaped
from ransac_fix.report.outcomes_text import outcome_cells
from ransac_fix.report.verdicts_markdown import MARKS
from ransac_fix.systems import System, load_systems

HERE = Path(__file__).parent
VERDICTS = HERE.parent.parent / "ransac_fix" / "verdicts.json"
SCHEMA_VERSION = 1

# As the audit writes them. Older ones stay readable when the audit learns to say more.
Json = dict[str, Any]
Results = dict[str, list[Json]]


# --- the stored results ----------------------------------------------------------------------


def stored_results() -> Results:
    """Return the releases stored, by system, in the order of ``systems.toml``."""
    found = {}
    for system in load_systems():
        path = HERE / f"{system.name}.json"
        if path.exists():
            stored = json.loads(path.read_text("utf-8"))
            assert stored["schema_version"] == SCHEMA_VERSION
            found[system.name] = stored["releases"]
    return found


def merged(results: Results, reports: Iterable[Json]) -> Results:
    """Return the results with those of new reports in place of older ones.

    A system of which nothing was measured has no page.
    """
    known = {_key(one): one for releases in results.values() for one in releases}
    for report in reports:
        failed = [control["name"] for control in report["controls"] if not control["passed"]]
        if failed or (_any_measured(report) and not report["controls"]):
            raise SystemExit(f"controls not identified: {', '.join(failed) or 'none measured'}")
        known |= {_key(one): _evidence(one) for one in report["releases"]}
    return {
        system.name: [known[key] for key in sorted(known) if key[0] == system.name]
        for system in load_systems()
        if any(key[0] == system.name and _any_verdict(one) for key, one in known.items())
    }


def _any_measured(report: Json) -> bool:
    return any(_any_verdict(release) for release in report["releases"])


def _key(release: Json) -> tuple[str, str, Version]:
    return release["system"], release["distribution"], Version(release["version"])


def _evidence(release: Json) -> Json:
    """Keep of each verdict what a page shows and a reader can check."""
    # Guarantees and advice follow from the rest.
    left_out = ("advice", "seconds", "system", "version")
    verdicts = []
    for verdict in release["verdicts"]:
        kept = {name: value for name, value in verdict.items() if name not in left_out}
        if kept["at_defaults"] is not None:
            kept["at_defaults"] = {**kept["at_defaults"], "guarantees": []}
        verdicts.append({**kept, "points": _one_each(verdict["points"])})
    return {**release, "verdicts": verdicts}


def _one_each(points: Iterable[Json]) -> list[Json]:
    """Keep the point with the most trials for each (n, I): there the laws are farthest apart."""
    best: dict[tuple[int, int], Json] = {}
    for point in points:
        key = (point["n"], point["n_inliers"])
        if key not in best or point["trials"] > best[key]["trials"]:
            best[key] = point
    return list(best.values())


def result_text(releases: list[Json]) -> str:
    """Return the text of a result file: one line a verdict, to be read in a diff."""
    lines = [f'{{"schema_version": {SCHEMA_VERSION}, "releases": [']
    for position, release in enumerate(releases):
        verdicts = ",\n  ".join(json.dumps(one) for one in release["verdicts"])
        head = {name: value for name, value in release.items() if name != "verdicts"}
        comma = "," if position + 1 < len(releases) else ""
        opening = json.dumps(head).removesuffix("}")
        lines.append(f'{opening}, "verdicts": [\n  {verdicts}]}}{comma}')
    return "\n".join([*lines, "]}", ""])


# --- the table that is installed -------------------------------------------------------------


def verdict_table(results: Results) -> str:
    """Return the text of ``verdicts.json``: one line a verdict, to be read in a diff."""
    rows = [
        {
            "system": release["system"],
            "distribution": release["distribution"],
            "version": release["version"],
            "entry_point": verdict["entry_point"],
            "verdict": verdict["verdict"],
            "formula": _formula(verdict),
            "measured_on": release["measured_on"],
        }
        for releases in results.values()
        for release in releases
        for verdict in release["verdicts"]
    ]
    lines = ",\n".join(json.dumps(row) for row in rows)
    return f'{{"schema_version": 1, "verdicts": [\n{lines}\n]}}\n'


def _formula(verdict: Json) -> str | None:
    return None if verdict["stopping_law"] is None else verdict["stopping_law"]["formula"]


# --- the pages -------------------------------------------------------------------------------


def pages(results: Results) -> dict[str, str]:
    """Return the text of every page, by file name."""
    systems = {system.name: system for system in load_systems()}
    found = {f"{name}.md": _page(systems[name], one) for name, one in results.items()}
    return {"index.md": _index(results), **found}


def _index(results: Results) -> str:
    lines = [
        "# Releases measured",
        "",
        "Which stopping rule the releases of each system obey, measured by",
        "`ransac-fix audit --matrix` on the wheels that the package index has for CPython 3.11",
        "on Linux, x86-64. [audit.md](../audit.md) explains the verdicts; the pages hold every",
        "release, its rule, and points that prove it. Of the newest release every entry point was",
        "measured, of some older ones a part.",
        "",
        "| system | releases measured | newest | verdicts on it | undersamples up to |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, releases in results.items():
        measured = [one for one in releases if _any_verdict(one)]
        newest = measured[-1]
        lines.append(
            f"| [{name}]({name}.md) | {len(measured)}: {_span(measured)} | {newest['version']} | "
            f"{_counts(newest['verdicts'])} | {_last_short(measured)} |"
        )
    return _text(lines)


def _last_short(measured: list[Json]) -> str:
    short = [
        one["version"]
        for one in measured
        if any(verdict["verdict"] == "undersamples" for verdict in one["verdicts"])
    ]
    if not short:
        return "never"
    return "the newest" if short[-1] == measured[-1]["version"] else short[-1]


def _counts(verdicts: Iterable[Json]) -> str:
    words = [one["verdict"] for one in verdicts]
    return ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))


def _page(system: System, releases: list[Json]) -> str:
    measured = [one for one in releases if _any_verdict(one)]
    names = ", ".join(
        f"`{name}`" for name in dict.fromkeys(one["distribution"] for one in releases)
    )
    lines = [
        f"# {system.name}",
        "",
        f"{names}, from [{system.upstream}](https://github.com/{system.upstream}). {system.note}",
        "",
        "## Rules",
        "",
        "| entry point | releases | verdict | rule |",
        "| --- | --- | --- | --- |",
        *_rules(releases),
        "",
        "## Evidence",
        "",
        *_evidence_of(measured[-1]),
        "## Releases",
        "",
        "| release | measured on | Python | wheel (SHA-256) | NumPy | remarks |",
        "| --- | --- | --- | --- | --- | --- |",
        *map(_release_row, releases),
    ]
    return _text(lines)


def _rules(releases: list[Json]) -> Iterator[str]:
    """Write one row for each run of releases in which an entry point behaves the same.

    A release in which it was not measured ends a run: nothing is inferred from its neighbours.
    """
    found = [{one["entry_point"]: one for one in release["verdicts"]} for release in releases]
    for name in dict.fromkeys(name for verdicts in reversed(found) for name in verdicts):
        history = [
            (release, verdicts.get(name)) for release, verdicts in zip(releases, found, strict=True)
        ]
        for behaviour, group in groupby(history, key=lambda one: one[1] and _behaviour(one[1])):
            if behaviour is None:
                continue
            same = list(group)
            span, newest = _span([release for release, _ in same]), same[-1][1]
            mark = f"{MARKS[newest['verdict']]} {newest['verdict']}"
            yield f"| {escaped(name)} | {span} | {mark} | {_rule(newest)} |"


def _behaviour(verdict: Json) -> tuple[str, str]:
    """Return what makes two releases behave the same."""
    # How far the shift of several models from one draw reaches is a matter of chance, and so is
    # which laws of the same verdict many runs did not tell apart.
    return verdict["verdict"], re.sub(r" to \d+(?=`)", "", _rule(verdict, rivals=False))


def _rule(verdict: Json, *, rivals: bool = True) -> str:
    law = verdict["stopping_law"]
    if law is None:
        return escaped(verdict["reason"])
    tested = "" if law["tested"] == "every trial" else f", tested {law['tested']} only"
    # What many runs did not tell from it, which means the same verdict.
    _, _, others = verdict["reason"].partition("; or it assumes ")
    beside = f", or with P = {escaped(others.rpartition(', which ')[0])}" if others else ""
    return f"`{law['formula']}`{tested}{beside if rivals else ''}"


def _evidence_of(release: Json) -> Iterator[str]:
    """Write the points of a release, and what its runs returned where there are none."""
    points, outcomes = list(_points(release)), list(_outcomes(release))
    of_release = f"Release {release['version']}."
    if points:
        yield from (
            f"{of_release} At trial t a model with I of n measurements was in hand, and",
            "u = -ln(1-s) was just high enough for the rule to go on. A rule that assumes P does",
            "so at t = u/-ln(1-P), up to a shift that is the same for all points of one rule; the",
            "exact one assumes the P of the samples as they were measured to be drawn.",
            "",
            "| entry point | n | I | k | t | u | t if (I/n)^k | t if exact |",
            "| --- | --- | --- | --- | --- | --- | --- | --- |",
            *points,
            "",
        )
    if outcomes:
        yield from (
            f"{of_release} Where runs can be neither repeated nor counted, or given no number of",
            "trials, many were made:",
            "`kept I` is the share of those that found one of two models, of I and of I+1 of n",
            "measurements, that ended with the smaller; beside it what P = (I/n)^k, the exact P",
            "and the law found predict.",
            "",
            "| entry point | n | I | s | runs | kept I | if (I/n)^k | if exact | by the law |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *outcomes,
            "",
            "By how much the likeliest law is likelier than those that came closest: a lower bound",
            "of the natural logarithm of the likelihood ratio, below 0 where they are alike.",
            "",
            "| entry point | runs | likelier than |",
            "| --- | --- | --- |",
            *_ratios(release),
            "",
        )


def _outcomes(release: Json) -> Iterator[str]:
    for verdict in release["verdicts"]:
        if verdict["stopping_law"] is None or verdict.get("outcomes") is None:
            continue
        evidence = msgspec.convert(verdict["outcomes"], OutcomeEvidence)
        for cells in outcome_cells(evidence):
            yield f"| {' | '.join((escaped(verdict['entry_point']), *cells))} |"


def _ratios(release: Json) -> Iterator[str]:
    for verdict in release["verdicts"]:
        if verdict["stopping_law"] is None or verdict.get("outcomes") is None:
            continue
        seen = verdict["outcomes"]
        ratios = ", ".join(f"`{one['law']}` by {one['log_ratio']:g}" for one in seen["ratios"])
        yield f"| {escaped(verdict['entry_point'])} | {seen['runs']:,} | {ratios} |"


def _points(release: Json) -> Iterator[str]:
    for verdict in release["verdicts"]:
        for point in verdict["points"]:
            counts = point["n_inliers"], point["n"], point["sample_size"]
            cells = (
                escaped(verdict["entry_point"]),
                *(
                    point["n"],
                    point["n_inliers"],
                    point["sample_size"],
                    point["trials"],
                    f"{point['u']:.4f}",
                ),
                _trials(point["u"], approximate_all_inlier_probability(*counts)),
                _trials(point["u"], _sampled(point, verdict["sampler_law"])),
            )
            yield f"| {' | '.join(map(str, cells))} |"


def _sampled(point: Json, sampler: Json) -> float:
    """Return the chance that one sample as it was measured to be drawn holds inliers only."""
    drawing = Drawing("distinct", point["sample_size"])
    if sampler["drawn"] not in ("not uniform", "undecided"):
        quota = tuple(sampler.get("quota", ()))
        drawing = Drawing(sampler["drawn"], sampler["sample_size"], quota)
    strata = tuple(map(tuple, point.get("strata", ())))
    return drawing.probability(strata or ((point["n_inliers"], point["n"]),))


def _trials(u: float, probability: float) -> str:
    return f"{u / -math.log1p(-probability):.2f}" if 0 < probability < 1 else "-"


def _release_row(release: Json) -> str:
    numpy = next(
        (d.partition("==")[2] for d in release["dependencies"] if d.startswith("numpy=")), ""
    )
    digest = f"`{release['sha256'][:16]}`" if release["sha256"] else ""
    remarks = release["remark"]
    if not _any_verdict(release):
        why = release["unmeasured"] or release["verdicts"][0]["reason"]
        remarks = f"not measured: {why}"
    cells = (
        release["version"],
        release["measured_on"],
        release["python"],
        digest,
        numpy,
        escaped(remarks),
    )
    return f"| {' | '.join(cells)} |"


def _span(releases: list[Json]) -> str:
    first, last = releases[0]["version"], releases[-1]["version"]
    return first if first == last else f"{first} to {last}"


def _any_verdict(release: Json) -> bool:
    return any(verdict["verdict"] != "not measured" for verdict in release["verdicts"])


def _text(lines: list[str]) -> str:
    made = "<!-- Made by build.py from the results beside it; edit neither by hand. -->"
    return "\n".join([made, "", *lines, ""])


def main(arguments: list[str]) -> None:
    """Merge reports, if any, and write everything."""
    reports = [json.loads(Path(one).read_text("utf-8")) for one in arguments]
    results = merged(stored_results(), reports)
    for name, releases in results.items():
        (HERE / f"{name}.json").write_text(result_text(releases), "utf-8")
    for name, text in pages(results).items():
        (HERE / name).write_text(text, "utf-8")
    VERDICTS.write_text(verdict_table(results), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
