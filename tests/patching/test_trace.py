"""`ransac_fix.trace`: what is recorded, where, and that nothing is done differently."""

import json
import math
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
import skimage.measure
from hypothesis import given
from hypothesis import strategies as st
from skimage.transform import AffineTransform
from sklearn.linear_model import RANSACRegressor

import ransac_fix
from ransac_fix.criterion import approximate_required_trials, required_trials, success_probability
from ransac_fix.patching import recorder as recorder_module
from ransac_fix.patching.calls import (
    Raw,
    Record,
    Spread,
    Tally,
    described,
    judge,
    packed,
    unpacked,
)
from ransac_fix.patching.recorder import Recorder, merge
from ransac_fix.patching.summary import CallSite, TraceReport

if TYPE_CHECKING:
    from collections.abc import Callable

N, INLIERS = 60, 25


def planted(seed: int = 0) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 1000, (2, N, 2))
    y[:INLIERS] = x[:INLIERS] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
    return x, y


def homography(confidence: float = 0.99, limit: int = 100_000) -> Any:
    x, y = planted()
    return cv2.findHomography(x, y, cv2.RANSAC, 1.0, maxIters=limit, confidence=confidence)


def only_site(report: TraceReport) -> CallSite:
    (site,) = report.sites
    return site


def test_one_call_of_opencv() -> None:
    with ransac_fix.trace() as t:
        _, mask = homography()
    site = only_site(t.report)
    here = (site.system, site.function, site.file, site.caller)
    assert here == ("opencv", "findHomography", __file__, "homography")
    assert "cv2.findHomography" in Path(site.file).read_text().splitlines()[site.line - 1]
    worst = site.worst
    assert worst is not None
    n_inliers = int(mask.sum())
    assert (worst.n_inliers, worst.n_samples, worst.sample_size) == (n_inliers, N, 4)
    ran = approximate_required_trials(n_inliers, N, 4, 0.99)
    assert worst.trials == pytest.approx(ran, abs=1)
    assert worst.needed == required_trials(n_inliers, N, 4, 0.99) > worst.trials
    assert worst.success == success_probability(int(worst.trials), n_inliers, N, 4) < 0.99
    assert worst.bound == "rule"
    assert (site.calls, site.short, site.trials_are, site.unread) == (1, 1, "at least", 0)
    assert site.extra_trials == worst.needed - worst.trials
    assert "ransac_fix.patch('opencv')" in site.remedy
    assert "raise the limit" not in site.remedy


def test_a_cap() -> None:
    with ransac_fix.trace() as t:
        homography(limit=40)
    site = only_site(t.report)
    assert site.worst is not None
    assert (site.worst.bound, site.worst.trials, site.short_by_cap) == ("cap", 40, 1)
    assert f"raise the limit on trials to {site.worst.needed:.0f}" in site.remedy
    assert "patch" not in site.remedy
    assert site.extra_trials == 0


def test_scikit_learn_counts_its_trials() -> None:
    x, y = planted()
    with ransac_fix.trace() as t:
        fitted = RANSACRegressor(residual_threshold=1.0, random_state=0, max_trials=5000)
        fitted.fit(x, y)
    site = only_site(t.report)
    assert (site.system, site.function) == ("scikit-learn", "RANSACRegressor.fit")
    assert site.trials is not None
    assert site.sample_size is not None
    assert (site.trials.high, site.trials_are) == (fitted.n_trials_, "counted")
    assert site.sample_size.high == 3


def test_a_user_who_asks_for_another_end_is_not_judged() -> None:
    x, y = planted()
    with ransac_fix.trace() as t:
        RANSACRegressor(residual_threshold=1.0, random_state=0, stop_n_inliers=4).fit(x, y)
        skimage.measure.ransac((x, y), AffineTransform, 3, 1.0, stop_sample_num=4, rng=0)
    assert [site.unread for site in t.report.sites] == [1, 1]


def test_scikit_image_through_an_imported_name() -> None:
    x, y = planted()
    with ransac_fix.trace() as t:
        _, inliers = skimage.measure.ransac(
            (x, y), AffineTransform, 3, 1.0, max_trials=2000, stop_probability=0.9, rng=0
        )
    site = only_site(t.report)
    assert (site.system, site.function, site.caller) == (
        "scikit-image",
        "ransac",
        "test_scikit_image_through_an_imported_name",
    )
    assert site.n_inliers is not None
    assert site.trials is not None
    assert site.n_inliers.high == inliers.sum()
    ran = approximate_required_trials(int(inliers.sum()), N, 3, 0.9)
    assert site.trials.high == pytest.approx(ran, abs=1)


def test_an_exact_library_is_not_short() -> None:
    pycolmap = pytest.importorskip("pycolmap", minversion="3.12")
    x, y = planted()
    options = pycolmap.RANSACOptions()
    options.min_num_trials, options.dyn_num_trials_multiplier, options.confidence = 0, 1.0, 0.99
    options.max_error = 1.0
    with ransac_fix.trace() as t:
        found = pycolmap.estimate_homography_matrix(x, y, options)
    site = only_site(t.report)
    assert found["num_inliers"] == site.n_inliers.high
    assert (site.short, site.bounds.rule, site.remedy) == (0, 1, "")
    assert site.trials == site.needed


def test_other_methods_are_counted_and_not_judged() -> None:
    x, y = planted()
    with ransac_fix.trace() as t:
        cv2.findHomography(x, y, 0)
        cv2.findHomography(x, y, cv2.LMEDS)
    assert (t.report.calls, t.report.unread, t.report.short) == (2, 2, 0)


def test_what_raises_still_raises_and_is_counted() -> None:
    with ransac_fix.trace() as t, pytest.raises(cv2.error):
        cv2.findHomography(np.zeros((2, 2)), np.zeros((2, 2)), cv2.RANSAC, 1.0)
    assert (t.report.calls, t.report.failed) == (1, 1)


@pytest.mark.parametrize("patched", [False, True])
def test_results_are_those_without_a_trace(patched: bool) -> None:
    x, y = planted()

    def run() -> list[Any]:
        ours = RANSACRegressor(residual_threshold=1.0, random_state=0, max_trials=5000).fit(x, y)
        image, inliers = skimage.measure.ransac((x, y), AffineTransform, 3, 1.0, rng=0)
        return [*homography(), ours.inlier_mask_, ours.n_trials_, image.params, inliers]

    def runs() -> list[Any]:
        if not patched:
            return run()
        with ransac_fix.patched("opencv", "scikit-learn", "scikit-image"):
            return run()

    before = runs()
    with ransac_fix.trace():
        during = runs()
    for a, b, c in zip(before, during, runs(), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)


def test_everything_is_put_back() -> None:
    def functions() -> list[Any]:
        return [
            cv2.findHomography,
            skimage.measure.ransac,
            RANSACRegressor.fit,
            dict(os.environ),
        ]

    before = functions()
    with ransac_fix.trace():
        assert cv2.findHomography is not before[0]
        assert cv2.findHomography.__doc__ == before[0].__doc__
    assert functions() == before
    with ransac_fix.trace():
        ransac_fix.patch("opencv")
    ransac_fix.unpatch("opencv")
    x, y = planted()
    assert cv2.findHomography(x, y, cv2.RANSAC, 1.0)[1].sum() == homography()[1].sum()
    with ransac_fix.trace() as t:
        homography()
    assert t.report.calls == 1


def test_patched_calls_are_traced_whenever_they_are_patched() -> None:
    slack = 0.0
    from ransac_fix.patching import missing

    known = missing.slack()
    try:
        with ransac_fix.trace() as t:
            ransac_fix.patch("opencv", slack=slack)
            homography()
            ransac_fix.unpatch("opencv")
        assert only_site(t.report).patched == 1
        assert only_site(t.report).short == 0
        assert only_site(t.report).trials == only_site(t.report).needed
        ransac_fix.patch("opencv")
        with ransac_fix.trace() as t:
            homography()
            ransac_fix.unpatch("opencv")
            homography()
        assert (only_site(t.report).patched, only_site(t.report).short) == (1, 1)
    finally:
        ransac_fix.unpatch("opencv")
        missing.set_slack(known)
        os.environ.pop(missing.SLACK_VARIABLE, None)


def test_threads() -> None:
    with ransac_fix.trace() as t:
        threads = [
            threading.Thread(target=lambda: [homography() for _ in range(25)]) for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert t.report.calls == only_site(t.report).calls == 100
    assert t.report.short == 100


def test_a_second_trace_is_refused() -> None:
    with ransac_fix.trace() as t:
        with pytest.raises(ransac_fix.RansacFixError, match="under way"), ransac_fix.trace():
            pass
        with pytest.raises(ransac_fix.RansacFixError, match="ended"):
            _ = t.report
        homography()
    assert t.report.calls == 1
    assert "1 RANSAC call at 1 call site: 1 stopped short" in str(t.report)


def test_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RANSAC_FIX", "0")
    with pytest.raises(ransac_fix.RansacFixError, match="RANSAC_FIX=0"), ransac_fix.trace():
        pass


def _record(trials: float = 10, **changes: Any) -> Record:
    settings = {
        "outcome": "read",
        "seconds": 0.5,
        "short": True,
        "n_inliers": 5,
        "n_samples": 20,
        "sample_size": 3,
        "confidence": 0.9,
        "max_trials": 100.0,
        "needed": 50.0,
        "success": 0.2,
        "bound": "rule",
    }
    return Record(**{**settings, "trials": trials, **changes})


def _raw(trials: float = 10) -> Raw:
    facts = (5, 20, 3, 0.9, float(trials), 100.0, "distinct", None)
    return facts, 0.5, False, False, 0.0  # type: ignore[return-value]


@given(
    st.none()
    | st.tuples(
        st.integers(0, 10**6),
        st.integers(1, 10**6),
        st.integers(1, 10),
        st.floats(0, 1),
        st.none() | st.floats(0, allow_infinity=True),
        st.floats(0, allow_infinity=True),
        st.sampled_from(["distinct", "replacement"]),
        st.none() | st.floats(0, 1),
    ),
    st.floats(0, 1e6),
    st.booleans(),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_a_call_is_read_as_it_was_written(
    facts: Any, seconds: float, patched: bool, failed: bool, site: int
) -> None:
    raw = facts, seconds, patched, failed, 0.1
    assert unpacked(b"head" + packed(site, raw), 4) == (site, raw)


def test_numpy_numbers_are_numbers() -> None:
    facts = (np.int64(5), np.int32(20), 3.0, np.float32(0.5), np.int64(9), np.float64(100))
    raw: Any = ((*facts, "distinct", np.float64(0.25)), 0.5, False, False, 0.0)
    record = described(unpacked(packed(0, raw), 0)[1], False)
    assert record == described(raw, False)
    assert json.loads(json.dumps(record))[4:10] == [5, 20, 3, 0.5, 9, 100]


@pytest.mark.parametrize(
    ("exact", "patched", "trials"), [(False, False, 49), (True, False, 56), (False, True, 56)]
)
def test_trials_that_were_not_counted_are_what_the_rule_asks_for(
    exact: bool, patched: bool, trials: int
) -> None:
    facts: Any = (6, 20, 2, 0.99, None, 1000, "distinct", None)
    assert described((facts, 0.5, patched, False, 0.0), exact).trials == trials
    capped = described(((*facts[:5], 30, *facts[6:]), 0.5, patched, False, 0.0), exact)
    assert (capped.trials, capped.bound) == (30, "cap")


def test_many_calls_take_no_more_memory_than_few() -> None:
    tally = Tally()
    rng = np.random.default_rng(0)
    for value in rng.lognormal(8, 3, 50_000):
        tally.add([_record(float(value), seconds=float(value) * 1e-6)])
    assert len(tally.to_data()["spreads"]["trials"]["buckets"]) < 2_500
    assert tally.calls == tally.short == 50_000


@given(st.lists(st.floats(0, 1e12), min_size=1, max_size=60))
def test_the_median_is_within_a_percent(values: list[float]) -> None:
    spread = Spread()
    for value in values:
        spread.add([value])
    exact = sorted(values)[(len(values) - 1) // 2]
    assert spread.median == pytest.approx(exact, rel=0.0101, abs=0)
    assert (spread.low, spread.high, spread.count) == (min(values), max(values), len(values))


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 60)), max_size=30))
def test_parts_add_up_to_the_whole(calls: list[tuple[bool, int]]) -> None:
    whole, parts = Tally(), (Tally(), Tally())
    for which, trials in calls:
        record = _record(trials, success=trials / 100, short=trials < 50)
        whole.add([record])
        parts[which].add([record])
    first, second = (Tally.from_data(json.loads(json.dumps(part.to_data()))) for part in parts)
    first.merge(second)
    assert (first.calls, first.short, first.rule) == (whole.calls, whole.short, whole.rule)
    assert first.extra_trials == pytest.approx(whole.extra_trials)
    assert first.spreads["trials"].buckets == whole.spreads["trials"].buckets
    assert (first.worst and first.worst.success) == (whole.worst and whole.worst.success)


def test_what_a_killed_process_wrote_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "_LONGEST", 2_000)
    writer = Recorder(str(tmp_path), write=True)
    key = ("opencv", "findHomography", "a.py", 3, "main")
    for trials in range(1, 101):
        writer.add(key, _raw(trials))
    writer.leave_out("acme", "no reason")
    (entries,) = tmp_path.glob("*.entries")
    written = entries.read_bytes().rindex(b'"no reason"]') + len(b'"no reason"]')
    with entries.open("r+b") as file:
        file.seek(written + 1)  # without the first byte: cut off
        file.write(packed(0, _raw()))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 20_000
    reader = Recorder(str(tmp_path), write=False)
    assert set(merge(reader)) == {reader.name, writer.name}
    assert reader.tallies[key].calls == 100
    assert reader.tallies[key].spreads["trials"].total == sum(range(1, 101))
    assert reader.left_out == {"acme": "no reason"}


def test_a_folder_that_is_gone_ends_the_writing(tmp_path: Path) -> None:
    writer = Recorder(str(tmp_path / "gone"), write=True)
    for _ in range(3):
        writer.add(("opencv", "f", "a.py", 3, "main"), _raw())
    writer.flush()
    assert writer.tallies["opencv", "f", "a.py", 3, "main"].calls == 3


@pytest.mark.parametrize(
    ("trials", "limit", "bound"),
    [(49, 1000, "rule"), (56, 1000, "rule"), (30, 30, "cap"), (1000, 5000, "floor")],
)
def test_what_bound_a_run(trials: int, limit: int, bound: str) -> None:
    judged = judge(6, 20, 2, 0.99, trials, limit, "distinct", None, False)
    assert (judged.bound, judged.needed) == (bound, 56)


def test_judging_at_the_edges() -> None:
    assert judge(1, 20, 2, 0.99, 1, 1, "distinct", None, False).n_inliers == 2
    assert judge(6, 20, 2, 1.0, 100, 100, "distinct", None, False).needed == math.inf
    assert judge(6, 20, 2, 0.99, 49, math.inf, "distinct", None, True).trials == 56
    chance = judge(6, 20, 2, 0.99, 10, 100, "distinct", 0.5, False)
    assert (chance.needed, chance.success) == (7, pytest.approx(1 - 2**-10))


def test_memory_of_call_sites_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "_MOST_SITES", 3)
    one = Recorder(str(tmp_path), write=False)
    make: Callable[[int], tuple[str, str, str, int, str]] = lambda i: ("a", "f", "x.py", i, "m")  # noqa: E731
    for i in range(10):
        one.add(make(i), _raw())
    one.flush()
    assert len(one.tallies) == 4
    assert one.tallies["a", "f", "(further call sites)", 0, ""].calls == 7
