"""``ransac-fix explain``: what the error does to the user's own numbers."""

from decimal import Decimal, InvalidOperation
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ransac_fix.criterion import Stratum
    from ransac_fix.experiments.explanation import Explanation, Problem

# Beyond these the counts of subsets have thousands of digits and no meaning.
_MOST_MEASUREMENTS = 10**12
_LARGEST_SAMPLE = 100
_MOST_TRIALS = 10**18
_LONGEST_SWEEP = 1000
_MOST_DECIMALS = 300


def _probability(text: str) -> Fraction:
    """Read a decimal from 0 to 1, taken for exactly what it says."""
    number = _decimal(text)
    if number is None or not 0 <= number <= 1:
        raise click.BadParameter(f"{text} is not a number from 0 to 1")
    return number


def _stratum(text: str) -> "Stratum":
    """Read one stratum, written INLIERS/MEASUREMENTS:DRAWN."""
    from ransac_fix.criterion import Stratum

    try:
        counts, drawn = text.split(":")
        inliers, measurements = counts.split("/")
        stratum = Stratum(int(inliers), int(measurements), int(drawn))
    except ValueError:
        raise click.BadParameter(f"{text} is not of the form INLIERS/MEASUREMENTS:DRAWN") from None
    possible = (
        0 <= stratum.n_inliers <= stratum.n_samples <= _MOST_MEASUREMENTS
        and 0 <= stratum.sample_size <= min(stratum.n_samples, _LARGEST_SAMPLE)
    )
    if not possible:
        raise click.BadParameter(f"{text} is impossible: it needs I <= n and k <= n")
    return stratum


@click.command()
@click.option("--n", "n_samples", type=click.IntRange(1, _MOST_MEASUREMENTS), help="Measurements.")
@click.option("--inliers", type=click.IntRange(0, _MOST_MEASUREMENTS), help="Inliers among them.")
@click.option(
    "--inlier-ratio",
    type=_probability,
    metavar="DECIMAL",
    help="Inliers by their ratio p; p n must be within 0.05 of a whole number.",
)
@click.option(
    "--k", "sample_size", type=click.IntRange(1, _LARGEST_SAMPLE), help="Size of a minimal sample."
)
@click.option(
    "--confidence",
    type=_probability,
    metavar="DECIMAL",
    default="0.99",
    show_default=True,
    help="Wanted probability s of an all-inlier sample.",
)
@click.option(
    "--stratum",
    "strata",
    type=_stratum,
    multiple=True,
    metavar="I/n:k",
    help="In place of --n, --inliers and --k: a sampler that draws k of the n measurements of "
    "this stratum, I of them inliers. Once for each stratum.",
)
@click.option(
    "--min-trials",
    type=click.IntRange(0, _MOST_TRIALS),
    default=0,
    help="A floor on the trials, whatever the rule says.",
)
@click.option(
    "--max-trials",
    type=click.IntRange(0, _MOST_TRIALS),
    help="A cap on the trials, whatever the rule says. It wins over the floor.",
)
@click.option(
    "--sweep",
    metavar="n|p[=VALUES]",
    help="Also a table over n (at the same ratio) or p (at the same n). "
    "VALUES: 20,50,100 or FROM:TO:STEP; chosen for you if left out.",
)
@click.option(
    "--sampling",
    type=click.Choice(["distinct", "replacement"]),
    default="distinct",
    show_default=True,
    help="How samples are drawn in the table of --sweep and in the plot.",
)
@click.option(
    "--plot",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw the sweep (over n unless --sweep says p) to a .svg, .pdf or .png file.",
)
@click.option(
    "--output-format", type=click.Choice(["text", "json"]), default="text", show_default=True
)
def command(
    n_samples: int | None,
    inliers: int | None,
    inlier_ratio: Fraction | None,
    sample_size: int | None,
    confidence: Fraction,
    strata: "tuple[Stratum, ...]",
    min_trials: int,
    max_trials: int | None,
    sweep: str | None,
    sampling: str,
    plot: Path | None,
    output_format: str,
) -> None:
    """Show what both stopping rules do on your own numbers.

    \b
    ransac-fix explain --n 50 --inlier-ratio 0.3 --k 5 --confidence 0.99
    """  # noqa: D301 -- click reads the backspace
    from ransac_fix.experiments.explanation import Problem, explain
    from ransac_fix.report.drawing import check_drawable

    counts = _counts(n_samples, inliers, inlier_ratio, sample_size, strata)
    problem = Problem(*counts, confidence, strata, min_trials, max_trials)
    over, values = _parse_sweep(sweep or "n")
    if (sweep is not None or plot is not None) and problem.n_inliers == 0:
        raise click.UsageError("--sweep and --plot need at least one inlier")
    if plot is not None:
        check_drawable(plot)
    explanation = explain(problem)
    rows = _swept(problem, over, values) if sweep is not None or plot is not None else None
    if output_format == "json":
        from ransac_fix.report.explanation_json import explanation_json

        click.echo(explanation_json(explanation, rows if sweep is not None else None))
    else:
        from ransac_fix.report.explanation_text import explanation_text, sweep_text

        click.echo(explanation_text(explanation))
        if sweep is not None and rows is not None:
            click.echo("\n" + sweep_text(rows, sampling))
    if strata and rows is not None:
        click.echo("ransac-fix: strata do not scale: the sweep is without them", err=True)
    if plot is not None and rows is not None:
        from ransac_fix.report.explanation_plot import draw_sweep

        draw_sweep(explanation, rows, over, sampling, plot)
        click.echo(f"written: {plot}", err=True)


def _counts(
    n_samples: int | None,
    inliers: int | None,
    inlier_ratio: Fraction | None,
    sample_size: int | None,
    strata: "tuple[Stratum, ...]",
) -> tuple[int, int, int]:
    """Return n, I and k from the options, or say which is missing or contradictory."""
    if strata:
        if any(v is not None for v in (n_samples, inliers, inlier_ratio, sample_size)):
            raise click.UsageError(
                "--stratum replaces --n, --inliers, --inlier-ratio and --k: give one or the other"
            )
        n_samples = sum(s.n_samples for s in strata)
        inliers = sum(s.n_inliers for s in strata)
        sample_size = sum(s.sample_size for s in strata)
        if not 1 <= sample_size <= _LARGEST_SAMPLE:
            raise click.UsageError(f"the strata must draw 1 to {_LARGEST_SAMPLE} measurements")
        return n_samples, inliers, sample_size
    if n_samples is None or sample_size is None:
        raise click.UsageError("give --n and --k (or a --stratum for each stratum)")
    if (inliers is None) == (inlier_ratio is None):
        raise click.UsageError("give either --inliers or --inlier-ratio")
    if inlier_ratio is not None:
        inliers = _inliers(inlier_ratio, n_samples)
    assert inliers is not None
    if inliers > n_samples:
        raise click.UsageError(f"--inliers {inliers} is more than --n {n_samples}")
    if sample_size > n_samples:
        raise click.UsageError(f"--k {sample_size} is more than --n {n_samples}")
    return n_samples, inliers, sample_size


def _inliers(ratio: Fraction, n_samples: int) -> int:
    from ransac_fix.experiments.explanation import inliers_from_ratio

    try:
        return inliers_from_ratio(ratio, n_samples)
    except ValueError as error:
        below = int(ratio * n_samples)
        raise click.UsageError(f"{error}: say --inliers {below} or {below + 1}") from None


def _swept_inliers(ratio: Fraction, n_samples: int) -> int:
    from ransac_fix.experiments.explanation import inliers_from_ratio

    try:
        return inliers_from_ratio(ratio, n_samples)
    except ValueError as error:
        raise click.UsageError(f"--sweep: {error}; FROM:TO:STEP leaves such values out") from None


def _parse_sweep(text: str) -> tuple[str, list[Fraction] | tuple[Fraction, ...] | None]:
    """Return what is swept, and its values: a tuple where each was named, a list for a range."""
    over, _, values = text.partition("=")
    if over not in ("n", "p"):
        raise click.UsageError(f"--sweep {text}: sweep over n or p, as in n, p=0.2:0.8:0.1")
    if "=" not in text:
        return over, None
    pieces = values.split(":") if ":" in values else values.split(",")
    numbers = [_decimal(piece) for piece in pieces]
    wrong = [piece for piece, number in zip(pieces, numbers, strict=True) if number is None]
    if wrong or (":" in values and len(pieces) != 3):
        raise click.UsageError(f"--sweep {text}: VALUES are 20,50,100 or FROM:TO:STEP")
    known = tuple(number for number in numbers if number is not None)
    if ":" not in values:
        if len(known) > _LONGEST_SWEEP:
            raise click.UsageError(f"--sweep: at most {_LONGEST_SWEEP} rows")
        return over, known
    first, last, step = known
    if step <= 0 or last < first:
        raise click.UsageError(f"--sweep {text}: STEP must be above 0 and TO not below FROM")
    n_rows = (last - first) // step + 1
    if n_rows > _LONGEST_SWEEP:
        raise click.UsageError(f"--sweep {text}: {n_rows} rows, at most {_LONGEST_SWEEP}")
    return over, [first + i * step for i in range(n_rows)]


def _swept(
    problem: "Problem", over: str, values: list[Fraction] | tuple[Fraction, ...] | None
) -> "list[Explanation]":
    from ransac_fix.experiments.explanation import sweep_inliers, sweep_measurements

    if over == "p":
        if values is None:
            return sweep_inliers(problem)
        if not all(0 <= p <= 1 for p in values):
            raise click.UsageError("--sweep p: every ratio is from 0 to 1")
        chosen = _whole(values, lambda p: _swept_inliers(p, problem.n_samples), "p")
        return sweep_inliers(problem, chosen)
    if values is None:
        return sweep_measurements(problem)
    smallest = problem.sample_size
    if not all(n.denominator == 1 and smallest <= n <= _MOST_MEASUREMENTS for n in values):
        raise click.UsageError(
            f"--sweep n: every n is a whole number from k = {smallest} to {_MOST_MEASUREMENTS:.0e}"
        )
    ratio = Fraction(problem.n_inliers, problem.n_samples)

    def checked(n: Fraction) -> int:
        _swept_inliers(ratio, int(n))
        return int(n)

    return sweep_measurements(problem, _whole(values, checked, "n"))


def _whole(values: list[Fraction] | tuple[Fraction, ...], convert: object, name: str) -> list[int]:
    """Convert each value; one that has no whole number of inliers is an error if it was named.

    Values that only a range brought in are left out, and said to be.
    """
    assert callable(convert)
    chosen, left_out = [], []
    for value in values:
        try:
            chosen.append(convert(value))
        except click.UsageError:
            if isinstance(values, tuple):
                raise
            left_out.append(f"{float(value):g}")
    if left_out:
        said = f"left out, p n is not whole: {name} = {', '.join(left_out)}"
        if not chosen:
            raise click.UsageError(f"--sweep: {said}")
        click.echo(f"ransac-fix: {said}", err=True)
    return chosen


def _decimal(text: str) -> Fraction | None:
    """Return a decimal as the exact fraction it stands for, None if it is not one."""
    try:
        number = Decimal(text)
    except InvalidOperation:
        return None
    # An absurd exponent would be expanded to that many digits.
    if not number.is_finite() or abs(number.adjusted()) > _MOST_DECIMALS:
        return None
    if len(number.as_tuple().digits) > _MOST_DECIMALS:
        return None
    return Fraction(number)
