"""An audit as text for the terminal."""

import math
from collections.abc import Iterable
from itertools import groupby
from typing import TYPE_CHECKING

from ransac_fix.audit.drawing import Drawing
from ransac_fix.audit.model import (
    AtDefaults,
    Extension,
    Guarantee,
    Point,
    Report,
    SamplerLaw,
    Verdict,
)
from ransac_fix.audit.sampling import drawing_of
from ransac_fix.criterion import approximate_all_inlier_probability
from ransac_fix.report.controls_text import controls_summary, failure_lines
from ransac_fix.report.outcomes_text import OUTCOMES_LEGEND, outcome_lines
from ransac_fix.report.text_table import count_text, probability_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

STYLES = {
    "exact": "bold green",
    "undersamples": "bold red",
    "oversamples": "bold yellow",
    "other rule": "bold magenta",
    "not measured": "bold",
}
WIDEST = 100
_INDENT = 4
# Rows of a wrapped function's trials.
_FEW = 4

_POINTS_LEGEND = (
    "At trial t a model with I of n measurements was in hand, and u = -ln(1-s) was just high "
    "enough for the rule to go on. A rule that assumes P does so at t = u/-ln(1-P), up to a shift "
    "of a few trials: the two columns on the right, for P = (I/n)^k and for the P of its samples "
    "as they were measured to be drawn."
)
_GUARANTEE_LEGEND = (
    "A guarantee is the probability that, with a model of I inliers in hand, one sample lay "
    "wholly within any other set of I inliers. It is not the success rate of a run."
)


def print_verdicts(report: Report, console: "Console", *, every_point: bool = False) -> None:
    """Print the audit.

    Parameters
    ----------
    report : Report
        The audit.
    console : rich.console.Console
        Where to; it decides about colours.
    every_point : bool, default False
        Print all points, not one for each (n, I).
    """
    from rich.text import Text

    console.width = min(console.width, WIDEST)
    for system, verdicts in groupby(report.verdicts, key=lambda verdict: verdict.system):
        of_system = list(verdicts)
        version = next((v.version for v in of_system if v.version), "")
        console.print(Text(f"{system} {version}".rstrip(), style="bold"))
        for verdict in of_system:
            _print_verdict(verdict, console, every_point)
        console.print()
    for line in failure_lines(report.controls):
        console.print(Text(line, style="bold red"))
    measured = [verdict for verdict in report.verdicts if verdict.points or verdict.outcomes]
    legends = [_GUARANTEE_LEGEND] if measured else []
    if any(verdict.outcomes for verdict in measured):
        legends.insert(0, OUTCOMES_LEGEND)
    if any(verdict.points for verdict in measured):
        legends.insert(0, _POINTS_LEGEND)
    for paragraph in legends:
        console.print(Text(paragraph, style="dim"))
    if legends:
        console.print()
    if report.not_installed:
        console.print(Text("not installed: " + ", ".join(report.not_installed), style="dim"))
    console.print(Text(_summary(report)))


def _print_verdict(verdict: Verdict, console: "Console", every_point: bool) -> None:
    from rich.padding import Padding
    from rich.text import Text

    head = Text("  ")
    head.append(verdict.verdict, style=STYLES[verdict.verdict])
    head.append(f"  {verdict.entry_point}")
    if verdict.stopping_law is not None:
        head.append(f"  {verdict.stopping_law.formula}")
    console.print(head, overflow="fold")
    body: list[Text | Table] = [Text(f"{verdict.reason}.")]
    if verdict.points:
        points = verdict.points if every_point else _one_each(verdict.points)
        body.append(_points_table(points, verdict.sampler_law))
    if verdict.extension is not None:
        body += _extension(verdict.extension)
    if verdict.outcomes is not None:
        body += outcome_lines(verdict.outcomes, every_point=every_point)
    if verdict.at_defaults is not None:
        body += _defaults(verdict.at_defaults)
    if verdict.advice:
        body.append(Text(verdict.advice, style="italic"))
    for part in body:
        console.print(Padding(part, (0, 0, 0, _INDENT), expand=False))


def _extension(extension: Extension) -> "list[Text | Table]":
    """Return the evidence on a wrapped function."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("n", "I", "k", "s", "own", "missing", "total", "exact"):
        table.add_column(title, justify="right", no_wrap=True)
    for count in extension.counts[:_FEW]:
        missing = None if count.trials is None or count.own is None else count.trials - count.own
        table.add_row(
            str(count.n_samples),
            str(count.n_inliers),
            str(count.sample_size),
            f"{count.confidence:.4g}",
            *map(count_text, (count.own, missing, count.trials, count.required)),
        )
    body: list[Text | Table] = [table]
    test = extension.outcomes
    if test is not None:
        body.append(
            Text(
                f"Outcomes at n={test.n_samples} I={test.n_inliers} s={test.confidence:.4g}: the"
                f" larger set is found in {_share(test.larger, test.smaller)} of the runs that find"
                f" one, {test.chance_exact:.3f} with {test.exact:,} trials, {test.chance_own:.3f}"
                f" with {test.own:,} (log likelihood ratio {test.log_ratio:+.1f}); without the"
                f" missing trials in {_share(test.larger_alone, test.smaller_alone)}"
                f" ({test.log_ratio_alone:+.1f})."
            )
        )
    return body


def _share(larger: int, smaller: int) -> str:
    return f"{larger} of {larger + smaller}"


def _one_each(points: Iterable[Point]) -> list[Point]:
    """Keep the point with the most trials for each (n, I): there the laws are farthest apart."""
    best: dict[tuple[int, int], Point] = {}
    for point in points:
        key = (point.n, point.n_inliers)
        if key not in best or point.trials > best[key].trials:
            best[key] = point
    return list(best.values())


def _points_table(points: Iterable[Point], sampler: SamplerLaw | None) -> "Table":
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("n", "I", "k", "t", "u", "t if (I/n)^k", "t if exact"):
        table.add_column(title, justify="right", no_wrap=True)
    for point in points:
        counts = point.n_inliers, point.n, point.sample_size
        table.add_row(
            str(point.n),
            str(point.n_inliers),
            str(point.sample_size),
            str(point.trials),
            f"{point.u:.4f}",
            _trials(point.u, approximate_all_inlier_probability(*counts)),
            _trials(point.u, _sampled(point, sampler)),
        )
    return table


def _sampled(point: Point, sampler: SamplerLaw | None) -> float:
    """Return the chance that one sample as it was measured to be drawn holds inliers only."""
    drawing = Drawing("distinct", point.sample_size)
    if sampler is not None and sampler.drawn not in ("not uniform", "undecided"):
        drawing = drawing_of(sampler)
    return drawing.probability(point.strata or ((point.n_inliers, point.n),))


def _trials(u: float, probability: float) -> str:
    return f"{u / -math.log1p(-probability):.2f}" if 0 < probability < 1 else "-"


def _defaults(at_defaults: AtDefaults) -> "list[Text | Table]":
    from rich.table import Table
    from rich.text import Text

    limits = [f"s = {at_defaults.confidence:g}"]
    if at_defaults.min_trials:
        limits.append(f"at least {at_defaults.min_trials:,} trials")
    if at_defaults.max_trials is not None:
        limits.append(f"at most {at_defaults.max_trials:,}")
    if at_defaults.multiplier != 1:
        limits.append(f"{at_defaults.multiplier:g} times what the rule says")
    checked = {True: " (checked by running)", False: " (runs behaved otherwise)", None: ""}
    line = f"by default: {', '.join(limits)}{checked[at_defaults.checked]}"
    if at_defaults.n_strata > 1 and at_defaults.guarantees:
        line += f"; inliers spread evenly over {at_defaults.n_strata} strata"
    if not at_defaults.guarantees:
        return [Text(line)]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("n", "I", "k", "s", "trials", "set by", "exact", "guarantee"):
        table.add_column(title, justify="right", no_wrap=True)
    for row in at_defaults.guarantees:
        table.add_row(*_cells(row))
    return [Text(line), table]


def _cells(row: Guarantee) -> tuple[str, ...]:
    return (
        str(row.n),
        str(row.n_inliers),
        str(row.sample_size),
        f"{row.confidence:g}",
        f"{row.trials:,}",
        row.binds,
        count_text(row.exact_trials),
        probability_text(row.probability),
    )


def _summary(report: Report) -> str:
    counts: dict[str, int] = {}
    for verdict in report.verdicts:
        counts[verdict.verdict] = counts.get(verdict.verdict, 0) + 1
    found = ", ".join(f"{count} {word}" for word, count in counts.items()) or "nothing measured"
    return (
        f"{found}; {controls_summary(report.controls)}; "
        f"{report.runs:,} library runs in {report.seconds:.0f} s"
    )
