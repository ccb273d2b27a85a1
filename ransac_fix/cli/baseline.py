"""``ransac-fix baseline``: the findings that a project knows of."""

from pathlib import Path

import click


@click.group()
def command() -> None:
    """Keep the findings that are known, so that `scan --baseline` reports only new ones."""


@command.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(), metavar="PATH...")
@click.option(
    "--baseline",
    default="ransac-fix-baseline.json",
    show_default=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The file to write.",
)
@click.option("--isolated", is_flag=True, help="Ignore every configuration file.")
def update(paths: tuple[str, ...], baseline: Path, isolated: bool) -> None:
    """Scan PATH and write what is found as the baseline."""
    from ransac_fix.errors import RansacFixError
    from ransac_fix.scan import scan_paths
    from ransac_fix.scan.baseline import write_baseline
    from ransac_fix.scan.configuration import Configuration, find_configuration
    from ransac_fix.scan.files import DEFAULT_EXCLUDES

    settings = Configuration() if isolated else find_configuration(paths)
    result = scan_paths(
        paths,
        jobs=-1,
        select=settings.select,
        ignore=settings.ignore,
        excludes=(*DEFAULT_EXCLUDES, *settings.extend_exclude),
        respect_gitignore=settings.respect_gitignore,
    )
    for error in result.errors:
        where = error.path if error.line is None else f"{error.path}:{error.line}"
        click.echo(f"{where}: {error.code} {error.message}", err=True)
    if any(error.named for error in result.errors):
        raise RansacFixError(f"{baseline} is not written: a named file could not be scanned")
    count = write_baseline(result.findings, baseline)
    click.echo(f"{baseline}: {count} finding{'' if count == 1 else 's'}.")
