import json
import signal
import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from itertools import pairwise

import distributed
import jsonschema
import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from ransac_fix.cli.reproduce import command
from ransac_fix.errors import RansacFixError
from ransac_fix.experiments.intervals import mean, relative_change
from ransac_fix.experiments.synthetic import engine
from ransac_fix.experiments.synthetic.engine import run_setups
from ransac_fix.experiments.synthetic.runs import run_instances, trial_tables
from ransac_fix.experiments.synthetic.setup import PAPER, Setup, paper_row
from ransac_fix.experiments.synthetic.speed import measure_speed
from ransac_fix.experiments.synthetic.tables import summarise, variants, with_changes
from ransac_fix.report.synthetic import (
    SyntheticDocument,
    speed_text,
    synthetic_markdown,
    synthetic_text,
)

LINE = Setup("line", 50, 15)
SETUPS = [LINE, Setup("line", 50, 25)]


def same(first, second):
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for a, b in zip(first, second, strict=True)
        for name in ("gains", "trials", "tests")
    )


def run(*args, code=0):
    result = CliRunner().invoke(command, args, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture(scope="module")
def alone():
    return run_setups(SETUPS, 1300, n_jobs=1)


def test_results_are_in_the_order_of_instances(alone):
    assert same([run_instances(setup, 0, 0, 1300) for setup in SETUPS], alone)


def test_results_do_not_depend_on_the_number_of_workers(alone):
    assert same(run_setups(SETUPS, 1300, n_jobs=2), alone)


def test_results_do_not_depend_on_dask(alone):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        assert same(run_setups(SETUPS, 1300, dask_scheduler=cluster.scheduler_address), alone)


def test_a_missing_scheduler_is_one_error():
    with pytest.raises(RansacFixError, match="no dask scheduler at nonsense"):
        run_setups(SETUPS, 10, dask_scheduler="nonsense")


def test_finished_chunks_are_not_run_again_and_damaged_ones_are(tmp_path, monkeypatch, alone):
    run_setups(SETUPS, 1300, folder=tmp_path, n_jobs=1)
    stored = sorted(tmp_path.rglob("*.npz"))
    assert len(stored) == 6
    stored[0].write_bytes(b"cut off")
    np.savez(stored[1], gains=np.zeros(3))
    stored[2].unlink()
    ran = []
    monkeypatch.setattr(
        engine, "run_instances", lambda *args: (ran.append(args[2:]), run_instances(*args))[1]
    )
    seen = []
    again = run_setups(
        SETUPS,
        1300,
        folder=tmp_path,
        n_jobs=1,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert len(ran) == 3
    assert same(again, alone)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert 0 < seen[0][0] < seen[-1][0] == seen[-1][1]


def test_other_setups_and_seeds_do_not_share_results(tmp_path):
    run_setups([LINE], 10, folder=tmp_path, n_jobs=1)
    for setup, seed in ((replace(LINE, ties="first"), 0), (LINE, 1)):
        assert same(
            run_setups([setup], 10, seed=seed, folder=tmp_path, n_jobs=1),
            [run_instances(setup, seed, 0, 10)],
        )
    assert len(list(tmp_path.iterdir())) == 3


KILLED_HALFWAY = """
import os, signal, sys
from pathlib import Path
from ransac_fix.experiments.synthetic.engine import run_setups
from ransac_fix.experiments.synthetic.setup import Setup

def progress(done, total):
    if 2 * done >= total:
        os.kill(os.getpid(), signal.SIGKILL)

run_setups([Setup("line", 50, 10)], 2000, folder=Path(sys.argv[1]), n_jobs=1, progress=progress)
"""


def test_a_killed_run_goes_on_where_it_was(tmp_path):
    done = subprocess.run([sys.executable, "-c", KILLED_HALFWAY, str(tmp_path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(list(tmp_path.rglob("*.npz"))) == 2
    told = []
    setup = Setup("line", 50, 10)
    (runs,) = run_setups(
        [setup], 2000, folder=tmp_path, n_jobs=1, progress=lambda *args: told.append(args)
    )
    total = told[0][1]
    assert told == [(total / 2, total), (total * 3 / 4, total), (total, total)]
    straight = run_instances(setup, 0, 0, 2000)
    np.testing.assert_array_equal(runs.trials, straight.trials)
    np.testing.assert_array_equal(runs.gains, straight.gains)


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(RansacFixError, match="cannot be written"):
        run_setups([LINE], 10, folder=blocked, n_jobs=1)


def test_intervals_cover_the_truth_and_pairing_narrows_them():
    rng = np.random.default_rng(0)
    covered = {"mean": 0, "change": 0}
    for _ in range(400):
        difficulty = rng.gamma(2.0, 1.0, 300)
        before = difficulty * rng.uniform(0.9, 1.1, 300)
        after = 1.2 * difficulty * rng.uniform(0.9, 1.1, 300)
        m, c = mean(before), relative_change(before, after)
        covered["mean"] += m.low <= 2.0 <= m.high
        covered["change"] += c.low <= 0.2 <= c.high
    for hits in covered.values():  # 95 % of 400, within what chance allows
        assert 1e-4 < stats.binom.cdf(hits, 400, 0.95) < 1 - 1e-4
    unpaired = relative_change(before, rng.permutation(after))
    paired = relative_change(before, after)
    assert paired.value == pytest.approx(unpaired.value)
    assert unpaired.high - unpaired.low > 5 * (paired.high - paired.low)


def test_a_row_is_the_mean_of_its_instances(alone):
    row = summarise(LINE, alone[0])
    assert row.approximate[2].value == pytest.approx(100 * alone[0].gains[:, 0, 2].mean())
    before, after = alone[0].trials.sum(axis=0)
    assert row.more_trials.value == pytest.approx(100 * (after / before - 1))
    assert row.paper == PAPER["line"][paper_ratio(LINE)]
    assert paper_row(Setup("line", 100, 30)) is None


def test_a_row_tells_what_the_rules_had_in_hand(alone):
    row = summarise(LINE, alone[0])
    asked = trial_tables(50, 2, LINE.confidence)
    in_hand = [
        [min(i for i in range(51) if table[i] <= n) for n in column]
        for table, column in zip(asked, alone[0].trials.T, strict=True)
    ]
    assert row.in_hand == pytest.approx((np.mean(in_hand[0]), np.mean(in_hand[1])))
    kept = [max(asked[1][i], n) for i, n in zip(in_hand[0], alone[0].trials[:, 0], strict=True)]
    assert row.trials_if_kept == pytest.approx(np.mean(kept))
    assert row.trials[1] <= row.trials_if_kept  # better models only shorten a run


def paper_ratio(setup):
    return next(p for p in PAPER[setup.shape] if float(p) == setup.inlier_ratio)


@pytest.fixture(scope="module")
def table():
    setups = [Setup("line", 50, inliers) for inliers in (10, 15, 20, 25)]
    return [summarise(s, r) for s, r in zip(setups, run_setups(setups, 4000), strict=True)]


def test_line_trials_are_within_two_points_of_the_papers(table):
    for row in table:
        assert abs(row.more_trials.value - row.paper.more_trials) < 2


def test_every_line_auc_grows_with_the_exact_rule_and_most_where_inliers_are_few(table):
    for i in range(3):
        changes = [row.change[i] for row in table]
        assert all(change.low > 0 for change in changes)
        # the paper's order, up to what 4,000 instances can tell
        assert all(a.high > b.low for a, b in pairwise(changes))
        assert changes[0].value > changes[-1].value


def test_ellipse_auc_and_trials_grow_with_the_exact_rule():
    setup = Setup("ellipse", 100, 40)
    row = summarise(setup, run_setups([setup], 1500)[0])
    assert all(change.low > 0 for change in row.change)
    assert abs(row.more_trials.value - row.paper.more_trials) < 5


@pytest.mark.parametrize("shape", ["line", "ellipse"])
def test_each_variant_is_another_setup(shape):
    base = Setup(shape, 50, 25)
    setups = [with_changes(base, changes) for _, changes in variants(shape)]
    assert setups[0] == base
    assert len({setup.key() for setup in setups}) == len(setups)


def test_text_and_markdown_hold_the_papers_numbers_beside_ours(table):
    for output in (synthetic_text(table), synthetic_markdown(table)):
        assert "36.144" in output
        assert "78.850" in output
        assert f"{table[0].approximate[0].value:.3f}" in output
        assert "ties inliers" in output


def test_json_follows_the_schema():
    schema = json.loads(files("ransac_fix.report").joinpath("schemas/synthetic.json").read_text())
    output = run("line", "--instances", "60", "--jobs", "1", "--output-format", "json")
    document = json.loads(output)
    jsonschema.validate(document, schema)
    assert [row["setup"]["n_inliers"] for row in document["rows"]] == [10, 15, 20, 25]
    described = msgspec.json.encode(msgspec.json.schema(SyntheticDocument))
    assert schema == json.loads(described)


@pytest.mark.parametrize("output_format", ["text", "markdown", "json"])
def test_an_auc_of_nothing_has_no_relative_change(output_format):
    """Of these two instances neither rule finds the ellipse to within a unit."""
    args = ["--n", "25", "--inlier-ratio", "0.2", "--seed", "12", "--jobs", "1"]
    output = run("ellipse", "--instances", "2", *args, "--output-format", output_format)
    if output_format == "json":
        (row,) = json.loads(output)["rows"]
        assert row["approximate"][0]["value"] == 0
        assert row["change"][0] is None
    else:
        first, _, third = (line for line in output.splitlines() if "AUC@" in line)
        assert "0.000" in first
        assert "[" not in first
        assert "[" in third


def test_variants_table_has_a_line_each():
    output = run("line", "--variants", "--instances", "40", "--jobs", "1")
    assert all(name in output for name, _ in variants("line"))


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--inlier-ratio", "0.33"], "not a whole number of inliers"),
        (["--inlier-ratio", "x"], "--inlier-ratio x"),
        (["--inlier-ratio", "0.02"], "fewer than 2 inliers"),
        (["--jobs", "0"], "--jobs 0"),
        (["--variants", "--n", "60", "--inlier-ratio", "0.5"], "leave n and p"),
        (["--variants", "--output-format", "json"], "no JSON"),
    ],
)
def test_bad_input_is_one_clear_error(args, message):
    assert message in run("line", "--instances", "10", *args, code=2)


def test_speed_counts_what_it_ran():
    setup = Setup("line", 50, 25)
    speed = measure_speed(setup, 20, 2)
    tests = run_instances(setup, 0, 0, 20).tests.sum()
    assert speed.tests_a_second * speed.seconds * 20 == pytest.approx(tests)
    assert len(speed.ratios) == 2
    assert min(speed.ratio, speed.share_of_peak) > 0
    assert measure_speed(setup, 2, 0).ratio is None
    assert "line, I/n = 0.5" in speed_text([speed])
