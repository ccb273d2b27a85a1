import json
import math
import subprocess
import sys
from fractions import Fraction
from importlib.resources import files

import jsonschema
import msgspec
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from ransac_fix.cli.explain import command
from ransac_fix.criterion import Stratum
from ransac_fix.experiments.explanation import (
    Problem,
    explain,
    inliers_from_ratio,
    sweep_inliers,
    sweep_measurements,
)
from ransac_fix.report.explanation_json import ExplanationDocument
from ransac_fix.report.text_table import count_text, percent_text, probability_text

EXAMPLE = ["--n", "50", "--inlier-ratio", "0.3", "--k", "5", "--confidence", "0.99"]


def run(*args: str, code: int = 0) -> str:
    result = CliRunner().invoke(command, args, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def run_json(*args: str) -> dict:
    schema = json.loads(files("ransac_fix.report").joinpath("schemas/explanation.json").read_text())
    document = json.loads(run(*args, "--output-format", "json"))
    jsonschema.validate(document, schema)
    return document


def smallest_n(miss: Fraction, allowed: Fraction) -> int:
    """The smallest N with miss**N <= allowed, by multiplying."""
    n, product = 0, Fraction(1)
    while product > allowed:
        product *= miss
        n += 1
    return n


def test_both_rules_against_rational_arithmetic_at_small_numbers():
    counts = (6, 12, 3)
    explanation = explain(Problem(12, 6, 3, Fraction(9, 10)))
    assert explanation.approximate_trials == smallest_n(1 - Fraction(1, 8), Fraction(1, 10))
    distinct = Fraction(math.comb(6, 3), math.comb(12, 3))
    replaced = Fraction(math.perm(6, 3), 12**3)
    for law, probability in zip(explanation.laws, (distinct, replaced), strict=True):
        assert law.all_inlier_probability == float(probability)
        assert law.required_trials == smallest_n(1 - probability, Fraction(1, 10)), counts
        reached = 1 - (1 - probability) ** explanation.approximate_trials
        assert law.success_of_approximate_trials == pytest.approx(float(reached), rel=1e-12)
        assert law.n_subsets == 220
        assert law.n_all_inlier_subsets == 20


def test_stratified_law_takes_its_own_probability():
    strata = (Stratum(10, 20, 3), Stratum(5, 30, 2))
    explanation = explain(Problem(50, 15, 5, Fraction(99, 100), strata))
    law = explanation.law("stratified")
    expected = Fraction(math.comb(10, 3) * math.comb(5, 2), math.comb(20, 3) * math.comb(30, 2))
    assert law.all_inlier_probability == float(expected)
    assert law.n_subsets == math.comb(20, 3) * math.comb(30, 2)


@given(st.data())
@settings(derandomize=True)
def test_limits_decide_exactly_when_they_bind(data):
    n = data.draw(st.integers(2, 60))
    k = data.draw(st.integers(1, min(n, 6)))
    inliers = data.draw(st.integers(0, n))
    floor = data.draw(st.integers(0, 500))
    cap = data.draw(st.none() | st.integers(0, 500))
    problem = Problem(n, inliers, k, Fraction(19, 20), (), floor, cap)
    explanation = explain(problem)
    for law in explanation.laws:
        if not problem.has_limits:
            assert law.exact_within_limits is None
            continue
        for wanted, run_ in (
            (explanation.approximate_trials, law.approximate_within_limits),
            (law.required_trials, law.exact_within_limits),
        ):
            trials = math.inf if wanted is None else wanted
            expected = min(max(trials, floor), math.inf if cap is None else cap)
            assert (math.inf if run_.trials is None else run_.trials) == expected
            assert (run_.bound_by == "rule") == (expected == trials)


@pytest.mark.parametrize(
    ("n", "inliers", "k", "cheaper"),
    [(8, 3, 3, True), (50, 15, 5, False), (9, 7, 7, True), (20, 2, 3, True)],
    ids=["56 subsets, 256 trials", "2.1 million subsets", "36 subsets", "no inlier sample at all"],
)
def test_enumeration_is_advised_when_it_takes_no_more_trials(n, inliers, k, cheaper):
    law = explain(Problem(n, inliers, k, Fraction(99, 100))).law("distinct")
    assert law.enumeration_is_cheaper is cheaper
    text = run("--n", str(n), "--inliers", str(inliers), "--k", str(k))
    assert ("enumerate." in text) == (cheaper and inliers >= k)


@given(st.integers(1, 10**6), st.data())
@settings(derandomize=True)
def test_a_ratio_written_with_all_its_digits_gives_its_inliers(n, data):
    inliers = data.draw(st.integers(0, n))
    assert inliers_from_ratio(Fraction(inliers, n), n) == inliers


def test_a_ratio_stands_for_the_nearest_count_or_for_none():
    assert inliers_from_ratio(Fraction("0.333"), 30) == 10
    with pytest.raises(ValueError, match=r"0\.33 of 30 measurements is 9\.9"):
        inliers_from_ratio(Fraction("0.33"), 30)


def test_sweep_over_n_keeps_the_ratio_and_starts_where_a_sample_exists():
    rows = sweep_measurements(Problem(50, 15, 5, Fraction(99, 100)))
    assert all(row.problem.n_inliers * 10 == row.problem.n_samples * 3 for row in rows)
    assert rows[0].problem.n_samples == 20  # 10 has 3 inliers only
    assert 50 in [row.problem.n_samples for row in rows]
    missing = [row.law("distinct").undersampling for row in rows]
    assert missing == sorted(missing, reverse=True)


def test_sweep_over_p_covers_all_inlier_counts_of_a_small_problem():
    rows = sweep_inliers(Problem(12, 6, 3, Fraction(99, 100)))
    assert [row.problem.n_inliers for row in rows] == list(range(3, 13))


def test_text_says_what_the_paper_says():
    text = run(*EXAMPLE)
    assert "I = 15 inliers" in text
    for number in ("0.00243", "1,893", "0.001417", "3,247", "0.9318", "+71.5 %", "2,118,760"):
        assert number in text
    assert "not the success rate of a whole run" in text


def test_with_inliers_only_the_one_trial_of_the_common_rule_is_judged():
    text = run("--n", "50", "--inliers", "50", "--k", "5")
    repeated = 1 - math.perm(50, 5) / 50**5
    line = next(line for line in text.splitlines() if "with replacement" in line)
    assert line.split()[-3:] == [f"{1 - repeated:.4f}", "+200.0", "%"]
    assert "infinite" not in text


def test_certainty_is_had_from_enumeration_only():
    text = run(*EXAMPLE, "--confidence", "1")
    assert "which no number of random trials is" in text
    assert "never), nor" not in text


def test_limits_are_told_with_their_guarantee():
    text = run(*EXAMPLE, "--max-trials", "1000", "--min-trials", "10")
    assert "The cap decides under both rules" in text
    document = run_json(*EXAMPLE, "--max-trials", "1000")
    law = document["explanation"]["laws"][0]
    assert law["exact_within_limits"]["trials"] == 1000
    expected = 1 - (1 - math.comb(15, 5) / math.comb(50, 5)) ** 1000
    assert law["exact_within_limits"]["guarantee"] == pytest.approx(expected)


def test_no_all_inlier_sample_is_said_and_is_null_in_json():
    assert "No all-inlier sample exists" in run("--n", "50", "--inliers", "2", "--k", "3")
    document = run_json("--n", "50", "--inliers", "2", "--k", "3")
    assert document["explanation"]["laws"][0]["required_trials"] is None


def test_json_holds_the_sweep_and_follows_the_schema():
    document = run_json(*EXAMPLE, "--sweep", "p=0.2:0.6:0.2")
    assert [row["n_inliers"] for row in document["sweep"]] == [10, 20, 30]
    assert run_json(*EXAMPLE)["sweep"] is None
    assert run_json("--stratum", "10/20:3", "--stratum", "5/30:2")["explanation"]["strata"]


def test_enumeration_is_told_apart_for_draws_with_replacement():
    """252 subsets: more than the 192 trials that distinct draws need, fewer than the 638."""
    text = run("--n", "10", "--inliers", "6", "--k", "5")
    assert "252 subsets exist, 6 of them all-inlier: sampling is cheaper" in text
    assert "With replacement 638 trials are needed: trying each once is cheaper." in text
    assert "With replacement" not in run(*EXAMPLE)


def test_a_sweep_says_that_it_leaves_strata_out():
    strata = ["--stratum", "5/20:2", "--stratum", "10/30:3"]
    result = CliRunner().invoke(command, [*strata, "--sweep", "n=50"])
    assert "strata do not scale: the sweep is without them" in result.stderr
    assert not CliRunner().invoke(command, strata).stderr


def test_numbers_beyond_the_floats_still_answer():
    document = run_json("--n", str(10**12), "--inliers", "100", "--k", "100")
    assert document["explanation"]["laws"][0]["n_all_inlier_subsets"] == 1
    assert "4.934e1042" in run("--n", str(10**12), "--inliers", "100", "--k", "100")


def test_schema_file_is_the_one_the_code_describes():
    text = files("ransac_fix.report").joinpath("schemas/explanation.json").read_text()
    assert json.loads(text) == json.loads(
        msgspec.json.encode(msgspec.json.schema(ExplanationDocument))
    )


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--n", "55", "--inlier-ratio", "0.3", "--k", "5"], "not a whole number of inliers"),
        (["--n", "55", "--inlier-ratio", "0.3", "--k", "5"], "say --inliers 16 or 17"),
        (["--n", "50", "--k", "5"], "either --inliers or --inlier-ratio"),
        (["--n", "50", "--inliers", "5", "--inlier-ratio", "0.1", "--k", "5"], "either"),
        (["--n", "50", "--inliers", "60", "--k", "5"], "--inliers 60 is more than --n 50"),
        (["--n", "4", "--inliers", "4", "--k", "5"], "--k 5 is more than --n 4"),
        (["--inliers", "4", "--k", "5"], "give --n and --k"),
        (["--n", "9", "--stratum", "3/9:2"], "--stratum replaces"),
        (["--stratum", "9/3:2"], "impossible"),
        (["--stratum", "nonsense"], "INLIERS/MEASUREMENTS:DRAWN"),
        ([*EXAMPLE, "--confidence", "1.5"], "not a number from 0 to 1"),
        ([*EXAMPLE, "--confidence", "1e-999999999"], "not a number from 0 to 1"),
        ([*EXAMPLE, "--sweep", "k"], "sweep over n or p"),
        ([*EXAMPLE, "--sweep", "n=1:2"], "FROM:TO:STEP"),
        ([*EXAMPLE, "--sweep", "n=10:1:1"], "TO not below FROM"),
        ([*EXAMPLE, "--sweep", "n=10,15"], "--sweep: 0.3 of 15"),
        ([*EXAMPLE, "--sweep", "p=0.31"], "FROM:TO:STEP leaves such values out"),
        ([*EXAMPLE, "--sweep", "n=11:19:4"], "left out"),
        ([*EXAMPLE, "--sweep", "n=2,10"], "whole number from k = 5"),
        ([*EXAMPLE, "--sweep", "n=1:1e9:1"], "at most 1000"),
        ([*EXAMPLE, "--sweep", "p=2"], "every ratio is from 0 to 1"),
        (["--n", "9", "--inliers", "0", "--k", "2", "--sweep", "n"], "at least one inlier"),
    ],
)
def test_bad_input_is_one_clear_error(args, message):
    assert message in run(*args, code=2)


def test_a_range_leaves_out_what_does_not_fit_and_says_so():
    result = CliRunner().invoke(command, [*EXAMPLE, "--sweep", "n=10:40:15"])
    assert "left out, p n is not whole: n = 25" in result.stderr
    assert result.exit_code == 0


@pytest.mark.parametrize("suffix", [".svg", ".pdf", ".png"])
def test_plot_writes_the_same_file_every_time(tmp_path, suffix):
    paths = [tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"]
    for path in paths:
        run(*EXAMPLE, "--sweep", "p", "--plot", str(path))
    first, second = (path.read_bytes() for path in paths)
    assert len(first) > 5000
    assert first == second


def test_a_plot_shows_the_floor_and_the_cap(tmp_path):
    limits = {"plain": [], "cap": ["--max-trials", "1000"], "floor": ["--min-trials", "1000"]}
    drawn = set()
    for name, options in limits.items():
        path = tmp_path / f"{name}.svg"
        run(*EXAMPLE, *options, "--plot", str(path))
        drawn.add(path.read_bytes())
    assert len(drawn) == 3


@pytest.mark.parametrize(
    ("name", "message"), [("x.gif", ".svg, .pdf, .png"), ("no/such/x.svg", "does not exist")]
)
def test_a_plot_that_cannot_be_written_is_said_before_anything_is_computed(tmp_path, name, message):
    done = subprocess.run(
        [sys.executable, "-m", "ransac_fix", "explain", *EXAMPLE, "--plot", str(tmp_path / name)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr


def test_explain_needs_no_numpy():
    code = (
        "import sys; sys.modules['numpy'] = None; sys.modules['matplotlib'] = None\n"
        "from ransac_fix.cli import main\n"
        f"main({['explain', *EXAMPLE, '--sweep', 'n']!r})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "3,247" in done.stdout


def test_plot_without_matplotlib_names_the_extra(tmp_path):
    args = ["explain", *EXAMPLE, "--plot", str(tmp_path / "x.svg")]
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        f"from ransac_fix.cli import main; main({args!r})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "ransac-fix[plot]" in done.stderr


def test_numbers_are_not_rounded_into_others():
    assert count_text(None) == "never"
    assert count_text(1234567) == "1,234,567"
    assert count_text(10**20) == "1.000e20"
    assert percent_text(0.0048, signed=True) == "+0.48 %"
    assert percent_text(None) == "infinite"
    assert probability_text(1 - 1e-9) == "1 - 1e-09"
    assert probability_text(0.000123468) == "0.0001235"


def test_certainty_is_said_to_be_out_of_reach():
    text = run("--n", "50", "--inliers", "15", "--k", "5", "--confidence", "1")
    assert "at s = 1 neither rule ever stops" in text
    assert "the same trials" not in text
