"""The stored verdicts: where they come from, and what is answered from them."""

import importlib.util
import sys
from pathlib import Path

import pytest

from ransac_fix import verdicts
from ransac_fix.systems import find_system
from ransac_fix.verdicts import (
    StoredVerdict,
    fixed_release,
    load_verdicts,
    nearest_releases,
    verdicts_for,
)

BUILD = Path(__file__).parent.parent / "docs" / "systems" / "build.py"


def build():
    spec = importlib.util.spec_from_file_location("systems_build", BUILD)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_table_and_the_pages_are_what_the_stored_results_make():
    script = build()
    results = script.stored_results()
    assert script.verdict_table(results) == script.VERDICTS.read_text("utf-8")
    for name, text in script.pages(results).items():
        assert (BUILD.parent / name).read_text("utf-8") == text
    for name, releases in results.items():
        assert (BUILD.parent / f"{name}.json").read_text("utf-8") == script.result_text(releases)
    made = {f"{name}.{kind}" for name in results for kind in ("json", "md")}
    assert {path.name for path in BUILD.parent.iterdir() if path.is_file()} == {
        *("build.py", "index.md"),
        *made,
    }


def test_a_report_is_stored_with_controls_or_without_a_verdict_to_prove():
    script = build()
    results = script.stored_results()
    release = results["kornia"][-1]
    unmeasured = {**release, "version": "9.9", "unmeasured": "has no wheel", "verdicts": []}
    again = script.merged(results, [{"controls": [], "releases": [unmeasured]}])
    assert again["kornia"] == [*results["kornia"], unmeasured]
    passed, failed = ({"name": "exact", "passed": passed} for passed in (True, False))
    assert script.merged(results, [{"controls": [passed], "releases": [release]}]) == results
    for controls in ([], [failed], [passed, failed]):
        with pytest.raises(SystemExit, match="controls not identified"):
            script.merged(results, [{"controls": controls, "releases": [release]}])


# What is known from elsewhere: upstream's history, and earlier measurements.
KNOWN = [
    ("pycolmap", "3.11.1", "estimate_homography_matrix", "undersamples", "(I/n)^4"),
    ("pycolmap", "3.12.0", "estimate_homography_matrix", "exact", "C(I,4)/C(n,4)"),
    ("pytheia", "0.2.5", "EstimateHomography", "undersamples", "(I/n)^4"),
    ("pytheia", "0.2.6", "EstimateHomography", "oversamples", "C(int(I/n*n),4)/C(n,4)"),
    ("pydegensac", "0.3.0", "findFundamentalMatrix", "undersamples", "C((I+1),7)/C(n,7)"),
    ("kornia", "0.8.2", "RANSAC(homography)", "undersamples", "(I/n)^4"),
    ("kornia", "0.8.3", "RANSAC(homography)", "oversamples", "C(I,4)/C(n,4)"),
    ("kornia", "0.9.0", "RANSAC(homography)", "exact", "C(I,4)/C(n,4)"),
    ("poselib", "2.0.5", "estimate_homography", "undersamples", "(I/n)^4"),
    ("scikit-image", "0.27.0rc1", "measure.ransac", "undersamples", "(I/n)^2"),
    ("scikit-image", "0.20.0", "measure.ransac", "undersamples", "(I/n)^2"),
    ("opencv-python", "4.8.0.76", "findHomography(RANSAC)", "undersamples", "(I/n)^4"),
    ("scikit-learn", "1.9.1", "RANSACRegressor", "undersamples", "(I/n)^2"),
]


@pytest.mark.parametrize(("distribution", "version", "entry_point", "verdict", "rule"), KNOWN)
def test_the_table_holds_what_is_known(distribution, version, entry_point, verdict, rule):
    (found,) = verdicts_for(distribution, version, entry_point)
    assert found.verdict == verdict
    assert rule in found.formula


@pytest.mark.parametrize(
    ("distribution", "version", "fixed"),
    [
        ("pycolmap", "3.11.1", "3.12.0"),
        ("kornia", "0.8.2", "0.9.0"),
        ("pytheia", "0.2.5", "0.2.6"),
        ("opencv-python", "4.8.0.76", None),
        ("poselib", "2.0.5", None),
    ],
)
def test_the_release_to_upgrade_to(distribution, version, fixed):
    assert fixed_release(distribution, version) == fixed


def test_every_stored_system_is_known_by_its_distribution():
    assert len(load_verdicts()) > 50
    for one in load_verdicts():
        assert find_system(one.distribution).name == one.system


@pytest.fixture
def planted(monkeypatch):
    """A history: two releases that undersample, one that runs too long, two exact ones."""

    def one(version, verdict, entry_point="vision.fit(RANSAC)", distribution="opencv-python"):
        return StoredVerdict(
            "opencv", distribution, version, entry_point, verdict, None, "2026-11-25"
        )

    table = (
        one("1.0", "undersamples"),
        one("1.2", "undersamples"),
        one("1.2", "exact", "vision.fit(USAC)"),
        one("1.2", "exact", "other"),
        one("1.9", "not measured"),
        one("1.10", "oversamples"),
        one("2.0", "exact"),
        one("2.1", "exact"),
        one("2.1", "not measured", "new"),
    )
    monkeypatch.setattr(verdicts, "load_verdicts", lambda: table)


def test_a_release_is_found_by_any_distribution_and_spelling(planted):
    assert len(verdicts_for("opencv-python", "1.2")) == 3
    assert verdicts_for("OpenCV_Contrib.Python", "1.2.0") == verdicts_for("opencv-python", "1.2")


@pytest.mark.parametrize("function", ["fit", "vision.fit", "cv2.vision.fit"])
def test_a_function_is_found_whatever_module_it_is_called_through(planted, function):
    found = verdicts_for("opencv-python", "1.2", function)
    assert [one.entry_point for one in found] == ["vision.fit(RANSAC)", "vision.fit(USAC)"]


def test_an_entry_point_is_found_by_its_whole_name(planted):
    (found,) = verdicts_for("opencv-python", "1.2", "vision.fit(USAC)")
    assert found.verdict == "exact"
    assert verdicts_for("opencv-python", "1.2", "fit(USAC)") == ()
    assert fixed_release("opencv-python", "1.0", "vision.fit(RANSAC)") == "2.0"


def test_without_a_release_all_are_answered(planted):
    assert len(verdicts_for("opencv-python", None)) == 9


@pytest.mark.parametrize(
    ("distribution", "version", "function"),
    [
        ("opencv-python", "1.1", None),
        ("opencv-python", "1.2", "fi"),
        ("opencv-python", "latest", None),
        ("opencv", "1.2", None),
        ("numpy", "1.2", None),
    ],
)
def test_what_was_not_measured_is_answered_by_nothing(planted, distribution, version, function):
    assert verdicts_for(distribution, version, function) == ()


def test_neighbours_of_a_release(planted):
    assert nearest_releases("opencv-python", "1.5") == ("1.2", "1.9")
    assert nearest_releases("opencv-python", "1.10") == ("1.9", "2.0")
    assert nearest_releases("opencv-python", "0.1") == (None, "1.0")
    assert nearest_releases("opencv-python", "3") == ("2.1", None)
    assert nearest_releases("opencv-python", "1.5", "other") == ("1.2", None)
    assert nearest_releases("opencv-python", "newest") == (None, None)
    assert nearest_releases("numpy", "1.5") == (None, None)


def test_the_release_to_upgrade_to_is_exact_where_one_is(planted):
    assert fixed_release("opencv-python", "1.0") == "2.0"
    assert fixed_release("opencv-python", "1.10") == "2.0"
    assert fixed_release("opencv-python", "2.0") is None
    assert fixed_release("opencv-python", "1.0", "missing") is None


def test_failing_that_it_is_one_that_no_longer_undersamples(planted, monkeypatch):
    table = load_verdicts_without_exact(verdicts.load_verdicts())
    monkeypatch.setattr(verdicts, "load_verdicts", lambda: table)
    assert fixed_release("opencv-python", "1.0") == "1.10"


def load_verdicts_without_exact(table):
    return tuple(one for one in table if one.verdict != "exact")


def test_a_newest_release_that_undersamples_is_no_upgrade(planted, monkeypatch):
    table = tuple(one for one in verdicts.load_verdicts() if one.version.startswith("1.2"))
    monkeypatch.setattr(verdicts, "load_verdicts", lambda: table)
    assert fixed_release("opencv-python", "1.0", "fit") is None
