"""``ransac-fix audit``: which stopping rule the installed libraries obey, measured."""

import sys
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ransac_fix.audit.model import Report

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
    "--output-format", type=click.Choice(["text", "json"]), default="text", show_default=True
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
    output_format: str,
    every_point: bool,
    timeout: float,
) -> None:
    """Measure which stopping rule each installed library obeys.

    SYSTEM is a system, distribution or import name; none means every system that can be
    measured. Each library runs in a process of its own on small planted problems, and known
    rules are measured in the same way alongside.

    Exit codes: 0 when nothing undersamples, 1 when something does, 2 when nothing could be
    measured or a known rule was not recognised.
    """
    from importlib.metadata import entry_points

    from ransac_fix.audit.session import Options, audit

    options = Options(
        systems=systems,
        python=sys.executable,
        seconds=timeout,
        prepare="ransac_fix.patching:patch" if patched else None,
        preparable=frozenset(one.name for one in entry_points(group="ransac_fix.patches")),
    )
    with _Progress() as progress:
        report = audit(options, progress.done)
    if output_format == "json":
        from ransac_fix.report.verdicts_json import verdicts_json

        click.echo(verdicts_json(report))
    else:
        from rich.console import Console

        from ransac_fix.report.verdicts_text import print_verdicts

        print_verdicts(report, Console(highlight=False, markup=False), every_point=every_point)
    ctx.exit(_exit_code(report))


def _exit_code(report: "Report") -> int:
    if not all(control.passed for control in report.controls):
        return _EXIT_UNMEASURED
    if all(verdict.verdict == "not measured" for verdict in report.verdicts):
        return _EXIT_UNMEASURED
    if any(verdict.verdict == "undersamples" for verdict in report.verdicts):
        return _EXIT_UNDERSAMPLES
    return 0


class _Progress:
    """A line on stderr that names what is done; nothing where stderr is not a terminal."""

    def __enter__(self) -> "_Progress":
        self._shown = sys.stderr.isatty()
        self._names: list[str] = []
        if self._shown:
            print("measuring ...", end="", file=sys.stderr, flush=True)
        return self

    def done(self, name: str) -> None:
        self._names.append(name)
        if self._shown:
            print(
                f"\r\033[Kmeasured {', '.join(self._names)} ...",
                end="",
                file=sys.stderr,
                flush=True,
            )

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
