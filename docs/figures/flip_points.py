"""Draw the measured points of an audit against what two stopping rules predict.

ransac-fix audit --output-format json > audit.json
python docs/figures/flip_points.py audit.json docs/figures/flip_points.svg
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from ransac_fix.criterion import all_inlier_probability, approximate_all_inlier_probability
from ransac_fix.report.drawing import LINE_STYLES, figure_settings, save_figure

SHOWN = {
    "findHomography(RANSAC)": "OpenCV findHomography",
    "RANSACRegressor": "scikit-learn RANSACRegressor",
    "RANSAC(homography)": "kornia RANSAC",
    "estimate_homography_matrix": "pycolmap estimate_homography_matrix",
}
PANELS = (
    ("trials if $P = (I/n)^k$", approximate_all_inlier_probability),
    ("trials if $P = C(I, k)\\,/\\,C(n, k)$", all_inlier_probability),
)
RANGE = (8.0, 3000.0)


def draw(audit: dict[str, Any], path: Path) -> None:
    """Write the figure of the audit's points to `path`."""
    verdicts = [v for v in audit["verdicts"] if v["entry_point"] in SHOWN]
    with mpl.rc_context(figure_settings()):
        figure = Figure(figsize=(6.6, 3.6), layout="constrained")
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        for panel, (label, probability) in zip(axes, PANELS, strict=True):
            panel.plot(RANGE, RANGE, color="#888888", linewidth=0.8, zorder=1)
            for verdict, style in zip(verdicts, LINE_STYLES, strict=False):
                points = verdict["points"]
                panel.plot(
                    [
                        point["u"] / -math.log1p(-probability(*counts))
                        for point in points
                        for counts in [(point["n_inliers"], point["n"], point["sample_size"])]
                    ],
                    [point["trials"] for point in points],
                    linestyle="none",
                    marker=style["marker"],
                    color=style["color"],
                    markerfacecolor="none",
                    markersize=5,
                    label=f"{SHOWN[verdict['entry_point']]} {verdict['version']}",
                )
            panel.set(xscale="log", yscale="log", xlim=RANGE, ylim=RANGE, xlabel=label)
        axes[0].set_ylabel("trials the library ran")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        save_figure(figure, path)


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text("utf-8")), Path(sys.argv[2]))
