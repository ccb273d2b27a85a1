"""The synthetic tables as text, Markdown and JSON, the paper's numbers beside ours."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

from ransac_fix.experiments.intervals import Estimate
from ransac_fix.experiments.synthetic.setup import PaperRow, Setup
from ransac_fix.experiments.synthetic.speed import Speed
from ransac_fix.experiments.synthetic.tables import Row, paper_change
from ransac_fix.report.text_table import markdown_table, text_table

SCHEMA_VERSION: Literal[1] = 1

_HEADER = (
    "I/n",
    "measure",
    "approximate",
    "exact",
    "change [95 %]",
    "paper: approximate",
    "exact",
    "change",
)


@dataclass(frozen=True, slots=True)
class SetupRecord:
    """What was run; the fields are explained in the documentation of the setup."""

    shape: str
    n_samples: int
    n_inliers: int
    confidence: float
    noise: str
    scope: str
    placement: str
    outliers: str
    limit: str
    conics: str
    ties: str
    distance: str
    error: str
    streams: str


@dataclass(frozen=True, slots=True)
class RowRecord:
    """One row; AUC and changes in percent, three numbers for thresholds 1, 2, 3."""

    setup: SetupRecord
    n_instances: int
    approximate: tuple[Estimate, ...]
    exact: tuple[Estimate, ...]
    change: tuple[Estimate | None, ...]
    in_hand: tuple[float, float]
    trials: tuple[float, float]
    trials_if_kept: float
    more_trials: Estimate
    more_trials_an_instance: Estimate
    tests: int
    paper: PaperRow | None


@dataclass(frozen=True, slots=True)
class SyntheticDocument:
    """What ``ransac-fix reproduce line`` and ``ellipse`` print as JSON."""

    schema_version: Literal[1]
    rows: tuple[RowRecord, ...]


def synthetic_text(rows: Sequence[Row]) -> str:
    """Return the table with its heading for the terminal."""
    return f"{_title(rows)}\n\n{text_table(_HEADER, _cells(rows), left=2)}"


def synthetic_markdown(rows: Sequence[Row]) -> str:
    """Return the same as Markdown."""
    return f"{_title(rows)}\n\n{markdown_table(_HEADER, _cells(rows), left=2)}"


def synthetic_json(rows: Sequence[Row]) -> str:
    """Return the rows as a JSON document; its schema is `schemas/synthetic.json`."""
    document = SyntheticDocument(SCHEMA_VERSION, tuple(_record(row) for row in rows))
    return json.dumps(asdict(document), indent=2)


def variants_table(named: Sequence[tuple[str, Sequence[Row]]], *, markdown: bool = False) -> str:
    """Return one line a variant of the setup: how far it is from the paper's table.

    Parameters
    ----------
    named : sequence of (name, rows)
        Each variant's name and its table.
    markdown : bool, default False
        Whether to return Markdown in place of text.
    """
    header = (
        "variant",
        "AUC of both rules,\nmean distance",
        "change of AUC@3 +- 95 %\nat each I/n (paper)",
        "N_e/a +- 95 %\nat each I/n (paper)",
    )
    lines = []
    for name, rows in named:
        compared = [(row, row.paper) for row in rows if row.paper is not None]
        distances = [
            abs(ours.value - theirs)
            for row, paper in compared
            for ours, theirs in zip(
                (*row.approximate, *row.exact), (*paper.approximate, *paper.exact), strict=True
            )
        ]
        lines.append(
            [
                name,
                f"{sum(distances) / len(distances):.2f}",
                "  ".join(
                    f"{_spread(row.change[2], 2)} ({paper_change(paper, 2):+.2f})"
                    for row, paper in compared
                ),
                "  ".join(
                    f"{_spread(row.more_trials, 1)} ({paper.more_trials:+.1f})"
                    for row, paper in compared
                ),
            ]
        )
    if markdown:
        return markdown_table([title.replace("\n", " ") for title in header], lines)
    return text_table(header, lines)


def speed_text(speeds: Sequence[Speed], *, markdown: bool = False) -> str:
    """Return the speed of each row beside the machine's peak and scikit-image.

    Parameters
    ----------
    speeds : sequence of Speed
        One a row.
    markdown : bool, default False
        Whether to return Markdown in place of text.
    """
    header = (
        "row",
        "million point tests/s",
        "share of the core's peak",
        "us an instance",
        "scikit-image, us an instance",
        "ratio, median",
    )
    rows = []
    for speed in speeds:
        row = [
            f"{speed.setup.shape}, I/n = {speed.setup.inlier_ratio:g}",
            f"{speed.tests_a_second / 1e6:,.0f}",
            f"{100 * speed.share_of_peak:.1f} % of {speed.peak_flops / 1e9:.1f} GFLOP/s",
            f"{1e6 * speed.seconds:,.0f}",
        ]
        if speed.peer_seconds is not None and speed.ratio is not None:
            row += [f"{1e6 * speed.peer_seconds:,.0f}", f"{speed.ratio:,.0f}"]
        else:
            row += ["", ""]
        rows.append(row)
    return markdown_table(header, rows) if markdown else text_table(header, rows)


def _title(rows: Sequence[Row]) -> str:
    setup, n = rows[0].setup, rows[0].n_instances
    return (
        f"{setup.shape}: n = {setup.n_samples}, k = {setup.sample_size},"
        f" s = {float(setup.confidence):g}, {n:,} instances a row. AUC and changes in percent;"
        f" paired 95 % intervals.\n{_choices(setup)}"
    )


def _choices(setup: Setup) -> str:
    chosen: dict[str, str] = {
        "noise": setup.noise,
        "scope": setup.scope,
        "placement": setup.placement,
        "outliers": setup.outliers,
        "limit": setup.limit,
        "ties": setup.ties,
        "error": setup.error,
        "streams": setup.streams,
    }
    if setup.shape == "ellipse":
        chosen |= {"distance": setup.distance, "conics": setup.conics}
    return "Choices: " + ", ".join(f"{name} {value}" for name, value in chosen.items()) + "."


def _cells(rows: Sequence[Row]) -> list[list[str]]:
    cells = []
    for row in rows:
        ratio = f"{row.setup.inlier_ratio:.4g}"
        for i in range(3):
            approximate, exact = row.approximate[i].value, row.exact[i].value
            line = [
                ratio,
                f"AUC@{i + 1}",
                f"{approximate:.3f}",
                f"{exact:.3f}",
                _signed(row.change[i], 2),
            ]
            if row.paper is not None:
                line += [
                    f"{row.paper.approximate[i]:.3f}",
                    f"{row.paper.exact[i]:.3f}",
                    f"{paper_change(row.paper, i):+.2f}",
                ]
            cells.append(line)
        trials = [
            ratio,
            "trials",
            f"{row.trials[0]:,.1f}",
            f"{row.trials[1]:,.1f}",
            _signed(row.more_trials, 2),
        ]
        if row.paper is not None:
            trials += ["", "", f"{row.paper.more_trials:+.1f}"]
        cells.append(trials)
        kept = 100 * (row.trials_if_kept / row.trials[0] - 1)
        first, last = row.in_hand
        cells.append([ratio, "inliers in hand", f"{first:.2f}", f"{last:.2f}"])
        cells.append(
            [ratio, "trials, model kept", "", f"{row.trials_if_kept:,.1f}", f"{kept:+.2f}"]
        )
    return [line + [""] * (len(_HEADER) - len(line)) for line in cells]


def _signed(estimate: Estimate | None, digits: int) -> str:
    if estimate is None:
        return ""
    return f"{estimate.value:+.{digits}f} [{estimate.low:+.{digits}f}, {estimate.high:+.{digits}f}]"


def _spread(estimate: Estimate | None, digits: int) -> str:
    if estimate is None:
        return "-"
    half = (estimate.high - estimate.low) / 2
    return f"{estimate.value:+.{digits}f}+-{half:.{digits}f}"


def _record(row: Row) -> RowRecord:
    setup = row.setup
    return RowRecord(
        SetupRecord(
            setup.shape,
            setup.n_samples,
            setup.n_inliers,
            float(setup.confidence),
            setup.noise,
            setup.scope,
            setup.placement,
            setup.outliers,
            setup.limit,
            setup.conics,
            setup.ties,
            setup.distance,
            setup.error,
            setup.streams,
        ),
        row.n_instances,
        row.approximate,
        row.exact,
        row.change,
        row.in_hand,
        row.trials,
        row.trials_if_kept,
        row.more_trials,
        row.more_trials_an_instance,
        row.tests,
        row.paper,
    )
