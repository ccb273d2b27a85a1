"""``ransac-fix scan``: find stopping rules in source code."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ransac_fix.scan import Finding, FixStyle, ScanError, ScanResult
    from ransac_fix.scan.fixing import FixedFile

_FORMATS = (
    *("full", "concise", "json", "json-lines", "junit", "github", "gitlab", "sarif", "markdown"),
    "html",
)
_EXIT_FINDINGS = 1
_EXIT_ERROR = 2


@click.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(), metavar="PATH...")
@click.option(
    "--output-format",
    type=click.Choice(_FORMATS),
    default="full",
    show_default=True,
)
@click.option(
    "--output",
    multiple=True,
    metavar="FORMAT:FILE",
    help="Write one more format into a file; as often as needed.",
)
@click.option("--select", multiple=True, metavar="CODE", help="Check only these rules (RFX00).")
@click.option("--ignore", multiple=True, metavar="CODE", help="Leave these rules out.")
@click.option(
    "--exclude", multiple=True, metavar="PATTERN", help="Leave out what matches, as .gitignore."
)
@click.option(
    "--respect-gitignore/--no-respect-gitignore",
    default=None,
    help="Whether .gitignore files hold below a named folder (they do).",
)
@click.option("--isolated", is_flag=True, help="Ignore every configuration file.")
@click.option(
    "--jobs",
    type=int,
    default=-1,
    metavar="N",
    help="Worker processes; by default one for each core.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Scan on the workers of this dask scheduler, which need no access to the files.",
)
@click.option(
    "--baseline",
    type=click.Path(),
    metavar="FILE",
    help="Report only what this file does not know of (`ransac-fix baseline update` writes it).",
)
@click.option("--fix", is_flag=True, help="Write the safe fixes into the files.")
@click.option("--exit-non-zero-on-fix", is_flag=True, help="Exit with 1 when --fix changed a file.")
@click.option("--diff", is_flag=True, help="Show what --fix would write, and write nothing.")
@click.option("--unsafe-fixes", is_flag=True, help="Let --fix and --diff take unsafe fixes too.")
@click.option(
    "--python",
    metavar="EXE",
    help="The interpreter whose packages RFX101 asks about; this one by default.",
)
@click.option(
    "--fix-style",
    type=click.Choice(("self-contained", "import")),
    default=None,
    help="Whether a fix adds a function to the file (the default), or imports ransac_fix.",
)
@click.option(
    "--stdin-filename",
    metavar="NAME",
    help="The file that standard input stands for, where PATH is `-`.",
)
@click.option("--no-cache", is_flag=True, help="Remember nothing of what held nothing.")
@click.option("--exit-zero", is_flag=True, help="Exit with 0 when something is found.")
@click.pass_context
def command(
    ctx: click.Context,
    paths: tuple[str, ...],
    output_format: str,
    output: tuple[str, ...],
    select: tuple[str, ...],
    ignore: tuple[str, ...],
    exclude: tuple[str, ...],
    respect_gitignore: bool | None,
    isolated: bool,
    jobs: int,
    dask: str | None,
    baseline: str | None,
    fix: bool,
    exit_non_zero_on_fix: bool,
    diff: bool,
    unsafe_fixes: bool,
    python: str | None,
    fix_style: "FixStyle | None",
    stdin_filename: str | None,
    no_cache: bool,
    exit_zero: bool,
) -> None:
    """Find stopping rules with the approximate probability in source code.

    PATH is a file in Python, C, C++ or CUDA, a notebook, or a folder. A file is always scanned;
    below a folder, .gitignore files and the usual excludes hold. Nothing that is scanned is
    imported or run. `-` is standard input; --fix writes it to standard output, fixed.

    A safe fix changes the number of trials and nothing else; --unsafe-fixes takes those too that
    change what is drawn, or that rest on names alone for what is a count.

    Exit codes: 0 when nothing was found (or all of it was fixed), 1 when something was, 2 when a
    named file could not be read or the arguments are wrong. Notes (RFX007) alone give 0, unless
    --select names them.
    """
    import shutil
    from dataclasses import replace
    from pathlib import Path

    from ransac_fix.cli.progress import progress_bar
    from ransac_fix.errors import RansacFixError
    from ransac_fix.scan import ScanResult, scan_paths, scan_text
    from ransac_fix.scan.baseline import compare
    from ransac_fix.scan.cache import default_cache
    from ransac_fix.scan.configuration import Configuration, find_configuration
    from ransac_fix.scan.files import DEFAULT_EXCLUDES

    if jobs == 0:
        raise click.UsageError("--jobs 0: give the number of workers, or -1 for one a core")
    files = [_format_and_file(one) for one in output]
    settings = Configuration() if isolated else find_configuration(paths)
    fix_style = fix_style or settings.fix_style
    selected, ignored = _codes(select) or settings.select, _codes(ignore) or settings.ignore
    if python is not None and shutil.which(python) is None:
        raise click.BadParameter(f"there is no program {python!r}", param_hint="--python")
    contents: dict[str, bytes] = {}
    changed = False
    if "-" in paths:
        if paths != ("-",):
            raise click.UsageError("`-`, standard input, cannot be scanned beside files")
        contents[stdin_filename or "<stdin>"] = sys.stdin.buffer.read()
    if respect_gitignore is None:
        respect_gitignore = settings.respect_gitignore

    def look() -> ScanResult:
        if contents:
            ((name, data),) = contents.items()
            return scan_text(
                data, name, select=selected, ignore=ignored, fix_style=fix_style, python=python
            )
        with progress_bar("scanning") as progress:
            return scan_paths(
                paths,
                jobs=jobs,
                dask_scheduler=dask,
                cache=None if no_cache else default_cache(),
                excludes=(*DEFAULT_EXCLUDES, *settings.extend_exclude, *exclude),
                respect_gitignore=respect_gitignore,
                select=selected,
                ignore=ignored,
                fix_style=fix_style,
                python=python,
                progress=progress,
            )

    result = look()
    if baseline is not None:
        compared = compare(result, Path(baseline), paths)
        result = compared.result
        click.echo(_compared(compared.known, len(compared.gone)), err=True)
    if fix or diff:
        from ransac_fix.scan.fixing import fix_findings

        fixed, errors = fix_findings(result.findings, unsafe=unsafe_fixes, contents=contents)
        if diff:
            result = replace(result, errors=(*result.errors, *errors))
        else:
            written, unwritten = _write(fixed, contents)
            if written:
                # What is left stands elsewhere now.
                changed = True
                if contents:
                    contents = {one.path: one.encoded() for one in written}
                result = look()
                if baseline is not None:
                    result = compare(result, Path(baseline), paths).result
            _report_unsafe(result.findings, unsafe_fixes)
            result = replace(result, errors=(*result.errors, *errors, *unwritten))
    writers = _writers()
    for name, file in files:
        try:
            Path(file).write_text(writers[name](result), encoding="utf-8")
        except OSError as error:
            raise RansacFixError(f"cannot write {file}: {error.strerror or error}") from None
    if diff:
        click.echo("".join(one.diff() for one in fixed), nl=False)
        _report_errors(result.errors)
        _report_unsafe(result.findings, unsafe_fixes)
        without = sum(one.fix is None for one in result.findings)
        if without:
            click.echo(f"{without} without a fix: leave out --diff to see them.", err=True)
    else:
        # Standard output holds the fixed source where there is one.
        click.echo(writers[output_format](result), nl=False, err=bool(contents) and fix)
    if any(error.named for error in result.errors):
        ctx.exit(_EXIT_ERROR)
    found = bool(fixed) if diff else bool(result.warnings)
    if (found and not exit_zero) or (changed and exit_non_zero_on_fix):
        ctx.exit(_EXIT_FINDINGS)


def _write(
    fixed: "list[FixedFile]", contents: dict[str, bytes]
) -> "tuple[list[FixedFile], list[ScanError]]":
    """Write the fixed files; give those that were, and what could not be written."""
    from ransac_fix.scan import ScanError

    written: list[FixedFile] = []
    errors: list[ScanError] = []
    for one in fixed:
        if one.path not in contents:
            try:
                one.write()
            except OSError as error:
                message = f"cannot be written: {error.strerror or error}"
                errors.append(ScanError(one.path, message, named=True))
                continue
        written.append(one)
    for name, data in contents.items():
        own = next((one for one in fixed if one.path == name), None)
        sys.stdout.buffer.write(data if own is None else own.encoded())
        sys.stdout.buffer.flush()
    done, files = sum(len(one.fixed) for one in written), len(written)
    findings = f"{done} finding{'' if done == 1 else 's'}"
    click.echo(f"Fixed {findings} in {files} file{'' if files == 1 else 's'}.", err=True)
    return written, errors


def _report_unsafe(findings: "Sequence[Finding]", taken: bool) -> None:
    count = sum(one.fix is not None and not one.fix.safe for one in findings)
    if count and not taken:
        click.echo(f"--unsafe-fixes would fix {count} more.", err=True)


def _report_errors(errors: "Sequence[ScanError]") -> None:
    for error in errors:
        click.echo(f"{error.path}: {error.code} {error.message}", err=True)


def _codes(values: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(code.strip() for value in values for code in value.split(","))


def _compared(known: int, gone: int) -> str:
    text = f"{known} finding{'' if known == 1 else 's'} known to the baseline"
    if gone:
        text += f", {gone} more in it gone since: `ransac-fix baseline update` takes these out"
    return f"{text}."


def _format_and_file(text: str) -> tuple[str, str]:
    name, _, file = text.partition(":")
    if name not in _FORMATS or not file:
        raise click.BadParameter(
            f"{text!r} is not FORMAT:FILE; the formats are {', '.join(_FORMATS)}",
            param_hint="--output",
        )
    return name, file


def _writers() -> "dict[str, Callable[[ScanResult], str]]":
    # One module a format, and what it imports, only when it is written.
    def writer(module: str, name: str) -> "Callable[[ScanResult], str]":
        def write(result: "ScanResult") -> str:
            function = getattr(import_module(f"ransac_fix.report.{module}"), name)
            text = function(result)
            assert isinstance(text, str)
            return text

        return write

    return {
        "full": writer("findings_text", "findings_full"),
        "concise": writer("findings_text", "findings_concise"),
        "json": writer("findings_json", "findings_json"),
        "json-lines": writer("findings_json", "findings_json_lines"),
        "junit": writer("findings_junit", "findings_junit"),
        "github": writer("findings_github", "findings_github"),
        "gitlab": writer("findings_gitlab", "findings_gitlab"),
        "sarif": writer("findings_sarif", "findings_sarif"),
        "markdown": writer("findings_markdown", "findings_markdown"),
        "html": writer("findings_html", "findings_html"),
    }
