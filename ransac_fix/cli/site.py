"""``ransac-fix site``: patch every program of the current environment."""

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ransac_fix.patching.site import SiteStatus


@click.group(short_help="Patch every program of this environment.")
def command() -> None:
    """Patch every Python program of the current environment, worker processes included.

    `enable` writes one small .pth file among the environment's packages, `disable` removes it.
    Libraries are patched when they are imported; other programs start as before. RANSAC_FIX=0
    in the environment switches the patches off; `python -I` and `python -S` never read them.
    """


@command.command()
def enable() -> None:
    """Patch programs of this environment from now on."""
    from ransac_fix.patching import site

    _print(site.enable())


@command.command()
def disable() -> None:
    """Patch them no more."""
    from ransac_fix.patching import site

    _print(site.disable())


@command.command()
def status() -> None:
    """Say whether they are patched, and what is waited for."""
    from ransac_fix.patching import site

    _print(site.status())


def _print(status: "SiteStatus") -> None:
    if not status.enabled:
        click.echo(f"disabled: there is no {status.path}")
        return
    click.echo(f"enabled by {status.path}")
    click.echo(f"waits for {', '.join(status.systems) or 'nothing'}")
    if status.missing:
        click.echo(
            f"does not know the patches for {', '.join(status.missing)} as they are now:"
            " run `ransac-fix site enable` again"
        )
    if status.switched_off:
        click.echo("RANSAC_FIX=0 is set here: programs started from here are not patched")
