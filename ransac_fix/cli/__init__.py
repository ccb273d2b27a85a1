"""The ``ransac-fix`` command: one module a command, each imported only when it is called."""

import errno
import sys
import traceback
from importlib import import_module

import click

from ransac_fix._version import __version__
from ransac_fix.errors import RansacFixError

# name -> (module under ransac_fix.cli holding `command`, the line `--help` shows). The line
# stands here so that `ransac-fix --help` imports no command.
_COMMANDS: dict[str, tuple[str, str]] = {
    "audit": ("audit", "Measure which stopping rule the installed libraries obey."),
    "probe": ("probe", "Measure which stopping rule your own RANSAC obeys."),
    "explain": ("explain", "What both stopping rules do on your own numbers."),
    "scan": ("scan", "Find stopping rules in source code."),
    "baseline": ("baseline", "Keep the findings that are known, for `scan --baseline`."),
    "rule": ("rule", "What a rule of the scan finds, why, and what to write instead."),
    "rules": ("rules", "List the rules of the scan."),
    "run": ("run", "Run a Python program with its libraries patched."),
    "trace": ("trace", "Run a Python program and report its RANSAC calls."),
    "site": ("site", "Patch every program of this environment."),
    "reproduce": ("reproduce", "Compute the paper's figures and tables again."),
}

EXIT_ERROR = 2
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT} if hasattr(errno, "EDQUOT") else {errno.ENOSPC}


class _LazyGroup(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in _COMMANDS:
            return None
        command = import_module(f"{__name__}.{_COMMANDS[cmd_name][0]}").command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in _COMMANDS.items()])


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="ransac-fix")
def cli() -> None:
    """Find, measure and fix the wrong stopping criterion in RANSAC code."""


def main(args: list[str] | None = None) -> None:
    """Run the command line and exit: 0 clean, 1 findings, 2 errors."""
    try:
        sys.exit(cli.main(args, prog_name="ransac-fix", standalone_mode=False))
    except click.ClickException as error:
        error.show()
        sys.exit(EXIT_ERROR)
    except click.Abort:
        print("ransac-fix: interrupted", file=sys.stderr)
        sys.exit(130)
    except RansacFixError as error:
        print(f"ransac-fix: error: {error}", file=sys.stderr)
        sys.exit(EXIT_ERROR)
    except Exception as error:  # noqa: BLE001 -- the last resort: a defect must not look like "findings"
        if isinstance(error, OSError) and error.errno in _NO_ROOM:
            print(f"ransac-fix: error: cannot write: {error.strerror}", file=sys.stderr)
            sys.exit(EXIT_ERROR)
        traceback.print_exc()
        print("ransac-fix: internal error, please report it with the lines above", file=sys.stderr)
        sys.exit(EXIT_ERROR)
