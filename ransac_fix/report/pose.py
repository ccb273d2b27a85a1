"""The pose tables as text, Markdown and JSON, and the teaser figure."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Literal

from ransac_fix.experiments.pose.tables import PAPER, PAPER_MILLISECONDS, THRESHOLDS, Row
from ransac_fix.report.drawing import LINE_STYLES, figure_settings, save_figure
from ransac_fix.report.text_table import markdown_table, text_table

SCHEMA_VERSION: Literal[1] = 1

_NAMES = {
    "homography": "Homography",
    "essential": "Essential matrix",
    "fundamental": "Fundamental matrix",
    "pnp": "Perspective-n-Point",
}
_HEADER = ("n", "s", "measure", "approximate", "exact", "change [95 %]")
_PATCHED_HEADER = ("n", "s", "measure", "bare", "patched", "change [95 %]")
_PAPER_HEADER = ("paper: approximate", "exact", "change")


_BRIEF_HEADER = (
    "",
    "n",
    "s",
    "library",
    "AUC@10 {}",
    "{}",
    "change [95 %]",
    "paper",
    "trials: {}",
    "{}",
    "ms: {}",
    "{}",
    "pairs",
    "capped",
)


@dataclass(frozen=True, slots=True)
class PoseDocument:
    """What ``ransac-fix reproduce pose`` prints as JSON."""

    schema_version: Literal[1]
    rows: tuple[Row, ...]


def pose_text(rows: Sequence[Row], *, paper: bool, brief: bool = False) -> str:
    """Return a table for each library, kind of problem and data set, for the terminal.

    Parameters
    ----------
    rows : sequence of Row
        In the order of `summarise`, one library after the other.
    paper : bool
        Whether the paper's numbers stand beside ours.
    brief : bool, default False
        One table of all libraries, a line a row, AUC@10 only.
    """
    if brief:
        return text_table(*_brief(rows, paper=paper), left=4)
    return _tables(rows, paper=paper, markdown=False)


def pose_markdown(rows: Sequence[Row], *, paper: bool, brief: bool = False) -> str:
    """Return the same as Markdown."""
    if brief:
        return markdown_table(*_brief(rows, paper=paper), left=4)
    return _tables(rows, paper=paper, markdown=True)


def pose_json(rows: Sequence[Row]) -> str:
    """Return the rows as a JSON document; its schema is `schemas/pose.json`."""
    return json.dumps(asdict(PoseDocument(SCHEMA_VERSION, tuple(rows))), indent=2)


def teaser_text(rows: Sequence[Row]) -> str:
    """Return accuracy and time of both rules as s varies, as a table."""
    header = ("s", "approximate: ms", "AUC@10", "exact: ms", "AUC@10", "change [95 %]")
    cells = [
        [
            f"{row.confidence:g}",
            f"{1e3 * row.seconds[0]:.3f}",
            f"{row.approximate[1]:.2f}",
            f"{1e3 * row.seconds[1]:.3f}",
            f"{row.exact[1]:.2f}",
            _change(row, 1),
        ]
        for row in rows
    ]
    return text_table(header, cells)


def draw_teaser(rows: Sequence[Row], path: Path) -> None:
    """Draw AUC@10 against run time, a point for each s, and write the figure."""
    import matplotlib as mpl

    with mpl.rc_context(figure_settings()):
        from matplotlib.figure import Figure

        figure = Figure(figsize=(3.4, 2.5), layout="constrained")
        axes = figure.subplots()
        for rule, label, style in (
            (0, "approximate", LINE_STYLES[1]),
            (1, "exact", LINE_STYLES[2]),
        ):
            times = [1e3 * row.seconds[rule] for row in rows]
            auc = [(row.approximate, row.exact)[rule][1] for row in rows]
            axes.plot(times, auc, label=label, **style)
            for row, x, y in zip(rows, times, auc, strict=True):
                axes.annotate(
                    f"{row.confidence:g}",
                    (x, y),
                    textcoords="offset points",
                    xytext=(4, -8) if rule else (0, 6),
                    ha="left" if rule else "center",
                    fontsize=6,
                )
        axes.margins(x=0.14, y=0.14)
        axes.set_xlabel("mean processor time (ms)")
        axes.set_ylabel("AUC@10 (%)")
        axes.set_title(f"{_NAMES[rows[0].kind]}, $n={rows[0].n_samples}$, a point a confidence $s$")
        axes.legend(loc="lower right")
        save_figure(figure, path)


def _brief(rows: Sequence[Row], *, paper: bool) -> tuple[list[str], list[list[str]]]:
    """Return header and cells of one table: all libraries, AUC@10 only."""
    order = list(_NAMES)
    cells = []
    for row in sorted(rows, key=lambda r: (order.index(r.kind), r.unit, r.n_samples, r.confidence)):
        theirs = PAPER[row.kind].get((row.n_samples, row.confidence)) if paper else None
        place = row.unit if row.dataset == "all" else row.dataset
        line = [f"{_NAMES[row.kind]}, {place}", f"{row.n_samples}", f"{row.confidence:g}"]
        line += [row.library, f"{row.approximate[1]:.2f}", f"{row.exact[1]:.2f}", _change(row, 1)]
        line.append("" if theirs is None else _paper_change(theirs, 1))
        line += ["", ""] if row.trials is None else [f"{t:,.1f}" for t in row.trials]
        line += [f"{1e3 * t:.3f}" for t in row.seconds]
        line.append(f"{row.n_problems:,}")
        line.append("" if row.capped is None else f"{row.capped:.1f} %")
        cells.append(line)
    names = iter((_HEADER if rows[0].trials is not None else _PATCHED_HEADER)[3:5] * 3)
    header = [title.format(next(names)) if "{}" in title else title for title in _BRIEF_HEADER]
    # Columns without anything in them are left out: the paper's, or those of unknown trials.
    kept = [i for i in range(len(header)) if any(line[i] for line in cells)]
    return [header[i] for i in kept], [[line[i] for i in kept] for line in cells]


def _tables(rows: Sequence[Row], *, paper: bool, markdown: bool) -> str:
    parts = []
    own = _PATCHED_HEADER if rows[0].trials is None else _HEADER
    header = (*own, *_PAPER_HEADER) if paper else own
    for (library, kind, unit, dataset), group in groupby(
        rows, lambda r: (r.library, r.kind, r.unit, r.dataset)
    ):
        found = list(group)
        shown = "" if dataset == "all" else f", {dataset}"
        title = f"{_NAMES[kind]} ({library}), errors in {unit}{shown}"
        cells = [line for row in found for line in _lines(row, paper=paper and dataset == "all")]
        cells = [line + [""] * (len(header) - len(line)) for line in cells]
        if markdown:
            parts.append(f"### {title}\n\n{markdown_table(header, cells, left=3)}")
        else:
            parts.append(f"{title}\n{text_table(header, cells, left=3)}")
    return "\n\n".join(parts)


def _lines(row: Row, *, paper: bool) -> list[list[str]]:
    at = [f"{row.n_samples}", f"{row.confidence:g}"]
    theirs = PAPER[row.kind].get((row.n_samples, row.confidence)) if paper else None
    lines = []
    for i, threshold in enumerate(THRESHOLDS):
        line = [
            *at,
            f"AUC@{threshold:g}",
            f"{row.approximate[i]:.2f}",
            f"{row.exact[i]:.2f}",
            _change(row, i),
        ]
        if theirs is not None:
            line += [f"{theirs[0][i]:.2f}", f"{theirs[1][i]:.2f}", _paper_change(theirs, i)]
        lines.append(line)
    if row.trials is not None:
        lines.append([*at, "trials", *(f"{t:,.1f}" for t in row.trials), _more(row.trials)])
    times = [*at, "ms", *(f"{1e3 * t:.3f}" for t in row.seconds), _more(row.seconds)]
    if theirs is not None:
        ms = PAPER_MILLISECONDS[row.kind][row.n_samples, row.confidence]
        times += [f"{ms[0]:g}", f"{ms[1]:g}", _more(ms)]
    lines.append(times)
    size = f"{row.n_problems:,} pairs, {row.n_cases:,} subsamples"
    shares = (
        ""
        if row.differing is None
        else f"stopped apart {row.differing:.1f} %, capped {row.capped:.1f} %"
    )
    lines.append([*at, size, "", "", shares])
    return lines


def _paper_change(theirs: tuple[tuple[float, ...], tuple[float, ...]], i: int) -> str:
    return f"{100 * (theirs[1][i] / theirs[0][i] - 1):+.2f}"


def _more(pair: tuple[float, float]) -> str:
    return f"{100 * (pair[1] / pair[0] - 1):+.1f}"


def _change(row: Row, i: int) -> str:
    change = row.change[i]
    if change is None:
        return ""
    return f"{change.value:+.2f} [{change.low:+.2f}, {change.high:+.2f}]"
