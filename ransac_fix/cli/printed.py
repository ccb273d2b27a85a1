"""What is printed with rich, on a terminal or into a file."""

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TextIO

    from rich.console import Console


def printed(show: "Callable[[Console], None]", stream: "TextIO") -> None:
    """Print something; in a file no line ends in the blanks that a terminal is filled with.

    Parameters
    ----------
    show : callable
        Prints to a console.
    stream : text file
    """
    from rich.console import Console

    console = Console(file=stream, highlight=False, markup=False)
    if console.is_terminal:
        show(console)
        return
    with console.capture() as capture:
        show(console)
    for line in capture.get().splitlines():
        click.echo(line.rstrip(), stream)
