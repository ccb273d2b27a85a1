"""The sweep of an explanation as a figure: trials of both rules, and the true success."""

import math
from collections.abc import Sequence
from pathlib import Path

from ransac_fix.experiments.explanation import Explanation
from ransac_fix.report.drawing import LINE_STYLES, figure_settings, save_figure

# Matplotlib works in floats.
_MOST_DRAWN = 10**300


def draw_sweep(
    asked: Explanation, rows: Sequence[Explanation], over: str, sampling: str, path: Path
) -> None:
    """Draw trials and true success over the swept number and write the figure.

    Parameters
    ----------
    asked : Explanation
        The user's own numbers, marked in both panels.
    rows : sequence of Explanation
        The sweep, in order.
    over : "n" or "p"
        What was swept.
    sampling : str
        The sampling law to draw.
    path : Path
        Where the figure goes; its suffix says how (.svg, .pdf or .png).
    """
    import matplotlib as mpl

    with mpl.rc_context(figure_settings()):
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.9, 2.6), layout="constrained")
        trials, success = figure.subplots(1, 2)
        xs = [_swept(row, over) for row in rows]
        exact = [row.law(sampling).required_trials for row in rows]
        approximate = [row.approximate_trials for row in rows]
        for values, label, style in (
            (approximate, "$p^k$ rule, $N_a$", LINE_STYLES[1]),
            (exact, "exact rule, $N_e$", LINE_STYLES[2]),
        ):
            trials.plot(xs, [_on_log_axis(v) for v in values], label=label, **style)
        limits = (("floor", asked.problem.min_trials), ("cap", asked.problem.max_trials))
        for name, limit in limits:
            if limit:
                trials.axhline(limit, color="#777777", linewidth=0.8)
                trials.annotate(
                    f"{name}: {limit:,}",
                    (xs[0], limit),
                    textcoords="offset points",
                    xytext=(0, 3),
                    fontsize=8,
                )
        trials.set_yscale("log")
        trials.set_ylabel("trials")
        trials.legend()
        confidence = float(asked.problem.confidence)
        success.axhline(confidence, color="#777777", linewidth=0.8)
        success.annotate(
            f"asked for: {confidence:g}",
            (xs[-1], confidence),
            textcoords="offset points",
            xytext=(0, -9),
            ha="right",
            fontsize=8,
        )
        success.plot(xs, [row.law(sampling).true_success for row in rows], **LINE_STYLES[1])
        success.set_ylabel("true success of the $p^k$ rule")
        success.set_ylim(0, 1.03)
        for axes in (trials, success):
            if over == "n":
                axes.set_xscale("log")
            axes.axvline(_swept(asked, over), color="#777777", linewidth=0.8, linestyle=":")
            axes.set_xlabel("measurements $n$" if over == "n" else "inlier ratio $p$")
        problem = asked.problem
        fixed = (
            f"p = {problem.n_inliers / problem.n_samples:.4g}"
            if over == "n"
            else f"n = {problem.n_samples}"
        )
        law = {"distinct": "distinct draws", "replacement": "draws with replacement"}[sampling]
        figure.suptitle(
            f"k = {problem.sample_size}, {fixed}, s = {confidence:g}, {law}", fontsize=9
        )
        save_figure(figure, path)


def _on_log_axis(trials: int | None) -> float:
    return math.nan if trials is None or trials > _MOST_DRAWN else max(trials, 1)


def _swept(row: Explanation, over: str) -> float:
    problem = row.problem
    return problem.n_samples if over == "n" else problem.n_inliers / problem.n_samples
