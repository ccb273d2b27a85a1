"""`trace --verify`: which calls are kept, what becomes of them, and what is said of it."""

import collections
import json
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

import ransac_fix
from ransac_fix.errors import RansacFixError
from ransac_fix.patching import samples, verification
from ransac_fix.patching.calls import Key, Record
from ransac_fix.patching.samples import Samples, Unkept, packed
from ransac_fix.report.trace_json import trace_json

RunPython = Callable[..., subprocess.CompletedProcess[str]]

KEY: Key = "opencv", "findHomography", "program.py", 3, "<module>"
SHORT = Record("read", 0.1, short=True, trials=5, needed=9, max_trials=100)

PROGRAM = """
import cv2, numpy as np
def work(seed):
    rng = np.random.default_rng(seed)
    n, inliers = 24, 7
    x, y = rng.uniform(0, 1000, (2, n, 2))
    y[:inliers] = x[:inliers] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    y[inliers : 2 * inliers + 1] = x[inliers : 2 * inliers + 1] @ [[1, 0.2], [-0.2, 1]] - 9
    return int(cv2.findHomography(x, y, cv2.RANSAC, 1.0, None, 100_000, 0.5)[1].sum())
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob(f"*{samples.SUFFIX}"))


def test_every_telling_call_is_as_likely_to_be_kept(tmp_path: Path) -> None:
    times: collections.Counter[int] = collections.Counter()
    for _ in range(100):
        kept_here = Samples(str(tmp_path), "p", 5)
        for number in range(20):
            telling = number % 2 == 0
            record = SHORT if telling else Record("read", 0.1, short=False, max_trials=9)
            kept_here.keep(kept_here.draw((number,), {}), KEY, record)
        found = [pickle.loads(samples.kept(tmp_path / name)[1])[0][0] for name in names(tmp_path)]
        assert len(set(found)) == 5
        times.update(found)
    assert set(times) == set(range(0, 20, 2))
    # 50 each, with a standard deviation of 5.
    assert all(25 < count < 75 for count in times.values())


def test_samples_of_processes_make_one(tmp_path: Path) -> None:
    for name, count in (("big", 900), ("small", 100), ("none", 0)):
        kept_here = Samples(str(tmp_path), name, 100)
        for number in range(count):
            kept_here.keep(kept_here.draw((number,), {}), KEY, SHORT)
    drawn = verification._drawn(str(tmp_path), {"big": 900, "small": 100, "none": 0}, 100)
    assert len(drawn) == len(set(drawn)) == 100
    assert 75 <= sum(path.name.startswith("big") for path in drawn) <= 99
    everything = verification._drawn(str(tmp_path), {"big": 900, "small": 100}, 1000)
    assert len(everything) == 200


@given(st.integers(0, 60), st.integers(1, 60), st.sampled_from([0.9, 0.95, 0.99]))
def test_the_interval_is_that_of_scipy(successes: int, runs: int, level: float) -> None:
    successes = min(successes, runs)
    expected = binomtest(successes, runs).proportion_ci(level, method="exact")
    assert verification.interval(successes, runs, level) == pytest.approx(tuple(expected))


def test_inputs_are_copied_before_the_call_changes_them(tmp_path: Path) -> None:
    kept_here = Samples(str(tmp_path), "p", 1)
    array = np.zeros(3)
    drawn = kept_here.draw((array,), {})
    array += 1
    kept_here.keep(drawn, KEY, SHORT)
    head, inputs = samples.kept(tmp_path / names(tmp_path)[0])
    np.testing.assert_array_equal(pickle.loads(inputs)[0][0], np.zeros(3))
    assert head["key"] == list(KEY)


def test_objects_of_compiled_libraries_are_copied() -> None:
    params = cv2.UsacParams()
    params.maxIterations, params.threshold = 77, 2.5
    again = pickle.loads(packed(params))
    assert (again.maxIterations, again.threshold) == (77, 2.5)


def test_what_cannot_be_copied_says_why(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(Unkept, match="cannot be copied"):
        packed(threading.Lock())
    monkeypatch.setattr(samples, "_LARGEST", 1000)
    with pytest.raises(Unkept, match="inputs take more than"):
        packed(np.zeros(1000))
    monkeypatch.undo()
    monkeypatch.setattr(samples, "_LARGEST_TOGETHER", 20_000)
    kept_here = Samples(str(tmp_path), "p", 10)
    for _ in range(10):
        kept_here.keep(kept_here.draw((np.zeros(1000),), {}), KEY, SHORT)
    assert sum((tmp_path / name).stat().st_size for name in names(tmp_path)) < 100_000
    verified = verification.verify(str(tmp_path), {"p": 10}, 10)
    reasons = verified.not_replayed
    assert sum(count for why, count in reasons.items() if why.startswith("one process keeps")) == 8


def test_a_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RANSAC_FIX_SLACK", "0.5")
    scope: dict[str, Any] = {}
    exec(PROGRAM, scope)
    bare = [scope["work"](seed) for seed in range(25)]
    state = np.random.get_state()[1]  # noqa: NPY002 -- that of the program
    with ransac_fix.trace(verify=15) as t:
        traced = [scope["work"](seed) for seed in range(25)]
    assert traced == bare
    np.testing.assert_array_equal(state, np.random.get_state()[1])  # noqa: NPY002
    found = t.report.verification
    assert found is not None
    assert (found.asked, found.telling, found.replayed) == (15, 25, 15)
    assert found.not_replayed == {}
    # With 7 in hand and s = 0.5 the rule stops at a third of the trials: many miss the 8.
    assert 2 <= found.missed <= 14
    assert found.low is not None
    assert found.high is not None
    assert found.low < found.missed / 15 < found.high
    (site,) = t.report.sites
    assert (site.replayed, site.missed) == (15, found.missed)


def test_the_command_and_worker_processes(run_python: RunPython, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(f"""{PROGRAM}
import multiprocessing
from skimage.measure import ransac
class Middle:  # by value: this file is not run again
    def estimate(self, data):
        self.value = data.mean()
        return True
    def residuals(self, data):
        return np.abs(data.ravel() - self.value)
    @classmethod
    def from_estimate(cls, data):
        model = cls()
        model.estimate(data)
        return model
if __name__ == "__main__":
    print("run", flush=True)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        pool.map(work, range(20))
    data = np.concatenate([np.zeros(6), np.arange(5, 30)])[:, None]
    for _ in range(4):
        ransac(data, Middle, 2, 0.5, max_trials=1000, stop_probability=0.9)
    ransac(data, Middle, 2, 0.5, max_trials=1000, stop_probability=0.9,
           is_model_valid=lambda model, *data, lock=__import__("threading").Lock(): True)
""")
    file = tmp_path / "report.json"
    done = run_python(
        *("-m", "ransac_fix", "trace", "--verify", "--json", file, tmp_path / "program.py")
    )
    assert done.stdout == "run\n", done.stderr
    report = json.loads(file.read_text())
    found = report["verification"]
    assert found["telling"] == 25
    assert found["replayed"] == 24
    assert found["missed"] > 0
    ((why, count),) = found["not_replayed"].items()
    assert "cannot be copied" in why
    assert count == 1
    replayed = [(site["system"], site["replayed"]) for site in report["sites"]]
    assert sorted(replayed) == [("opencv", 20), ("scikit-image", 0), ("scikit-image", 4)]


def test_a_call_that_crashes_or_hangs_when_it_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verification, "_LONGEST_CALL", 3.0)
    points = np.random.default_rng(0).uniform(0, 1000, (2, 30, 2))
    arguments = (*points, cv2.RANSAC, 1.0, None, 5000, 0.5)
    kept_here = Samples(str(tmp_path), "p", 10)
    for inputs in (arguments, (_Crash(),), (_Hang(),), (1, 2), arguments):
        kept_here.keep(kept_here.draw(inputs, {}), KEY, SHORT)
    verified = verification.verify(str(tmp_path), {"p": 5}, 10)
    assert sum(verified.replayed.values()) == 2
    reasons = " ".join(sorted(verified.not_replayed))
    assert sum(verified.not_replayed.values()) == 3
    for part in ("crashed", "more than 3 s", "the call failed when it was made again"):
        assert part in reasons


class _Crash:
    def __reduce__(self) -> Any:
        return os._exit, (9,)


class _Hang:
    def __reduce__(self) -> Any:
        import time

        return time.sleep, (60,)


def test_nothing_stopped_short_and_bad_arguments() -> None:
    with ransac_fix.trace(verify=5) as t:
        pass
    found = t.report.verification
    assert found is not None
    assert (found.telling, found.replayed, found.rate) == (0, 0, None)
    with ransac_fix.trace() as t:
        pass
    assert t.report.verification is None
    with pytest.raises(RansacFixError, match="verify must be a number of calls"):
        ransac_fix.trace(verify=-1)
    schema = json.loads(
        Path(sys.modules["ransac_fix.report"].__path__[0], "schemas", "trace.json").read_text()
    )
    jsonschema.validate(json.loads(trace_json(t.report)), schema)
