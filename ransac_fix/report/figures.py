"""The theory figures: curves to files, and the same numbers as a small table."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ransac_fix.experiments.figures import (
    CONFIDENCE,
    Panel,
    error_panels,
    success_panels,
    tradeoff_panels,
    undersampling_panels,
)
from ransac_fix.report.drawing import LINE_STYLES, figure_settings, save_figure
from ransac_fix.report.text_table import text_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# About this many of a curve's points get a marker.
_MARKERS = 12
_LANDMARKS = {
    "n": (20.0, 50.0, 100.0, 200.0, 300.0),
    "p": (0.1, 0.2, 0.3, 0.5, 0.7, 0.9),
    "N": (10.0, 100.0, 1000.0),
}
_X_LABELS = {"n": "measurements $n$", "p": "inlier ratio $p$", "N": "mean trials $N$"}


@dataclass(frozen=True, slots=True)
class TheoryFigure:
    """One figure of the paper's theory.

    Parameters
    ----------
    title : str
        What it shows.
    panels : callable
        Computes its curves.
    over : "n", "p" or "N"
        The horizontal axis.
    y_label : str
        The vertical axis.
    """

    title: str
    panels: Callable[[], tuple[Panel, ...]]
    over: Literal["n", "p", "N"]
    y_label: str


THEORY_FIGURES = {
    "figure-error": TheoryFigure(
        "relative error of p^k, (P_a - P_e) / P_a",
        error_panels,
        "p",
        r"relative error $(P_a-P_e)/P_a$",
    ),
    "figure-success": TheoryFigure(
        f"true success of the p^k rule, s = {float(CONFIDENCE):g}",
        success_panels,
        "n",
        r"true success $s_\mathrm{true}$",
    ),
    "figure-undersampling": TheoryFigure(
        f"undersampling (N_e - N_a) / N_a, s = {float(CONFIDENCE):g}",
        undersampling_panels,
        "n",
        r"$N_{e/a}=(N_e-N_a)/N_a$",
    ),
    "figure-tradeoff": TheoryFigure(
        "share of instances with an all-inlier sample over their mean trials, as s varies",
        tradeoff_panels,
        "N",
        "all-inlier sample drawn",
    ),
}


def theory_figure_text(name: str) -> str:
    """Return the curves' values at a few landmarks, one table a panel."""
    figure = THEORY_FIGURES[name]
    parts = [figure.title]
    landmarks = _LANDMARKS[figure.over]
    for panel in figure.panels():
        rows = []
        for curve in panel.curves:
            at = dict(zip(curve.x, curve.y, strict=True))
            values = [at.get(x) for x in landmarks]
            rows.append([_plain(curve.label), *("" if v is None else f"{v:.4g}" for v in values)])
        header = [_plain(panel.title), *(f"{figure.over} = {x:g}" for x in landmarks)]
        parts.append(text_table(header, rows))
    return "\n\n".join(parts)


def draw_theory_figure(name: str, path: Path) -> None:
    """Draw one of the theory figures and write it.

    Parameters
    ----------
    name : str
        A key of `THEORY_FIGURES`.
    path : Path
        Where it goes; the suffix says how (.svg, .pdf or .png).
    """
    import matplotlib as mpl

    figure = THEORY_FIGURES[name]
    panels = figure.panels()
    with mpl.rc_context(figure_settings()):
        from matplotlib.figure import Figure

        width = 6.9 if len(panels) > 1 else 3.4
        drawing = Figure(figsize=(width, 2.5), layout="constrained")
        for axes, panel in zip(
            drawing.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
        ):
            _draw_panel(axes, panel, figure, name)
        save_figure(drawing, path)


def _draw_panel(axes: "Axes", panel: Panel, figure: TheoryFigure, name: str) -> None:
    for curve, style in zip(panel.curves, LINE_STYLES, strict=False):
        marked = list(curve.whole[:: max(1, len(curve.whole) // _MARKERS)])
        axes.plot(curve.x, curve.y, label=curve.label, markevery=marked, **style)
        if name == "figure-success":  # no all-inlier sample exists to the left of k / p
            axes.vlines(
                curve.x[0], 0, curve.y[0], color=style["color"], linewidth=0.6, linestyle=":"
            )
    axes.set_title(panel.title)
    axes.set_ylabel(figure.y_label)
    axes.set_xlabel(_X_LABELS[figure.over])
    if name == "figure-undersampling":
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda y, _: f"{100 * y:g} %")
    else:
        axes.set_ylim(0, 1.03)
    if name == "figure-success":
        axes.axhline(float(CONFIDENCE), color="#777777", linewidth=0.8)
    if figure.over == "N":
        axes.set_xscale("log")
    else:
        axes.set_xlim(0, 1 if figure.over == "p" else None)
    axes.legend(handlelength=3.2, loc="lower right" if figure.over == "N" else "best")


def _plain(label: str) -> str:
    return label.replace("$", "").replace("\\ ", " ").replace("=", " = ")
