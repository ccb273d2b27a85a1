"""``ransac-fix reproduce``: the paper's figures and tables, computed again."""

from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ransac_fix.cli.progress import progress_bar
from ransac_fix.extras import need

if TYPE_CHECKING:
    from collections.abc import Callable

    from ransac_fix.experiments.pose.tables import Row
    from ransac_fix.experiments.synthetic.setup import Shape


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
_theory_figure("figure-tradeoff", "The teaser in theory: success over mean trials as s varies.")


def _synthetic(shape: "Shape", line: str) -> None:
    @command.command(shape, help=line)
    @click.option(
        "--instances",
        type=click.IntRange(2),
        default=100_000,
        show_default=True,
        help="Instances of each row.",
    )
    @click.option(
        "--n",
        "n_samples",
        type=click.IntRange(10, 100_000),
        default={"line": 50, "ellipse": 100}[shape],
        show_default=True,
        help="Measurements.",
    )
    @click.option(
        "--inlier-ratio",
        "ratios",
        multiple=True,
        default=("0.2", "0.3", "0.4", "0.5"),
        show_default=True,
        metavar="DECIMAL",
        help="A row's ratio of inliers. Several times for several rows.",
    )
    @click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
    @click.option(
        "--noise",
        type=click.Choice(["determinant", "variance", "deviation"]),
        default="determinant",
        show_default=True,
        help="What of the noise is uniform in [0.5, 2].",
    )
    @click.option(
        "--scope",
        type=click.Choice(["instance", "measurement"]),
        default="instance",
        show_default=True,
        help="What has its own noise.",
    )
    @click.option(
        "--placement",
        type=click.Choice(["free", "whole", "absent"]),
        default="free",
        show_default=True,
        help="Segments between uniform points, or whole chords; ellipses anywhere, or wholly in "
        "the box. Absent is a control: outliers only.",
    )
    @click.option(
        "--outliers",
        type=click.Choice(["anywhere", "clear"]),
        default="anywhere",
        show_default=True,
        help="Outliers anywhere in the box, or where they are no inliers of the true shape.",
    )
    @click.option(
        "--limit",
        type=click.Choice(["distance", "square"]),
        default="distance",
        show_default=True,
        help="Whether an inlier's whitened distance, or its square, is at most 3.",
    )
    @click.option(
        "--ties",
        type=click.Choice(["first", "inliers", "all"]),
        default="inliers",
        show_default=True,
        help="Of two models with as many inliers: the first, or the one with smaller residuals "
        "of its inliers, or of all.",
    )
    @click.option(
        "--distance",
        type=click.Choice(["geometric", "sampson", "radial"]),
        default="geometric",
        show_default=True,
        help="The distance that decides who is an inlier; radial is along the ray from the "
        "ellipse's centre.",
        hidden=shape == "line",
    )
    @click.option(
        "--conics",
        type=click.Choice(["counted", "redrawn"]),
        default="counted",
        show_default=True,
        help="Whether five points on no ellipse are a trial, or are drawn again within it.",
        hidden=shape == "line",
    )
    @click.option(
        "--error",
        type=click.Choice(["euclidean", "whitened"]),
        default="euclidean",
        show_default=True,
        help="Unit of the errors in the AUC.",
    )
    @click.option(
        "--streams",
        type=click.Choice(["shared", "own"]),
        default="shared",
        show_default=True,
        help="Whether both rules read the same samples.",
    )
    @click.option(
        "--variants",
        is_flag=True,
        help="One line for each plausible reading of the paper, in place of the table.",
    )
    @click.option(
        "--results",
        type=click.Path(file_okay=False, path_type=Path),
        help="Keep finished chunks in this folder, and run only those that are not there.",
    )
    @click.option("--jobs", type=int, default=-1, help="Workers; one a core by default.")
    @click.option("--dask", metavar="ADDRESS", help="Run on the workers of this dask scheduler.")
    @click.option(
        "--output-format",
        type=click.Choice(["text", "markdown", "json"]),
        default="text",
        show_default=True,
    )
    def synthetic(
        instances: int,
        n_samples: int,
        ratios: tuple[str, ...],
        seed: int,
        variants: bool,
        results: Path | None,
        jobs: int,
        dask: str | None,
        output_format: str,
        **choices: str,
    ) -> None:
        if jobs == 0:
            raise click.UsageError("--jobs 0: give the number of workers, or -1 for one a core")
        if variants and output_format == "json":
            raise click.UsageError("--variants has no JSON: choose text or markdown")
        need("numba", extra="reproduce")
        from ransac_fix.experiments.synthetic.engine import run_setups
        from ransac_fix.experiments.synthetic.setup import SAMPLE_SIZE, Setup, paper_row
        from ransac_fix.experiments.synthetic.tables import summarise, with_changes
        from ransac_fix.experiments.synthetic.tables import variants as all_variants
        from ransac_fix.report import synthetic as report

        rows = [
            with_changes(Setup(shape, n_samples, _row_inliers(ratio, n_samples)), choices)
            for ratio in ratios
        ]
        if any(row.n_inliers < SAMPLE_SIZE[shape] for row in rows):
            raise click.UsageError(f"--inlier-ratio: fewer than {SAMPLE_SIZE[shape]} inliers")
        if variants and not all(paper_row(row) for row in rows):
            raise click.UsageError("--variants compares with the paper: leave n and p as given")
        named = list(all_variants(shape)) if variants else [("", {})]
        setups = [with_changes(row, changes) for _, changes in named for row in rows]
        with progress_bar(f"{shape}, {instances:,} instances a row") as progress:
            runs = run_setups(
                setups,
                instances,
                seed=seed,
                folder=results,
                n_jobs=jobs,
                dask_scheduler=dask,
                progress=progress,
            )
        table = [summarise(setup, run) for setup, run in zip(setups, runs, strict=True)]
        if variants:
            per_variant = [
                (name, table[i * len(rows) : (i + 1) * len(rows)])
                for i, (name, _) in enumerate(named)
            ]
            click.echo(report.variants_table(per_variant, markdown=output_format == "markdown"))
            return
        formats = {
            "text": report.synthetic_text,
            "markdown": report.synthetic_markdown,
            "json": report.synthetic_json,
        }
        click.echo(formats[output_format](table))


def _row_inliers(ratio: str, n_samples: int) -> int:
    from ransac_fix.experiments.explanation import inliers_from_ratio

    try:
        number = Fraction(Decimal(ratio))
        if not 0 < number <= 1:
            raise ValueError(f"{ratio} is not in (0, 1]")
        return inliers_from_ratio(number, n_samples)
    except (ValueError, ArithmeticError) as error:
        raise click.UsageError(f"--inlier-ratio {ratio}: {error}") from None


@command.command(help="Speed of the synthetic tables, beside the machine's peak and scikit-image.")
@click.option(
    "--output-format", type=click.Choice(["text", "markdown"]), default="text", show_default=True
)
def speed(output_format: str) -> None:
    """Time the hardest and the easiest row of each table on one core."""
    need("numba", "skimage", "threadpoolctl", extra="reproduce")
    from ransac_fix.experiments.synthetic.speed import measure_speed, speed_rows
    from ransac_fix.report.synthetic import speed_text

    rows = speed_rows()
    speeds = []
    with progress_bar("speed") as progress:
        for done, row in enumerate(rows):
            progress(done, len(rows))
            speeds.append(measure_speed(*row))
    click.echo(speed_text(speeds, markdown=output_format == "markdown"))


_synthetic("line", "The paper's table of 2D lines.")
_synthetic("ellipse", "The paper's table of 2D ellipses.")


_KINDS = ["homography", "essential", "fundamental", "pnp"]
_LIBRARIES = click.Choice(["poselib", "opencv", "colmap"])


def _pose_options(function: "Callable[..., None]") -> "Callable[..., None]":
    """Add the options that `pose` and `teaser` share."""
    options = [
        click.option(
            "--data",
            type=click.Path(path_type=Path),
            help="Folder of correspondences with ground truth: the project's layout, or the "
            "PoseLib benchmark's HDF5 files. Without it, the stereo pair inside scikit-image.",
        ),
        click.option(
            "--dataset",
            "datasets",
            multiple=True,
            metavar="PART",
            help="Only the data sets with this in their name. Several times for several.",
        ),
        click.option(
            "--repeats",
            type=click.IntRange(1),
            help="Subsamples of each pair; 5 by default, 100 of the stereo pair.",
        ),
        click.option(
            "--max-trials",
            "cap",
            type=click.IntRange(1),
            default=20_000,
            show_default=True,
            help="Trials after which a run ends though its rule is not met; how often is told.",
        ),
        click.option(
            "--pairs",
            type=click.IntRange(1),
            help="At most so many pairs of each data set, chosen by the seed; all by default.",
        ),
        click.option("--seed", type=click.IntRange(0), default=0, show_default=True),
        click.option(
            "--results",
            type=click.Path(file_okay=False, path_type=Path),
            help="Keep finished subsamples in this folder, and run only those that are not there.",
        ),
        click.option(
            "--jobs",
            type=int,
            default=1,
            show_default=True,
            help="Workers.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


@command.command(help="The paper's camera pose tables, on real correspondences.")
@_pose_options
@click.option(
    "--library",
    "libraries",
    type=_LIBRARIES,
    multiple=True,
    default=("poselib",),
    show_default=True,
    help="Which library runs, bare; the paper's is PoseLib. Several times for several.",
)
@click.option(
    "--kind", "kinds", multiple=True, type=click.Choice(_KINDS), help="All kinds by default."
)
@click.option(
    "--n",
    "ns",
    multiple=True,
    type=click.IntRange(8, 100_000),
    help="Correspondences, drawn from a pair's; 20, 100, 200 and 1000 by default, 20 and 50 of the "
    "stereo pair.",
)
@click.option(
    "--confidence",
    "confidences",
    multiple=True,
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=(0.95, 0.99),
    show_default=True,
)
@click.option(
    "--patched",
    "patch",
    is_flag=True,
    help="Compare the library under its own rule with the same calls under ransac-fix's run-time "
    "patch, in place of the two rules on the bare library.",
)
@click.option("--by-dataset", is_flag=True, help="Also a table for each data set.")
@click.option(
    "--brief", is_flag=True, help="One table of all libraries, a line a row: AUC@10, trials, time."
)
@click.option(
    "--output-format",
    type=click.Choice(["text", "markdown", "json"]),
    default="text",
    show_default=True,
)
def pose(
    data: Path | None,
    datasets: tuple[str, ...],
    libraries: tuple[str, ...],
    repeats: int | None,
    cap: int,
    pairs: int | None,
    seed: int,
    results: Path | None,
    jobs: int,
    kinds: tuple[str, ...],
    ns: tuple[int, ...],
    confidences: tuple[float, ...],
    patch: bool,
    by_dataset: bool,
    brief: bool,
    output_format: str,
) -> None:
    """Run both rules on subsamples of real pairs and print the tables."""
    if brief and output_format == "json":
        raise click.UsageError("--brief has no JSON: choose text or markdown")
    ns = ns or ((20, 50) if data is None else (20, 100, 200, 1000))
    rows = _pose_rows(
        data,
        datasets,
        tuple(dict.fromkeys(libraries)),
        repeats,
        cap,
        pairs,
        seed,
        results,
        jobs,
        kinds or tuple(_KINDS),
        ns,
        confidences,
        patch,
        by_dataset,
    )
    from ransac_fix.report import pose as report

    paper = data is not None
    if output_format == "json":
        click.echo(report.pose_json(rows))
    elif output_format == "markdown":
        click.echo(report.pose_markdown(rows, paper=paper, brief=brief))
    else:
        click.echo(report.pose_text(rows, paper=paper, brief=brief))


@command.command(help="The paper's teaser: accuracy against run time as s varies, both rules.")
@_pose_options
@click.option(
    "--library",
    type=_LIBRARIES,
    default="poselib",
    show_default=True,
    help="Which library runs, bare; the paper's is PoseLib.",
)
@click.option(
    "--kind", type=click.Choice(_KINDS), default="essential", show_default=True, help="Problem."
)
@click.option(
    "--n",
    "n_samples",
    type=click.IntRange(8, 100_000),
    default=50,
    show_default=True,
    help="Correspondences, drawn from a pair's.",
)
@click.option(
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    default="teaser.svg",
    show_default=True,
    help="Where the figure goes: a .svg, .pdf or .png file.",
)
def teaser(
    data: Path | None,
    datasets: tuple[str, ...],
    library: str,
    repeats: int | None,
    cap: int,
    pairs: int | None,
    seed: int,
    results: Path | None,
    jobs: int,
    kind: str,
    n_samples: int,
    output: Path,
) -> None:
    """Run both rules at many confidences, print the numbers and draw them."""
    from ransac_fix.report.drawing import check_drawable

    check_drawable(output)
    confidences = (0.5, 0.7, 0.9, 0.95, 0.99, 0.999, 0.9999)
    rows = _pose_rows(
        data,
        datasets,
        (library,),
        repeats,
        cap,
        pairs,
        seed,
        results,
        jobs,
        (kind,),
        (n_samples,),
        confidences,
        False,
        False,
    )
    from ransac_fix.report.pose import draw_teaser, teaser_text

    units = {row.unit for row in rows}
    rows = [row for row in rows if row.unit == ("degrees" if "degrees" in units else rows[0].unit)]
    click.echo(teaser_text(rows))
    draw_teaser(rows, output)
    click.echo(f"written: {output}", err=True)


def _pose_rows(
    data: Path | None,
    datasets: tuple[str, ...],
    libraries: tuple[str, ...],
    repeats: int | None,
    cap: int,
    pairs: int | None,
    seed: int,
    results: Path | None,
    jobs: int,
    kinds: tuple[str, ...],
    ns: tuple[int, ...],
    confidences: tuple[float, ...],
    patch: bool,
    by_dataset: bool,
) -> "list[Row]":
    """Load, run and summarise."""
    if jobs == 0:
        raise click.UsageError("--jobs 0: give the number of workers, or -1 for one a core")
    need("cv2", "poselib", "pycolmap", "skimage", extra="reproduce")
    from ransac_fix.experiments.pose.engine import Store, choose_pairs, run_problems
    from ransac_fix.experiments.pose.loaders import load_problems, load_stereo_pair
    from ransac_fix.experiments.pose.runs import Patch, Settings
    from ransac_fix.experiments.pose.tables import summarise

    problems = load_stereo_pair() if data is None else load_problems(data)
    if datasets:
        problems = [p for p in problems if any(part in p.dataset for part in datasets)]
    problems = [problem for problem in problems if problem.kind in kinds]
    if pairs is not None:
        problems = choose_pairs(problems, pairs, seed)
    if repeats is None:
        repeats = 100 if data is None else 5
    if not any(len(problem.first) >= n for problem in problems for n in ns):
        raise click.UsageError(
            f"no pair of kind {', '.join(kinds)} has {min(ns)} correspondences or more"
            + (f" in the data sets named {', '.join(datasets)}" if datasets else "")
        )
    if patch:
        from ransac_fix.patching import patched
        from ransac_fix.patching.sources import sources_digest
    rows = []
    for library in libraries:
        how = Patch(partial(patched, library), sources_digest(library)) if patch else None
        settings = Settings(library, ns, confidences, repeats, cap, seed, how)
        with progress_bar(f"pose, {library}") as progress:
            cases = run_problems(
                problems,
                settings,
                n_jobs=jobs,
                store=None if results is None else Store(results),
                progress=progress,
            )
        rows += summarise(cases, library, by_dataset=by_dataset)
    return rows
