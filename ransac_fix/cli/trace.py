"""``ransac-fix trace``: a Python program, and a report of its RANSAC calls."""

import os
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import click

_SAMPLE = 100


@click.command(
    "trace",
    context_settings={"allow_interspersed_args": False},
    short_help="Run a Python program and report its RANSAC calls.",
)
@click.option("-m", "as_module", is_flag=True, help="TARGET is a module, as for `python -m`.")
@click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write the report to this file as JSON, in place of the terminal.",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Make calls that stopped short again with the exact rule once the program has ended, and"
    " say how many models were really missed.",
)
@click.option(
    "--sample",
    type=click.IntRange(min=1),
    help=f"With --verify: how many calls.  [default: {_SAMPLE}]",
)
@click.argument("target")
@click.argument("args", nargs=-1, type=click.UNPROCESSED)
@click.pass_context
def command(
    ctx: click.Context,
    as_module: bool,
    json_file: Path | None,
    verify: bool,
    sample: int | None,
    target: str,
    args: tuple[str, ...],
) -> None:
    """Run a Python script (or, with -m, a module) and report every RANSAC call it makes.

    For each call in a supported library, in threads and worker processes too: how many trials it
    ran, what ended it, and the guarantee that this really gives. The program is not changed; the
    report follows on stderr, and the exit code is the program's. ARGS go to it untouched.
    """
    import tempfile
    from functools import partial

    from ransac_fix.cli.run import command_line
    from ransac_fix.errors import RansacFixError
    from ransac_fix.patching import startup, tracing
    from ransac_fix.patching.recorder import Recorder
    from ransac_fix.patching.samples import request

    line = command_line(target, args, as_module=as_module)
    if startup.off():
        raise click.UsageError("RANSAC_FIX=0 is set: nothing can be traced")
    if sample is not None and not verify:
        raise click.UsageError("--sample says how many calls --verify makes again: add --verify")
    n_again = (sample or _SAMPLE) if verify else 0
    if json_file is not None and not json_file.absolute().parent.is_dir():
        raise click.UsageError(f"there is no folder {json_file.absolute().parent} for the report")
    folder = tempfile.mkdtemp(prefix="ransac_fix_trace_")
    if n_again:
        request(folder, n_again)
    environ = dict(os.environ)
    tracing.environment(environ, folder)
    start = perf_counter()
    with subprocess.Popen(line, env=environ) as program:  # noqa: S603 -- running it is the purpose
        code = _wait(program)
    report = tracing.collect(Recorder(folder, write=False), perf_counter() - start, verify=n_again)
    if json_file is not None:
        from ransac_fix.report.trace_json import trace_json

        try:
            json_file.write_text(trace_json(report) + "\n", encoding="utf-8")
        except OSError as error:
            raise RansacFixError(f"{json_file} cannot be written: {error.strerror}") from error
    else:
        from ransac_fix.cli.printed import printed
        from ransac_fix.report.trace_text import print_trace

        sys.stdout.flush()
        printed(partial(print_trace, report), sys.stderr)
    ctx.exit(code)


def _wait(program: "subprocess.Popen[bytes]") -> int:
    """Return a program's exit code. An interrupt is the program's affair: it got it too."""
    while True:
        try:
            code = program.wait()
        except KeyboardInterrupt:
            continue
        return 128 - code if code < 0 else code
