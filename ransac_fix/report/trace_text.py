"""A trace as text for the terminal."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from ransac_fix.patching.summary import CallSite, Range, TraceReport, Verification, WorstCall
from ransac_fix.report.text_table import probability_text

if TYPE_CHECKING:
    from rich.console import Console

_LEGEND = (
    "short: stopped before its guarantee held. A guarantee is the probability that, with a model"
    " of I inliers in hand, one sample lay wholly within any other set of I inliers. It is not the"
    " success rate of a run."
)
_WIDEST = 100


def print_trace(report: TraceReport, console: "Console") -> None:
    """Print a trace.

    Parameters
    ----------
    report : TraceReport
        The trace.
    console : rich.console.Console
        Where to; it decides about colours.
    """
    from rich.text import Text

    width = min(console.width, _WIDEST)

    def put(line: str, indent: str = "", style: str = "") -> None:
        for part in textwrap.wrap(line, width - len(indent), break_long_words=False):
            console.print(Text(indent + part, style=style), soft_wrap=True)

    for site in report.sites:
        style = "bold red" if site.short else "bold green" if _read(site) else "bold"
        place = f"{_file(site.file)}:{site.line}" if site.line else site.file
        console.print(
            Text.assemble((place, "bold"), f"  {site.system} ", (site.function, style)),
            soft_wrap=True,
        )
        for line in _lines(site):
            put(line, " " * 4)
    if report.sites:
        console.print()
    put(_summary(report), style="bold")
    if report.verification is not None:
        for line in _verification(report.verification):
            put(line)
    for line in _footnotes(report):
        put(line)


def _read(site: CallSite) -> int:
    return site.calls - site.unread - site.failed


def _lines(site: CallSite) -> list[str]:
    calls = _many(site.calls, "call")
    if site.caller and site.caller != "<module>":
        calls += f" in {site.caller}"
    calls += f", {_time(site.total_seconds)}"
    if site.patched:
        calls += f", {site.patched} of them patched"
    lines = [calls]
    if _read(site):
        assert site.n_samples
        assert site.n_inliers
        assert site.sample_size
        assert site.confidence
        assert site.trials
        assert site.needed
        at_least = "" if site.trials_are == "counted" else "at least "
        lines.append(
            f"n={_span(site.n_samples)}  I={_span(site.n_inliers)}  k={_span(site.sample_size)}"
            f"  s={_probability(site.confidence)}"
        )
        lines.append(
            f"trials: {at_least}{_span(site.trials)}, exact {_span(site.needed)};"
            f" bound by {_bounds(site)}"
        )
    if site.short:
        assert site.shortfall
        assert site.worst
        lines.append(
            f"{site.short} short of the guarantee, by {_points(site.shortfall.median)} typically;"
            f" worst: {_worst(site.worst)}"
        )
        if site.extra_trials:
            lines.append(
                "exactness within the limits: "
                f"{site.extra_trials:,.0f} more trials, about {_time(site.extra_seconds)}"
            )
    if site.replayed:
        lines.append(
            f"made again exactly: {_many(site.replayed, 'call')}, {site.missed} of them found more"
            " inliers"
        )
    if site.unread:
        lines.append(
            f"{site.unread} could not be read: another method than RANSAC, no model found, or"
            " RANSAC inside"
        )
    if site.failed:
        lines.append(f"{site.failed} raised an exception")
    if site.remedy:
        lines.append(f"remedy: {site.remedy}")
    return lines


def _summary(report: TraceReport) -> str:
    bounds = report.bounds
    text = (
        f"{_many(report.calls, 'RANSAC call')} at {_many(len(report.sites), 'call site')} in"
        f" {_many(report.processes, 'process')}, {_time(report.seconds)}: {report.short} short of"
        " their guarantee"
    )
    if report.short_by_cap:
        text += f", {report.short_by_cap} of them by a limit on trials"
    read = bounds.rule + bounds.cap + bounds.floor
    if read:
        text += f". Bound by the rule {bounds.rule}, a cap {bounds.cap}, a floor {bounds.floor}"
    if report.extra_trials:
        text += (
            f". Exactness within the limits: {report.extra_trials:,.0f} more trials, about"
            f" {_time(report.extra_seconds)}"
        )
    return text + "."


def _verification(found: Verification) -> list[str]:
    """Say how many models were really missed."""
    if not found.telling:
        return ["Made again exactly: none, as no call stopped short of what its limits allow."]
    lines = []
    if found.replayed:
        assert found.rate is not None
        assert found.low is not None
        assert found.high is not None
        rate, low, high = (f"{100 * value:.1f}" for value in (found.rate, found.low, found.high))
        line = (
            f"Made again exactly: {found.replayed} of the {found.telling:,} calls that stopped"
            f" short of what their limits allow. {found.missed} of them then found a model with"
            f" more inliers: {rate} % [{low}, {high}] (95 %)"
        )
        if found.gained is not None:
            more = "inlier" if found.gained.high == 1 else "inliers"
            line += f", {_span(found.gained)} {more} more"
        lines.append(f"{line}.")
    for why, count in found.not_replayed.items():
        lines.append(f"{_many(count, 'call')} could not be made again: {why}.")
    return lines


def _footnotes(report: TraceReport) -> list[str]:
    lines = [_LEGEND] if report.short else []
    lines += [f"{system} was not watched: {why}." for system, why in report.left_out.items()]
    return [*lines, report.not_visible]


def _bounds(site: CallSite) -> str:
    bounds = site.bounds
    named = (("the rule", bounds.rule), ("a cap", bounds.cap), ("a floor", bounds.floor))
    found = [(name, count) for name, count in named if count]
    if len(found) == 1:
        return found[0][0]
    return ", ".join(f"{name} {count}" for name, count in found)


def _worst(worst: WorstCall) -> str:
    cap = f" (limit {_number(worst.max_trials)})" if worst.bound == "cap" else ""
    return (
        f"{worst.n_inliers} of {worst.n_samples}, {_number(worst.trials)} trials{cap} where"
        f" {_number(worst.needed)} are needed, {probability_text(worst.success)} in place of"
        f" {worst.confidence:.6g}"
    )


def _file(name: str) -> str:
    path = Path(name)
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else name


def _span(values: Range) -> str:
    if values.low == values.high:
        return _number(values.low)
    return f"{_number(values.low)}..{_number(values.high)} (median {_number(values.median)})"


def _number(value: float | None) -> str:
    if value is None:
        return "infinite"
    return f"{value:,.0f}" if value < 1e9 else f"{value:.2g}"


def _probability(values: Range) -> str:
    low, high = values.low, values.high
    assert low is not None
    assert high is not None
    return f"{low:.6g}" if low == high else f"{low:.6g}..{high:.6g}"


def _points(value: float | None) -> str:
    assert value is not None
    return f"{100 * value:.2g} points"


def _time(seconds: float) -> str:
    if seconds < 1:
        return f"{seconds * 1e3:.3g} ms"
    return f"{seconds:.3g} s"


def _many(count: int, thing: str) -> str:
    plural = f"{thing}es" if thing.endswith("s") else f"{thing}s"
    return f"{count:,} {thing if count == 1 else plural}"
