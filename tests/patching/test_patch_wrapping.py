"""The wrappers that several libraries share, around stand-ins for the library that count."""

from collections.abc import Callable
from typing import Any

import pytest

from ransac_fix import approximate_required_trials, required_trials
from ransac_fix.patching import missing
from ransac_fix.patching.missing import Spare
from ransac_fix.patching.wrapping import floored, seeded

N, K = 20, 4
NAMES = ("points", "conf", "max_iters", "seed")
DEFAULTS = {"conf": 0.99, "max_iters": 100_000, "seed": None}
Run = dict[str, Any]


@pytest.fixture(autouse=True)
def exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "_slack", 0.0)


def seeded_library(inliers: list[int], runs: list[Run]) -> Callable[..., Any]:
    """Return a function whose runs find so many inliers each, and stop by the approximate rule."""

    def find(points: Any, conf: float = 0.99, max_iters: int = 100_000, seed: Any = None) -> Any:
        found = inliers[len(runs)]
        trials = min(approximate_required_trials(found, len(points), K, conf), max_iters)
        runs.append({"conf": conf, "max_iters": max_iters, "seed": seed, "trials": trials})
        return len(runs), found, trials

    return find


def wrap_seeded(
    inliers: list[int], runs: list[Run], spare: Spare | None = None
) -> Callable[..., Any]:
    return seeded(
        seeded_library(inliers, runs),
        NAMES,
        DEFAULTS,
        K,
        points="points",
        confidence="conf",
        read=lambda result, *_: result[1:],
        spare=spare,
    )


@pytest.mark.parametrize(("later", "kept"), [(7, 1), (8, 1), (9, 2)])
def test_a_seeded_function_runs_what_is_missing_and_keeps_more_inliers(
    later: int, kept: int
) -> None:
    runs: list[Run] = []
    result = wrap_seeded([8, later], runs)([0] * N, 0.99, seed=5)
    assert result[0] == kept
    assert sum(run["trials"] for run in runs) == required_trials(8, N, K, 0.99)
    assert (runs[1]["conf"], runs[1]["seed"]) == (1.0, missing.fresh_seed(5, 1))


@pytest.mark.parametrize("seed", [None, -1])
def test_without_a_seed_the_second_run_has_one_of_its_own(seed: int | None) -> None:
    found = set()
    for _ in range(3):
        runs: list[Run] = []
        wrap_seeded([8, 8], runs)([0] * N, seed=seed)
        assert runs[0]["seed"] == seed
        found.add(runs[1]["seed"])
    assert len(found) > 1  # all three the same by chance: once in 2**48


def test_a_seeded_function_asks_for_more_at_once() -> None:
    runs: list[Run] = []
    wrap_seeded([15], runs, spare=Spare(10, 0.0))([0] * N)
    assert len(runs) == 1
    assert runs[0]["conf"] > 0.99
    assert runs[0]["trials"] >= required_trials(15, N, K, 0.99)


def test_limits_and_mistakes_of_the_caller_are_the_librarys_affair() -> None:
    runs: list[Run] = []
    exact = wrap_seeded([8] * 5, runs)
    exact([0] * N, 0.99, 150)
    assert [run["trials"] for run in runs] == [150]
    exact([0] * N, 0.99, 200)
    assert sum(run["trials"] for run in runs[1:]) == 200
    for args, kwargs in (((), {}), ((None,), {}), (([0] * N, "much"), {}), ((), {"pints": []})):
        with pytest.raises((TypeError, ValueError)):
            exact(*args, **kwargs)


def wrap_floored(inliers: list[int | None], runs: list[Run], ours: bool = True) -> Any:
    """Return the exact function of one whose model is the number of its run, or None."""

    def find(
        points: Any, conf: float = 0.99, min_iters: int = 5, max_iters: int = 100_000
    ) -> tuple[int | None, int]:
        found = inliers[len(runs)]
        runs.append({"conf": conf, "min_iters": min_iters, "max_iters": max_iters})
        return (None, K) if found is None else (len(runs), found)

    return floored(
        find,
        {"points": ..., "conf": 0.99, "min_iters": 5, "max_iters": 100_000},
        K,
        points="points",
        is_ours=lambda _: ours,
        count=lambda _, result: result[1],
        rule=approximate_required_trials,
        loss=lambda _, result: -result[1],
    )


@pytest.mark.parametrize(("later", "kept"), [(7, 1), (8, 1), (9, 2), (None, 1)])
def test_a_floored_function_is_asked_for_what_is_missing(later: int | None, kept: int) -> None:
    runs: list[Run] = []
    result = wrap_floored([8, later], runs)([0] * N)
    lacking = required_trials(8, N, K, 0.99) - approximate_required_trials(8, N, K, 0.99)
    assert result[0] == kept
    assert runs[1] == {"conf": 0.99, "min_iters": lacking, "max_iters": lacking}


def test_a_floor_counts_as_trials_run_and_other_samplers_are_left_alone() -> None:
    needed = int(required_trials(8, N, K, 0.99))
    for floor, expected in ((needed, 1), (needed - 3, 2)):
        runs: list[Run] = []
        wrap_floored([8, 8], runs)([0] * N, min_iters=floor)
        assert len(runs) == expected
    assert runs[1]["max_iters"] == 3
    runs.clear()
    wrap_floored([8], runs, ours=False)([0] * N)
    wrap_floored([None, 4], runs)([0] * K)
    assert len(runs) == 2


def test_a_model_found_later_is_better_than_none() -> None:
    runs: list[Run] = []
    result = wrap_floored([None, 6, 6], runs)([0] * N, 0.5, max_iters=100_000)
    assert result == (2, 6)
