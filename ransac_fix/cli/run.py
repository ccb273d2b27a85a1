"""``ransac-fix run``: a Python program with its libraries patched."""

import os
import subprocess
import sys
from pathlib import Path

import click

# What would keep the started interpreter from reading PYTHONPATH or sitecustomize.
_SHUT_OUT = {"-I", "-E", "-S"}


@click.command(
    "run",
    context_settings={"allow_interspersed_args": False},
    short_help="Run a Python program with its libraries patched.",
)
@click.option("-m", "as_module", is_flag=True, help="TARGET is a module, as for `python -m`.")
@click.argument("target")
@click.argument("args", nargs=-1, type=click.UNPROCESSED)
def command(as_module: bool, target: str, args: tuple[str, ...]) -> None:
    """Run a Python script (or, with -m, a module) with every supported library made exact.

    ARGS go to the program untouched, and its exit code is returned. Libraries are patched when
    the program imports them, in its worker processes too. RANSAC_FIX=0 in the environment
    switches the patches off.
    """
    from ransac_fix.patching import engine, startup

    line = command_line(target, args, as_module=as_module)
    environ = dict(os.environ)
    startup.environment(environ, engine.installable())
    sys.stdout.flush()
    sys.stderr.flush()
    if os.name == "posix":
        # In place of this process: signals, terminal and exit code are the program's own.
        os.execve(sys.executable, line, environ)  # noqa: S606 -- running it is the purpose
    sys.exit(subprocess.run(line, env=environ, check=False).returncode)  # noqa: S603


def command_line(target: str, args: tuple[str, ...], *, as_module: bool) -> list[str]:
    """Return the line that runs a program in an interpreter that reads its environment.

    Raises
    ------
    click.UsageError
        If there is no such file.
    """
    if not as_module and not Path(target).exists():
        raise click.UsageError(f"there is no file {target!r} to run")
    flags = [
        flag
        for flag in subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]  # noqa: SLF001 -- what multiprocessing uses
        if flag not in _SHUT_OUT
    ]
    return [sys.executable, *flags, *(["-m"] if as_module else []), target, *args]
