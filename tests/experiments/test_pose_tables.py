import json
from contextlib import nullcontext
from dataclasses import replace
from importlib.resources import files

import jsonschema
import msgspec
import numpy as np
import poselib
import pytest
from click.testing import CliRunner

from ransac_fix.cli.reproduce import command
from ransac_fix.criterion import approximate_required_trials, required_trials
from ransac_fix.errors import RansacFixError
from ransac_fix.experiments.pose import engine
from ransac_fix.experiments.pose.engine import Store, choose_pairs, run_problems
from ransac_fix.experiments.pose.libraries import LIBRARIES
from ransac_fix.experiments.pose.loaders import load_stereo_pair
from ransac_fix.experiments.pose.runs import Case, Patch, RuleRun, Settings, run_case
from ransac_fix.experiments.pose.stopping import first_stop
from ransac_fix.experiments.pose.tables import PAPER, PAPER_MILLISECONDS, summarise
from ransac_fix.patching import sources
from ransac_fix.report.pose import PoseDocument, pose_markdown, pose_text

CONFIDENCE = 0.99
CAP = 20_000


def run(*args, code=0):
    result = CliRunner().invoke(command, args, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture(scope="module")
def pair():
    return {problem.kind: problem for problem in load_stereo_pair()}


def stop_of(library, problem, rule):
    k = library.sample_size[problem.kind]
    n = len(problem.first)
    return first_stop(
        lambda trials: int(library.run(problem, trials, 0).inliers.sum()),
        lambda inliers: rule(inliers, n, k, CONFIDENCE) if inliers >= k else np.inf,
        CAP,
    )


@pytest.mark.parametrize("kind", ["essential", "fundamental", "pnp"])
def test_a_budget_is_the_trials_poselib_runs(pair, kind):
    problem = pair[kind].subsample(30, 0, 0)
    options = {
        "max_epipolar_error": problem.limit,
        "max_reproj_error": problem.limit,
        "min_iterations": 0,
        "max_iterations": CAP,
        "dyn_num_trials_mult": 1.0,
        "success_prob": CONFIDENCE,
    }
    cameras = [
        {"model": "PINHOLE", "width": 700, "height": 500, "params": [*np.diag(c)[:2], *c[:2, 2]]}
        for c in problem.cameras
    ]
    arguments = (problem.first, problem.second)
    if kind == "fundamental":
        _, info = poselib.estimate_fundamental(*arguments, options, {})
    elif kind == "essential":
        _, info = poselib.estimate_relative_pose(*arguments, *cameras, options, {})
    else:
        _, info = poselib.estimate_absolute_pose(*arguments, *cameras, options, {})
    found = stop_of(LIBRARIES["poselib"], problem, approximate_required_trials)
    assert not found.capped
    assert abs(info["iterations"] - found.trials) <= 3  # its loop's own offset


@pytest.mark.parametrize("repeat", range(4))
@pytest.mark.parametrize(
    ("library", "rule"),
    [
        ("poselib", approximate_required_trials),
        ("opencv", approximate_required_trials),
        ("colmap", required_trials),
    ],
)
def test_the_bare_library_stops_where_its_rule_is_found_to(pair, library, rule, repeat):
    """PoseLib and OpenCV under p**k, COLMAP under the exact rule: the same model comes out."""
    library = LIBRARIES[library]
    problem = pair["fundamental"].subsample(30, 0, repeat)
    stop = stop_of(library, problem, rule)
    bare = library.bare(problem, CONFIDENCE, 0, CAP)
    # One more trial or two, by rounding and by the loop's own offset, may have found more.
    near = [library.run(problem, stop.trials + extra, 0) for extra in range(-1, 4)]
    assert any(np.array_equal(bare.inliers, estimate.inliers) for estimate in near)


@pytest.mark.parametrize("library", ["poselib", "opencv", "colmap"])
@pytest.mark.parametrize("kind", ["essential", "fundamental", "pnp"])
def test_every_library_solves_every_kind(pair, library, kind):
    problem = pair[kind].subsample(300, 0, 0)
    estimate = LIBRARIES[library].run(problem, 2000, 0)
    assert estimate.inliers.mean() > 0.3
    assert problem.truth.error(problem, estimate) < 10
    again = LIBRARIES[library].run(problem, 2000, 0)
    np.testing.assert_array_equal(estimate.inliers, again.inliers)


@pytest.mark.parametrize("library", ["poselib", "opencv", "colmap"])
def test_every_library_solves_homographies(pair, library):
    rng = np.random.default_rng(0)
    first = rng.uniform(0, 500, (60, 2))
    homography = np.array([[1.1, 0.1, 5], [-0.1, 0.9, 20], [1e-4, 0, 1]])
    mapped = np.column_stack((first, np.ones(60))) @ homography.T
    second = mapped[:, :2] / mapped[:, 2:]
    second[40:] = rng.uniform(0, 500, (20, 2))
    problem = replace(pair["essential"], kind="homography", first=first, second=second)
    estimate = LIBRARIES[library].run(problem, 500, 0)
    assert estimate.inliers[:40].all()
    model = estimate.model / estimate.model[2, 2]
    np.testing.assert_allclose(model, homography, atol=1e-3)


@pytest.mark.parametrize("library", ["poselib", "opencv", "colmap"])
def test_hopeless_measurements_end_at_the_cap(pair, library):
    rng = np.random.default_rng(0)
    noise = rng.uniform(0, 500, (2, 40, 2))
    problem = replace(pair["fundamental"], first=noise[0], second=noise[1], limit=1e-3)
    settings = Settings(library, (40,), (0.99,), 1, 300, 0)
    (case,) = run_case(problem, 40, 0, settings)
    assert case.approximate.capped
    assert case.exact.trials == 300


def test_trials_beyond_what_opencv_can_run_are_known():
    opencv = LIBRARIES["opencv"]
    most = approximate_required_trials(7, 100, 7, float(np.nextafter(1.0, 0.0)))
    assert opencv.reaches(most - 1, 7, 100, 7)
    assert not opencv.reaches(required_trials(7, 100, 7, 0.99), 7, 100, 7)
    assert LIBRARIES["poselib"].reaches(10**9, 7, 100, 7)


@pytest.fixture(scope="module")
def cases(pair):
    settings = Settings("poselib", (20, 40), (0.9, 0.99), 6, CAP, 0)
    return run_problems(list(pair.values()), settings)


def test_the_exact_rule_never_stops_first_and_more_confidence_takes_longer(cases):
    assert len(cases) == 3 * 2 * 6 * 2
    for case in cases:
        assert case.exact.trials >= case.approximate.trials > 0
        if case.exact.trials == case.approximate.trials:
            assert case.exact == case.approximate
    for low, high in zip(cases[::2], cases[1::2], strict=True):
        assert (low.confidence, high.confidence) == (0.9, 0.99)
        assert low.exact.trials <= high.exact.trials


def test_stopped_trials_are_what_the_rules_ask_for(pair, cases):
    library = LIBRARIES["poselib"]
    for case in cases[:: len(cases) // 12]:
        problem = pair[case.kind].subsample(case.n_samples, 0, case.repeat)
        k = library.sample_size[case.kind]
        for run_, rule in (
            (case.approximate, approximate_required_trials),
            (case.exact, required_trials),
        ):
            inliers = int(library.run(problem, run_.trials, 0).inliers.sum())
            assert run_.trials >= rule(inliers, case.n_samples, k, case.confidence)


def test_results_do_not_depend_on_workers(pair, cases):
    settings = Settings("poselib", (20,), (0.9, 0.99), 3, CAP, 0)
    again = run_problems([pair["pnp"]], settings, n_jobs=2)
    before = [c for c in cases if c.kind == "pnp" and c.n_samples == 20 and c.repeat < 3]
    for one, other in zip(before, again, strict=True):
        assert one.exact.error == other.exact.error
        assert one.exact.trials == other.exact.trials


def test_finished_subsamples_are_not_run_again(pair, cases, tmp_path, monkeypatch):
    settings = Settings("poselib", (20,), (0.9, 0.99), 3, CAP, 0)
    store = Store(tmp_path / "kept")
    ran = []
    monkeypatch.setattr(engine, "run_case", lambda *args: (ran.append(args[2]), run_case(*args))[1])
    first = run_problems([pair["pnp"]], settings, store=store)
    assert ran == [0, 1, 2]
    lines = store.path.read_text().split("\n")
    # A kill in the middle of the last line, and an error that is infinite.
    assert json.loads(lines[2])["cases"][0]["kind"] == "pnp"
    store.path.write_text("\n".join(lines)[:-40])
    seen = []
    again = run_problems(
        [pair["pnp"]],
        settings,
        store=store,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert ran == [0, 1, 2, 2]
    assert seen == [(2, 3), (3, 3)]
    assert again[:4] == first[:4]
    assert [c.exact.trials for c in again] == [c.exact.trials for c in first]
    assert run_problems([pair["pnp"]], settings, store=store) == again
    assert len(ran) == 4


def test_what_changes_a_result_is_not_taken_from_the_store(pair, tmp_path):
    settings = Settings("poselib", (20,), (0.99,), 1, CAP, 0)
    store = Store(tmp_path)
    problem = pair["pnp"]
    keys = {
        store.key(problem, 20, 0, settings),
        store.key(problem, 20, 1, settings),
        store.key(problem, 21, 0, settings),
        store.key(replace(problem, limit=1.0), 20, 0, settings),
        store.key(replace(problem, first=problem.first + 1), 20, 0, settings),
        store.key(problem, 20, 0, replace(settings, library="colmap")),
        store.key(problem, 20, 0, replace(settings, cap=1)),
        store.key(problem, 20, 0, replace(settings, seed=1)),
        store.key(problem, 20, 0, replace(settings, confidences=(0.9,))),
        store.key(problem, 20, 0, replace(settings, patch=Patch(nullcontext, "1"))),
        store.key(problem, 20, 0, replace(settings, patch=Patch(nullcontext, "2"))),
    }
    assert len(keys) == 11
    assert store.key(problem, 20, 0, replace(settings, repeats=9)) in keys


def test_infinite_errors_are_kept(tmp_path):
    store = Store(tmp_path)
    cases = [made("a", (np.inf, 1.0))]
    store.add("key", cases)
    assert store.load() == {"key": cases}


def test_a_folder_that_cannot_be_written_or_read_is_one_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RansacFixError, match=r"pose\.jsonl: cannot be read: Not a directory$"):
        Store(tmp_path / "file").load()
    with pytest.raises(RansacFixError, match="cannot be written"):
        Store(tmp_path / "file").add("key", [made("a", (1.0, 1.0))])


def test_pairs_are_chosen_by_the_seed_and_more_keep_fewer(pair):
    problems = [
        replace(pair[kind], dataset=dataset, name=f"{i}")
        for dataset in ("a", "b")
        for kind in ("essential", "fundamental")
        for i in range(9)
    ]
    few, more = choose_pairs(problems, 3, 0), choose_pairs(problems, 5, 0)
    assert len(few) == 12
    assert len(more) == 20
    assert {id(p) for p in few} < {id(p) for p in more}
    names = {kind: {(p.dataset, p.name) for p in few if p.kind == kind} for kind in pair}
    assert names["essential"] == names["fundamental"]
    assert choose_pairs(problems, 3, 1) != few
    assert choose_pairs(problems, 100, 0) == problems


def made(name, errors, trials=(10, 20), dataset="d", unit="degrees", repeat=0):
    runs = [RuleRun(e, t, 1e-3, False) for e, t in zip(errors, trials, strict=True)]
    return Case("essential", dataset, name, unit, 20, repeat, 0.99, *runs)


def test_auc_is_the_area_under_the_share_of_errors_below():
    errors = np.array([0.0, 2.0, 7.0, 30.0, np.inf])
    row = summarise(
        [made(str(i), (e, e)) for i, e in enumerate(errors)], "poselib", by_dataset=False
    )[0]
    for threshold, auc in zip((5, 10, 20), row.approximate, strict=True):
        grid = (np.arange(100_000) + 0.5) / 100_000 * threshold
        share = (errors[:, None] <= grid).mean(axis=0)
        assert auc == pytest.approx(100 * share.mean(), abs=0.01)
    assert row.n_problems == row.n_cases == 5
    assert row.trials == (10, 20)
    assert row.differing == 100


def test_subsamples_of_a_pair_count_as_one():
    """Repeating every subsample leaves the interval as it was: nothing was learnt."""
    once = [made(str(i), (e, 0.8 * e)) for i, e in enumerate((1.0, 2, 3, 4, 6, 7))]
    often = [replace(case, repeat=r) for case in once for r in range(5)]
    first, second = (
        summarise(cases, "poselib", by_dataset=False)[0].change[1] for cases in (once, often)
    )
    assert second.low == pytest.approx(first.low)
    assert second.high == pytest.approx(first.high)
    assert first.low < first.value < first.high


def test_rows_by_dataset_and_by_unit_stay_apart():
    cases = [
        made("a", (1.0, 1.0)),
        made("b", (1.0, 1.0), dataset="e"),
        made("c", (2.0, 2.0), unit="pixels", dataset="e"),
    ]
    rows = summarise(cases, "poselib", by_dataset=True)
    assert [(r.unit, r.dataset, r.n_cases) for r in rows] == [
        ("degrees", "all", 2),
        ("degrees", "d", 1),
        ("degrees", "e", 1),
        ("pixels", "all", 1),
        ("pixels", "e", 1),
    ]


def test_nothing_estimated_has_no_relative_change():
    row = summarise(
        [made("a", (np.inf, np.inf)), made("b", (40.0, 1.0))], "poselib", by_dataset=False
    )[0]
    assert row.change == (None, None, None)
    assert "nan" not in pose_text([row], paper=True)


def test_a_single_subsample_has_no_interval():
    row = summarise([made("a", (1.0, 2.0))], "poselib", by_dataset=False)[0]
    assert row.change == (None, None, None)


def test_the_papers_tables_are_whole():
    assert all(len(table) == 8 for table in PAPER.values())
    assert {k: set(v) for k, v in PAPER.items()} == {
        k: set(v) for k, v in PAPER_MILLISECONDS.items()
    }


def test_the_stereo_pair_runs_from_the_command_line():
    text = run("pose", "--repeats", "2", "--n", "20", "--kind", "pnp", "--dataset", "motor")
    assert "Perspective-n-Point (poselib)" in text
    assert "1 pairs, 2 subsamples" in text
    assert "paper" not in text


def test_patched_libraries_are_compared_with_bare_ones():
    args = ["pose", "--patched", "--repeats", "8", "--n", "20", "--kind", "fundamental"]
    document = json.loads(run(*args, "--output-format", "json"))
    for row in document["rows"]:
        assert row["trials"] is row["differing"] is None
        assert min(row["seconds"]) > 0
    assert document["rows"][0]["approximate"] != document["rows"][0]["exact"]
    text = run(*args, "--library", "opencv")
    assert "bare" in text
    assert "patched" in text


def test_a_changed_wrapper_is_run_again(tmp_path, monkeypatch):
    """Kept results of the bare library hold, those of a patch with other sources do not."""
    args = ["pose", "--repeats", "2", "--n", "20", "--kind", "pnp", "--results", str(tmp_path)]

    def kept():
        return len((tmp_path / "pose.jsonl").read_text("utf-8").split("\n")) - 1

    counts = []
    for digest in ("one", "one", "other"):
        monkeypatch.setattr(sources, "sources_digest", lambda name, digest=digest: digest)
        for more in ([], ["--patched"]):
            run(*args, *more)
        counts.append(kept())
    assert counts == [4, 4, 6]


def test_json_follows_the_schema():
    schema = json.loads(files("ransac_fix.report").joinpath("schemas/pose.json").read_text())
    document = json.loads(
        run("pose", "--repeats", "2", "--n", "20", "--kind", "pnp", "--output-format", "json")
    )
    jsonschema.validate(document, schema)
    assert len(document["rows"]) == 2
    assert schema == json.loads(msgspec.json.encode(msgspec.json.schema(PoseDocument)))


def test_markdown_has_the_papers_numbers_where_asked():
    row = summarise([made("a", (1.0, 1.0))], "poselib", by_dataset=False)[0]
    assert "26.08" in pose_markdown([row], paper=True)
    assert "26.08" not in pose_markdown([row], paper=False)
    # The paper's run times stand beside ours.
    assert "| ms | 1.000 | 1.000 | +0.0 | 0.6 | 1.4 | +133.3 |" in pose_markdown([row], paper=True)


def test_a_brief_table_has_a_line_for_each_library():
    rows = [
        replace(row, library=library)
        for library in ("opencv", "poselib")
        for row in summarise([made("a", (1.0, 1.0)), made("b", (2.0, 1.0))], "", by_dataset=False)
    ]
    lines = pose_markdown(rows, paper=True, brief=True).splitlines()
    assert [line.split(" | ")[3] for line in lines[2:]] == ["opencv", "poselib"]
    assert "85.00 | 90.00 | +5.88" in lines[2]
    assert "| +1.77 | 10.0 | 20.0 | 1.000 | 1.000 | 2 | 0.0 % |" in lines[2]
    assert "paper" not in pose_text(rows, paper=False, brief=True)
    # Nothing is known of the trials of patched libraries, so there is no such column.
    text = pose_text([replace(rows[0], trials=None, capped=None)], paper=False, brief=True)
    assert "patched" in text
    assert "trials" not in text
    assert "capped" not in text


def test_several_libraries_come_out_of_one_command():
    args = ["--library", "opencv", "--library", "poselib", "--library", "opencv"]
    text = run("pose", *args, "--kind", "pnp", "--repeats", "2", "--n", "20")
    assert [line for line in text.splitlines() if "Perspective" in line] == [
        "Perspective-n-Point (opencv), errors in degrees or percent of depth",
        "Perspective-n-Point (poselib), errors in degrees or percent of depth",
    ]


def test_the_teaser_comes_out_of_one_command(tmp_path):
    path = tmp_path / "teaser.svg"
    text = run("teaser", "--kind", "pnp", "--n", "20", "--repeats", "2", "--output", str(path))
    assert "0.9999" in text
    assert path.read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["pose", "--n", "100000"], "has 100000 correspondences or more"),
        (["pose", "--dataset", "nowhere"], "in the data sets named nowhere"),
        (["pose", "--jobs", "0"], "--jobs 0"),
        (["pose", "--confidence", "1"], "--confidence"),
        (["pose", "--n", "5"], "--n"),
        (["pose", "--brief", "--output-format", "json"], "--brief has no JSON"),
    ],
)
def test_bad_input_is_one_clear_error(args, message):
    assert message in run(*args, code=2)
