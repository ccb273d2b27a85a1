"""What runs that cannot be repeated returned, as text for the terminal."""

import math
from typing import TYPE_CHECKING

from ransac_fix.audit.model import OutcomeCount, OutcomeEvidence

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

OUTCOMES_LEGEND = (
    "Where a run can be neither repeated nor counted, or given no number of trials, many are made: "
    "`kept I` is how many of those that found one of two models, of I and of I+1 of n "
    "measurements, ended with the smaller. The columns on the right say how many would by P = "
    "(I/n)^k, by P = C(I,k)/C(n,k), and by the law found."
)
# Rows printed unless all are asked for.
_ROWS = 4


def outcome_summary(evidence: OutcomeEvidence) -> str:
    """Return the evidence in one line."""
    smaller, larger, neither = (
        sum(getattr(count, name) for count in evidence.counts)
        for name in ("smaller", "larger", "neither")
    )
    return (
        f"By outcomes: of {evidence.runs:,} runs {larger:,} returned the larger of two models, "
        f"{smaller:,} the smaller, {neither:,} neither; error rate {evidence.error_rate:g} for "
        "each law rejected."
    )


def outcome_lines(evidence: OutcomeEvidence, *, every_point: bool = False) -> "list[Text | Table]":
    """Return a table of the outcomes and a line on the likelihood ratios.

    Parameters
    ----------
    evidence : OutcomeEvidence
        What was seen.
    every_point : bool, default False
        Show all of it, not the largest numbers only.
    """
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("n", "I", "s", "runs", "kept I", "if (I/n)^k", "if exact", "by the law"):
        table.add_column(title, justify="right", no_wrap=True)
    for cells in outcome_cells(evidence, every_point=every_point):
        table.add_row(*cells)
    lines: list[Text | Table] = [table, Text(_ratios(evidence))]
    if evidence.factor is not None:
        likeliest, low, high = evidence.factor
        lines.append(
            Text(
                f"trials relative to this law: {likeliest:g}, with 99 % confidence {low:g} to "
                f"{high:g}; rounding and a trial or two more or less do not show"
            )
        )
    return lines


def outcome_cells(evidence: OutcomeEvidence, *, every_point: bool = False) -> list[tuple[str, ...]]:
    """Return the rows of that table.

    Parameters
    ----------
    evidence, every_point
        As in `outcome_lines`.
    """
    counts = [count for count in evidence.counts if count.confidence is not None]
    if not every_point:
        counts = sorted(counts, key=lambda count: -(count.smaller + count.larger))[:_ROWS]
    return [_cells(count) for count in counts]


def _cells(count: OutcomeCount) -> tuple[str, ...]:
    known = count.smaller + count.larger
    return (
        str(count.n),
        str(count.n_inliers),
        f"{count.confidence:.4g}",
        str(known),
        f"{count.smaller / known:.0%}" if known else "-",
        *(
            "-" if share is None else f"{share:.0%}"
            for share in (count.approximate, count.exact, count.expected)
        ),
    )


def _ratios(evidence: OutcomeEvidence) -> str:
    decided = -math.log(evidence.error_rate)
    text = f"{evidence.runs:,} runs; "
    if evidence.no_law > decided:
        return text + (
            f"no law at all is e^{evidence.no_law:.1f} times as likely as the likeliest, "
            f"{evidence.likeliest} (error rate {evidence.error_rate:g})"
        )
    against = ", ".join(f"e^{ratio.log_ratio:.1f} {ratio.law}" for ratio in evidence.ratios)
    return text + (
        f"{evidence.likeliest} is likelier than others by at least {against} "
        f"(e^{decided:.1f} decides, error rate {evidence.error_rate:g} each)"
    )
