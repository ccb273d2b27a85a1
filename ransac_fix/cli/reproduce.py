"""``ransac-fix reproduce``: the paper's figures and tables, computed again."""

from pathlib import Path

import click


@click.group()
def command() -> None:
    """Compute the paper's figures and tables again, its numbers beside ours."""


def _theory_figure(name: str, line: str) -> None:
    @command.command(name, help=line)
    @click.option(
        "--output",
        type=click.Path(dir_okay=False, path_type=Path),
        default=f"{name}.svg",
        show_default=True,
        help="Where the figure goes: a .svg, .pdf or .png file.",
    )
    def figure(output: Path) -> None:
        from ransac_fix.report.drawing import check_drawable
        from ransac_fix.report.figures import draw_theory_figure, theory_figure_text

        check_drawable(output)
        click.echo(theory_figure_text(name))
        draw_theory_figure(name, output)
        click.echo(f"written: {output}", err=True)


_theory_figure("figure-error", "Relative error of p^k over k and p, at n = 50 and 500.")
_theory_figure("figure-success", "True success of the p^k rule over n, for several k and p.")
_theory_figure("figure-undersampling", "Undersampling over n at s = 0.99 and k = 5.")
