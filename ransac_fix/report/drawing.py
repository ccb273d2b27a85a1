"""What every figure shares: one look, readable in grey, and files that do not change by chance."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ransac_fix.errors import RansacFixError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".svg", ".pdf", ".png")

# Told apart by dashes, markers and darkness as well as by colour (Okabe and Ito's palette,
# ordered so that neighbours differ in grey too).
LINE_STYLES: tuple[dict[str, Any], ...] = (
    {"color": "#000000", "linestyle": "-", "marker": "o"},
    {"color": "#d55e00", "linestyle": "--", "marker": "s"},
    {"color": "#0072b2", "linestyle": "-.", "marker": "^"},
    {"color": "#009e73", "linestyle": ":", "marker": "D"},
    {"color": "#cc79a7", "linestyle": (0, (5, 1, 1, 1, 1, 1)), "marker": "v"},
    {"color": "#56b4e9", "linestyle": (0, (8, 2)), "marker": "P"},
)

_SETTINGS: dict[Any, Any] = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#cccccc",
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "svg.fonttype": "path",
    "svg.hashsalt": "ransac-fix",
    "pdf.fonttype": 42,
}


def check_drawable(path: Path) -> None:
    """Raise a RansacFixError now if a figure could not be written to `path` later."""
    if path.suffix.lower() not in SUFFIXES:
        raise RansacFixError(f"{path}: a figure is written as {', '.join(SUFFIXES)}")
    if not path.absolute().parent.is_dir():
        raise RansacFixError(f"{path}: its folder does not exist")
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise RansacFixError("drawing needs matplotlib: pip install 'ransac-fix[plot]'") from None


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure as its file name says, with nothing in it that changes between runs.

    Raises
    ------
    RansacFixError
        When the file cannot be written.
    """
    import matplotlib as mpl

    metadata: dict[str, dict[str, None]] = {
        ".svg": {"Date": None},
        ".pdf": {"CreationDate": None},
        ".png": {},
    }
    try:
        with mpl.rc_context(_SETTINGS):
            figure.savefig(path, dpi=200, metadata=metadata[path.suffix.lower()])
    except OSError as error:
        raise RansacFixError(f"{path}: cannot be written: {error.strerror}") from None


def figure_settings() -> dict[Any, Any]:
    """Return the matplotlib settings that every figure is built under."""
    return dict(_SETTINGS)
