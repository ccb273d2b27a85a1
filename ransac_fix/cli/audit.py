"""``ransac-fix audit``: which stopping rule the installed libraries obey, measured."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ransac_fix.cli.printed import printed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import TextIO

    from ransac_fix.audit.expectations import Expectation, Surprises
    from ransac_fix.audit.model import Control, Report, Verdict
    from ransac_fix.audit.releases.matrix import MatrixOptions
    from ransac_fix.audit.releases.model import ReleaseReport

_FORMATS = ["text", "json", "markdown", "junit"]
_EXIT_UNDERSAMPLES = 1
_EXIT_UNMEASURED = 2


@click.command()
@click.argument("systems", nargs=-1, metavar="[SYSTEM]...")
@click.option(
    "--patched",
    is_flag=True,
    help="Measure each library as `ransac-fix run` leaves it, where there is a patch.",
)
@click.option(
    "--python",
    type=click.Path(exists=True, dir_okay=False),
    help="Measure the environment of this interpreter; ransac-fix need not be installed there.",
)
@click.option(
    "--quick",
    is_flag=True,
    help="One entry point of each system, and no more runs than its verdict takes.",
)
@click.option(
    "--entry-point",
    "entry_points",
    multiple=True,
    metavar="PATTERN",
    help="Only entry points that match this shell pattern, as in 'findHomography*'; repeatable.",
)
@click.option(
    "--matrix",
    multiple=True,
    metavar="RELEASES",
    help="Measure releases that are not installed, each in an environment of its own: "
    "'kornia==0.8.2,0.9.0', 'kornia>=0.8' or 'kornia' for all; repeatable.",
)
@click.option(
    "--bisect",
    multiple=True,
    metavar="RELEASES",
    help="Find the releases where a verdict changes, in 'kornia' or 'kornia>=0.7'; repeatable.",
)
@click.option(
    "--constraint",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A pip constraints file for these environments.",
)
@click.option("--pre", is_flag=True, help="Consider pre-releases, too.")
@click.option(
    "--cache-dir",
    type=click.Path(file_okay=False, path_type=Path),
    help="Where to keep results, and environments while they are needed.",
)
@click.option(
    "--keep-environments", is_flag=True, help="Leave these environments in the cache folder."
)
@click.option("--n", "n_samples", type=click.IntRange(min=2), help="Your number of measurements.")
@click.option(
    "--inlier-ratio",
    type=click.FloatRange(0, 1),
    help="Your share of inliers: with --n, guarantees are stated for it too.",
)
@click.option(
    "--confidence",
    type=click.FloatRange(0, 1),
    help="Your confidence there; the library's default if left out.",
)
@click.option(
    "--expect",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="TOML file of verdicts you know of: only what differs from it fails.",
)
@click.option(
    "--output-format",
    type=click.Choice(_FORMATS),
    default="text",
    show_default=True,
)
@click.option(
    "--output",
    multiple=True,
    metavar="FORMAT:FILE",
    help="Write one more format into a file; as often as needed.",
)
@click.option("--points", "every_point", is_flag=True, help="Print every measured point.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=1),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="Time for one entry point of one library.",
)
@click.pass_context
def command(
    ctx: click.Context,
    systems: tuple[str, ...],
    patched: bool,
    python: str | None,
    quick: bool,
    entry_points: tuple[str, ...],
    matrix: tuple[str, ...],
    bisect: tuple[str, ...],
    constraint: Path | None,
    pre: bool,
    cache_dir: Path | None,
    keep_environments: bool,
    n_samples: int | None,
    inlier_ratio: float | None,
    confidence: float | None,
    expect: Path | None,
    output_format: str,
    output: tuple[str, ...],
    every_point: bool,
    timeout: float,
) -> None:
    """Measure which stopping rule each installed library obeys.

    SYSTEM is a system, distribution or import name; none means every system that can be
    measured. Each library runs in a process of its own on small planted problems, and known
    rules are measured in the same way alongside. --matrix and --bisect measure releases from the
    package index in place of what is installed.

    Exit codes: 0 when nothing undersamples, 1 when something does, 2 when nothing could be
    measured or a known rule was not recognised.
    """
    from importlib.metadata import entry_points as installed_entry_points

    from ransac_fix.extras import need

    need("numpy", extra="audit")
    from ransac_fix.audit.expectations import compare, load_expectations
    from ransac_fix.audit.session import Options, audit

    if patched and python:
        raise click.UsageError("--patched measures this environment: leave out --python")
    if (n_samples is None) != (inlier_ratio is None):
        raise click.UsageError("--n and --inlier-ratio belong together")
    if confidence is not None and n_samples is None:
        raise click.UsageError("--confidence needs --n and --inlier-ratio")
    outputs = [("", output_format), *map(_file_and_format, output)]
    problems: tuple[tuple[int, int, float | None], ...] = ()
    if n_samples is not None and inlier_ratio is not None:
        problems = ((n_samples, round(n_samples * inlier_ratio), confidence),)
    expectations = None if expect is None else load_expectations(expect)
    options = Options(
        systems=systems,
        python=python or sys.executable,
        seconds=timeout,
        problems=problems,
        quick=quick,
        prepare="ransac_fix.patching.audited:patch_for_audit" if patched else None,
        preparable=frozenset(
            one.name for one in installed_entry_points(group="ransac_fix.patches")
        ),
        entry_points=entry_points,
    )
    if matrix or bisect:
        if matrix and bisect:
            raise click.UsageError("--matrix and --bisect are two different runs")
        if systems or patched or every_point:
            what = "SYSTEM, --patched and --points are for the installed libraries"
            raise click.UsageError(f"{what}: leave them out with --matrix and --bisect")
        if bisect and expect:
            raise click.UsageError("--bisect passes over releases: use --expect with --matrix")
        from ransac_fix.audit.releases.matrix import MatrixOptions
        from ransac_fix.folders import cache_folder

        how = MatrixOptions(
            options,
            (cache_dir or cache_folder()).resolve(),
            constraint=constraint,
            keep_environments=keep_environments,
            pre=pre,
        )
        ctx.exit(_audit_releases(matrix, bisect, how, outputs, expectations))
    if constraint or cache_dir or pre or keep_environments:
        what = "--constraint, --cache-dir, --pre and --keep-environments"
        raise click.UsageError(f"{what} belong to --matrix and --bisect")
    with _Progress() as progress:
        report = audit(options, progress.done)
    surprises = None if expectations is None else compare(report.verdicts, expectations)
    write(_verdict_writers(report, every_point, surprises), outputs)
    code = exit_code(report)
    if surprises is not None and code != _EXIT_UNMEASURED:
        code = _complain(surprises)
    ctx.exit(code)


def show(report: "Report", output_format: str, *, every_point: bool) -> None:
    """Print a report."""
    write(_verdict_writers(report, every_point, None), [("", output_format)])


def _audit_releases(
    matrix: tuple[str, ...],
    bisect: tuple[str, ...],
    how: "MatrixOptions",
    outputs: list[tuple[str, str]],
    expectations: "tuple[Expectation, ...] | None",
) -> int:
    """Measure releases, print what was found and return the exit code."""
    from ransac_fix.audit.expectations import compare
    from ransac_fix.audit.releases.matrix import find_changes, measure_releases, read_request

    requests = [read_request(text) for text in matrix or bisect]
    with _Progress() as progress:
        measure = measure_releases if matrix else find_changes
        report = measure(requests, how, progress.done)
    verdicts = [verdict for release in report.releases for verdict in release.verdicts]
    surprises = None if expectations is None else compare(verdicts, expectations)
    write(_release_writers(report, surprises), outputs)
    if how.keep_environments:
        click.echo(f"environments: {how.cache / 'environments'}", err=True)
    code = _code(verdicts, report.controls)
    if surprises is not None and code != _EXIT_UNMEASURED:
        code = _complain(surprises, versions=True)
    return code


def write(writers: "dict[str, Callable[[TextIO], None]]", outputs: list[tuple[str, str]]) -> None:
    """Write a report in several formats.

    Parameters
    ----------
    writers : dict
        By format, what writes it to a stream.
    outputs : list of (file, format)
        Where to, and what; the standard output for no file.
    """
    for file, output_format in outputs:
        if not file:
            writers[output_format](sys.stdout)
            continue
        try:
            with Path(file).open("w", encoding="utf-8") as stream:
                writers[output_format](stream)
        except OSError as error:
            raise click.UsageError(f"--output: {file}: {error.strerror or error}") from None


def _verdict_writers(
    report: "Report", every_point: bool, surprises: "Surprises | None"
) -> "dict[str, Callable[[TextIO], None]]":
    from ransac_fix.report.verdicts_json import verdicts_json
    from ransac_fix.report.verdicts_junit import verdicts_junit
    from ransac_fix.report.verdicts_markdown import verdicts_markdown
    from ransac_fix.report.verdicts_text import print_verdicts

    return {
        "text": lambda to: printed(partial(print_verdicts, report, every_point=every_point), to),
        "json": lambda to: click.echo(verdicts_json(report), to),
        "markdown": lambda to: click.echo(verdicts_markdown(report, surprises), to),
        "junit": lambda to: click.echo(verdicts_junit(report, surprises), to),
    }


def _release_writers(
    report: "ReleaseReport", surprises: "Surprises | None"
) -> "dict[str, Callable[[TextIO], None]]":
    from ransac_fix.report.releases_json import releases_json
    from ransac_fix.report.releases_junit import releases_junit
    from ransac_fix.report.releases_markdown import releases_markdown
    from ransac_fix.report.releases_text import print_releases

    return {
        "text": lambda to: printed(partial(print_releases, report), to),
        "json": lambda to: click.echo(releases_json(report), to),
        "markdown": lambda to: click.echo(releases_markdown(report, surprises), to),
        "junit": lambda to: click.echo(releases_junit(report, surprises), to),
    }


def _file_and_format(text: str) -> tuple[str, str]:
    name, _, file = text.partition(":")
    if name not in _FORMATS or not file:
        raise click.BadParameter(
            f"{text!r} is not FORMAT:FILE; the formats are {', '.join(_FORMATS)}",
            param_hint="--output",
        )
    if not Path(file).absolute().parent.is_dir():
        raise click.BadParameter(f"there is no folder for {file}", param_hint="--output")
    return file, name


def exit_code(report: "Report") -> int:
    """Return 2 where a control failed or nothing was measured, 1 where something undersamples."""
    return _code(report.verdicts, report.controls)


def _code(verdicts: "Sequence[Verdict]", controls: "Sequence[Control]") -> int:
    if not all(control.passed for control in controls):
        return _EXIT_UNMEASURED
    if all(verdict.verdict == "not measured" for verdict in verdicts):
        return _EXIT_UNMEASURED
    if any(verdict.verdict == "undersamples" for verdict in verdicts):
        return _EXIT_UNDERSAMPLES
    return 0


def _complain(surprises: "Surprises", *, versions: bool = False) -> int:
    """Name on stderr what differs from the expectations; return the exit code."""
    for one in surprises.unexpected:
        release = f" {one.verdict.version}" if versions else ""
        name = f"{one.verdict.system}{release} {one.verdict.entry_point}"
        click.echo(f"unexpected: {name}: {one.what}", err=True)
    for unmet in surprises.unmet:
        line = f"expected but not seen: {unmet.name}: {unmet.verdict}"
        click.echo(line, err=True)
    if surprises.unexpected or surprises.unmet:
        return _EXIT_UNDERSAMPLES
    click.echo("everything is as expected", err=True)
    return 0


class _Progress:
    """A line on stderr that names what is done; nothing where stderr is not a terminal."""

    def __enter__(self) -> "_Progress":
        self._shown = sys.stderr.isatty()
        self._count = 0
        if self._shown:
            print("measuring ...", end="", file=sys.stderr, flush=True)
        return self

    def done(self, name: str) -> None:
        self._count += 1
        if self._shown:
            line = f"\r\033[Kmeasured {self._count}, last {name} ..."
            print(line, end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
