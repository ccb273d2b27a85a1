"""A user's own RANSAC: right, wrong, and not one at all."""

import json
import math
import textwrap

import numpy as np
import pytest
from click.testing import CliRunner

from ransac_fix.audit.user import SAMPLE_SIZES, entry_point
from ransac_fix.audit.worker.planted import PROBLEMS
from ransac_fix.cli import probe
from ransac_fix.errors import RansacFixError
from ransac_fix.testing import assert_stopping_rule, measure_stopping_rule


def line_ransac(probability, report_trials=False, replace=False):
    """A RANSAC as people write it, stopping by the probability given."""

    def ransac(x, y, *, threshold, max_trials, confidence, seed):
        rng = np.random.default_rng(seed)
        x, y, n = x[:, 0], y[:, 0], len(x)
        best, needed, trials = np.zeros(n, dtype=bool), math.inf, 0
        while trials < min(needed, max_trials):
            trials += 1
            i, j = rng.choice(n, 2, replace=replace)
            if i == j:
                continue
            slope = (y[j] - y[i]) / (x[j] - x[i])
            inliers = np.abs(slope * (x - x[i]) + y[i] - y) < threshold
            if inliers.sum() > best.sum():
                best = inliers
                p = probability(int(inliers.sum()), n)
                needed = 1 if p >= 1 else math.ceil(math.log1p(-confidence) / math.log1p(-p))
        return (best, trials) if report_trials else best

    return ransac


def approximate(n_inliers, n):
    return (n_inliers / n) ** 2


def exact(n_inliers, n):
    return n_inliers * (n_inliers - 1) / (n * (n - 1))


@pytest.mark.parametrize("report_trials", [False, True])
def test_a_right_rule_passes(report_trials):
    assert_stopping_rule(line_ransac(exact, report_trials), problem="line")


@pytest.mark.parametrize("report_trials", [False, True])
def test_a_wrong_rule_fails_with_the_law_and_the_evidence(report_trials):
    with pytest.raises(AssertionError, match=r"undersamples by ceil.*\(I/n\)\^2") as failure:
        assert_stopping_rule(line_ransac(approximate, report_trials), problem="line")
    assert "draws 2 distinct indices" in str(failure.value)
    assert str(failure.value).count("in hand, trial") == 3


def test_the_exact_rule_for_distinct_indices_undersamples_with_replacement():
    found = measure_stopping_rule(line_ransac(exact, replace=True), problem="line")
    assert found.verdict == "undersamples"
    assert found.sampler_law.drawn == "replacement"


def test_another_verdict_can_be_expected():
    assert_stopping_rule(line_ransac(approximate), problem="line", expected="undersamples")


def test_a_function_without_a_number_of_trials_is_measured_by_outcomes():
    """With the ratio itself in place of its square few runs tell it from every other law."""
    ransac = line_ransac(lambda n_inliers, n: n_inliers / n)

    def without_budget(x, y, *, threshold, confidence, seed):
        return ransac(x, y, threshold=threshold, max_trials=3000, confidence=confidence, seed=seed)

    found = measure_stopping_rule(without_budget, problem="line")
    assert found.verdict == "undersamples"
    assert (found.stopping_law.assumed, found.stopping_law.sample_size) == ("approximate", 1)
    assert found.outcomes is not None
    assert found.points == ()


def unseeded(ransac):
    """A function that takes no seed, and draws as fresh as the clock."""
    fresh = np.random.default_rng(7)

    def without_seed(x, y, *, threshold, max_trials, confidence):
        return ransac(
            x,
            y,
            threshold=threshold,
            max_trials=max_trials,
            confidence=confidence,
            seed=int(fresh.integers(2**60)),
        )

    return without_seed


def test_a_function_without_a_seed_is_measured_by_its_trials():
    assert_stopping_rule(unseeded(line_ransac(exact, report_trials=True)), problem="line")


def test_a_function_without_a_seed_and_a_count_is_measured_by_outcomes():
    found = measure_stopping_rule(unseeded(line_ransac(lambda i, n: i / n)), problem="line")
    assert (found.stopping_law.assumed, found.stopping_law.sample_size) == ("approximate", 1)
    assert found.verdict == "undersamples"
    assert found.points == ()
    assert found.outcomes.error_rate == 1e-6


@pytest.mark.parametrize(("seeded", "repeatable"), [(True, True), (False, False)])
def test_whether_runs_can_be_repeated_is_seen_and_not_believed(seeded, repeatable):
    plain = line_ransac(exact)
    found = entry_point(plain if seeded else unseeded(plain), problem="line")
    assert (found.seeded, found.repeatable) == (seeded, repeatable)


def test_a_seed_that_has_no_effect_is_noticed():
    without = unseeded(line_ransac(exact))

    def ignores(x, y, *, seed, **options):
        return without(x, y, **options)

    assert not entry_point(ignores, problem="line").repeatable


def test_what_is_no_mask_is_refused():
    with pytest.raises(RansacFixError, match="must return a boolean mask"):
        measure_stopping_rule(lambda x, y, **_: 3, problem="line")


def test_an_unknown_problem_names_those_there_are():
    with pytest.raises(RansacFixError, match="unknown problem 'lines': use one of line, plane"):
        measure_stopping_rule(line_ransac(exact), problem="lines")


def test_every_problem_with_a_sample_size_is_planted():
    variants = ("_wide", "_scattered")
    assert set(SAMPLE_SIZES) == {name for name in PROBLEMS if not name.endswith(variants)}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of the user's in the current folder."""
    lines = "import math\nimport numpy as np\n\n"
    source = textwrap.dedent(
        """
        def always_all(x, y, *, threshold, max_trials, confidence, seed):
            rng = np.random.default_rng(seed)
            x, y, n, best, needed, trials = x[:, 0], y[:, 0], len(x), None, max_trials, 0
            while trials < min(needed, max_trials):
                trials += 1
                i, j = rng.choice(n, 2, replace=False)
                slope = (y[j] - y[i]) / (x[j] - x[i])
                inliers = np.abs(slope * (x - x[i]) + y[i] - y) < threshold
                if best is None or inliers.sum() > best.sum():
                    best, p = inliers, (inliers.sum() / n) ** 2
                    if p < 1:
                        needed = math.ceil(math.log1p(-confidence) / math.log1p(-p))
            return best


        def hangs(x, y, **_):
            import time

            time.sleep(3600)

        def raises(x, y, **_):
            raise KeyError("no")
        """
    )
    (tmp_path / "my_own_ransac.py").write_text(lines + source)
    monkeypatch.chdir(tmp_path)
    return "my_own_ransac"


def test_the_command_measures_a_function_of_this_folder(module):
    arguments = [f"{module}:always_all", "--problem", "line", "--output-format", "json"]
    run = CliRunner().invoke(probe.command, arguments)
    assert run.exit_code == 1, run.output
    (verdict,) = json.loads(run.stdout)["verdicts"]
    assert verdict["verdict"] == "undersamples"
    assert verdict["entry_point"] == f"{module}:always_all"


@pytest.mark.parametrize(
    ("target", "problem", "complaint"),
    [
        ("{}:raises", "line", "KeyError: 'no' (my_own_ransac.py, line "),
        ("{}:absent", "line", "my_own_ransac has no absent"),
        ("no_such_module_of_mine:f", "line", "No module named 'no_such_module_of_mine'"),
        ("{}:always_all", "lines", "unknown problem 'lines'"),
        ("{}:always_all", "lines", "similarity3d, affine3d"),  # to the end
    ],
)
def test_the_command_says_in_one_line_what_is_wrong(module, target, problem, complaint):
    run = CliRunner().invoke(probe.command, [target.format(module), "--problem", problem])
    assert isinstance(run.exception, RansacFixError)
    assert complaint in str(run.exception)
    assert "\n" not in str(run.exception)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"sample_size": 0}, "sample_size must be from 1 to 20, not 0"),
        ({"sample_size": 21}, "sample_size must be from 1 to 20, not 21"),
        ({"typical_trials": 0}, "typical_trials must be from 10 to 1000, not 0"),
    ],
)
def test_numbers_out_of_range_are_one_error(options, complaint):
    with pytest.raises(RansacFixError, match=complaint):
        measure_stopping_rule(line_ransac(exact), problem="line", **options)


def test_the_time_is_that_of_the_whole_measurement(module):
    run = CliRunner().invoke(probe.command, [f"{module}:hangs", "--problem", "line", "--timeout=1"])
    assert isinstance(run.exception, RansacFixError)
    assert "gave no answer within its time (1 s)" in str(run.exception)
