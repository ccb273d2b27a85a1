"""Plain tables and numbers for the terminal."""

import io
from collections.abc import Sequence

# Up to this many digits a count is written out.
_WRITTEN_OUT = 10**15


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Return a table with aligned columns and no frame.

    Parameters
    ----------
    header : sequence of str
        One title a column; a title may hold line breaks.
    rows : sequence of sequences of str
        The cells.
    left : int, default 1
        How many of the first columns are aligned to the left; the others are to the right.
    """
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for i, title in enumerate(header):
        side = "left" if i < left else "right"
        table.add_column(title, justify=side, no_wrap=True, vertical="bottom")  # type: ignore[arg-type]
    for row in rows:
        table.add_row(*row)
    # Never narrower than the table: a cut number would be a wrong number.
    console = Console(file=io.StringIO(), width=1000, no_color=True, highlight=False, markup=False)
    with console.capture() as capture:
        console.print(table)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())


def count_text(value: int | None) -> str:
    """Return a count with thousands separators; None is shown as never."""
    if value is None:
        return "never"
    if value < _WRITTEN_OUT:
        return f"{value:,}"
    digits = str(value)
    return f"{digits[0]}.{digits[1:4]}e{len(digits) - 1}"


def percent_text(value: float | None, *, signed: bool = False) -> str:
    """Return a ratio as a percentage with one digit, or three significant ones below 10 %."""
    if value is None:
        return "infinite"
    percent = 100 * value
    sign = "+" if signed else ""
    if abs(percent) >= 1e6:
        return f"{percent:{sign}.3g} %"
    return f"{percent:{sign},.1f} %" if abs(percent) >= 10 else f"{percent:{sign}.3g} %"


def probability_text(value: float) -> str:
    """Return a probability so that neither very small nor near-certain ones are rounded away."""
    if value in (0.0, 1.0):
        return f"{value:g}"
    if value > 0.999:
        miss = 1 - value
        return f"1 - {miss:.2g}" if miss < 1e-6 else f"{value:.6f}"
    return f"{value:.4g}" if value < 0.1 else f"{value:.4f}"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Return the same table as Markdown.

    Parameters
    ----------
    header, rows, left
        As in `text_table`, but a title may not hold line breaks.
    """
    rule = ["---" if i < left else "---:" for i in range(len(header))]
    lines = [header, rule, *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
