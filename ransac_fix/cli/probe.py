"""``ransac-fix probe``: the audit's measurement of a user's own function."""

import sys

import click


@click.command()
@click.argument("target", metavar="MODULE:FUNCTION")
@click.option("--problem", required=True, help="What it estimates: line, homography, ...")
@click.option("--k", "sample_size", type=click.IntRange(1, 20), help="Size of its minimal sample.")
@click.option(
    "--trials",
    type=click.IntRange(10, 1000),
    default=40,
    show_default=True,
    help="How many trials a run may take: lower for a slow function.",
)
@click.option(
    "--output-format", type=click.Choice(["text", "json"]), default="text", show_default=True
)
@click.option("--points", "every_point", is_flag=True, help="Print every measured point.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=1),
    default=120.0,
    show_default=True,
    metavar="SECONDS",
    help="Time for the whole measurement.",
)
@click.pass_context
def command(
    ctx: click.Context,
    target: str,
    problem: str,
    sample_size: int | None,
    trials: int,
    output_format: str,
    every_point: bool,
    timeout: float,
) -> None:
    """Measure which stopping rule your own RANSAC obeys.

    MODULE:FUNCTION is found as `python -m` would find it from here. The function is called as
    function(x, y, *, threshold, max_trials, confidence, seed) and returns a boolean mask of the
    inliers, or the mask and the number of trials. `ransac_fix.testing` says more.

    Exit codes: 0 when it does not undersample, 1 when it does, 2 when it could not be measured.
    """
    from ransac_fix.extras import need

    need("numpy", extra="audit")
    from ransac_fix.audit.session import Options, audit_function
    from ransac_fix.cli.audit import exit_code, show
    from ransac_fix.errors import RansacFixError

    if ":" not in target:
        raise click.UsageError(f"{target!r} is not of the form MODULE:FUNCTION")
    arguments = [target, "--problem", problem, "--trials", str(trials)]
    if sample_size is not None:
        arguments += ["--sample-size", str(sample_size)]
    report = audit_function(arguments, Options((), sys.executable, timeout))
    (verdict,) = report.verdicts
    if verdict.entry_point == "-":
        raise RansacFixError(f"{target} could not be measured: {verdict.reason}")
    show(report, output_format, every_point=every_point)
    ctx.exit(exit_code(report))
