"""Releases that are not installed: real environments of a small library."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
from small_releases import EXACT, LIBRARY, PROBE, write_releases

from ransac_fix.audit import proof, session
from ransac_fix.audit.controls import OUTCOME_CONTROLS, controls_for
from ransac_fix.audit.model import Control, OutcomeEvidence, Verdict
from ransac_fix.audit.releases import matrix, packages
from ransac_fix.audit.releases.folders import kept_folder, scratch_folder
from ransac_fix.audit.releases.matrix import (
    Asked,
    MatrixOptions,
    find_changes,
    measure_releases,
)
from ransac_fix.audit.releases.model import Change
from ransac_fix.audit.session import Options
from ransac_fix.errors import RansacFixError

CONTROL = Control("exact", "a; distinct", "a; distinct", True, 100)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The index is a folder, the library is known, and the controls are those of other tests."""
    folder = tmp_path_factory.mktemp("releases")
    write_releases(folder)
    probe = folder / "probe.py"
    probe.write_text(PROBE, "utf-8")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PIP_NO_INDEX", "1")
        patched.setenv("PIP_FIND_LINKS", str(folder))
        for module in (session, matrix):
            patched.setattr(module, "probe_files", lambda: {"small": probe})
        patched.setattr(proof, "measure_controls", lambda laws, seconds, **how: (CONTROL,))
        yield folder


def options(cache, **changed):
    return MatrixOptions(Options((), sys.executable), cache, **changed)


ASKED = Asked("small", "smallransac", ("0.9", "1.0", "1.1", "1.2", "1.3", "2.0", "3.0"))


@pytest.fixture(scope="module")
def measured(small, tmp_path_factory):
    cache = tmp_path_factory.mktemp("cache")
    return cache, measure_releases([ASKED], options(cache))


def test_each_release_is_measured_in_an_environment_of_its_own(measured):
    _, report = measured
    found = {one.version: one for one in report.releases}
    assert list(found) == ["0.9", "1.0", "1.1", "1.2", "1.3", "2.0", "3.0"]
    for version, assumed in (("1.0", "approximate"), ("1.1", "approximate"), ("2.0", "distinct")):
        (of_one,) = found[version].verdicts
        assert (of_one.version, of_one.stopping_law.assumed) == (version, assumed)
        assert found[version].wheel == f"smallransac-{version}-py3-none-any.whl"
        assert len(found[version].sha256) == 64
    assert found["2.0"].dependencies == ("numpy==2.2.0",)
    assert report.changes == (
        Change("smallransac", "fit_line", "1.1", "2.0", "undersamples", "exact"),
    )


def test_an_old_numpy_is_used_only_where_nothing_works_without_and_said(measured):
    _, report = measured
    found = {one.version: one for one in report.releases}
    assert found["1.0"].remark == found["2.0"].remark == ""
    assert found["1.1"].dependencies == ("numpy==1.26.0",)
    assert "numpy<2" in found["1.1"].remark
    assert "compiled for NumPy 1" in found["1.1"].remark


@pytest.mark.parametrize(
    ("version", "reason"),
    [
        ("0.9", "has no wheel for CPython 3"),
        ("1.2", "its dependency missing-package>=3 has no wheel"),
        ("1.3", "ModuleNotFoundError: No module named 'missing_module'"),
        ("3.0", "there is no such release"),
    ],
)
def test_what_cannot_be_had_says_why_in_one_line(measured, version, reason):
    _, report = measured
    (found,) = (one for one in report.releases if one.version == version)
    assert found.unmeasured.startswith(reason)
    assert found.verdicts == ()
    assert "\n" not in found.unmeasured


def test_entry_points_are_chosen_by_pattern(small):
    def audited(*patterns):
        chosen = Options((), sys.executable, entry_points=patterns)
        return session.audit_system("small", chosen, proof.Controls(chosen.seconds))

    with pytest.MonkeyPatch.context() as patched:
        # The library is found where the wheels are not unpacked: as it stands.
        patched.setenv("PYTHONPATH", str(small))
        (small / "smallransac.py").write_text(LIBRARY.format(guard="", probability=EXACT))
        assert [one.entry_point for one in audited("other", "fit_*")] == ["fit_line"]
        (none,) = audited("fit")
    assert (none.entry_point, none.verdict) == ("-", "not measured")
    assert none.reason == "the probe finds none of the entry points asked for in this release"


def test_environments_are_deleted_and_results_kept(measured, monkeypatch):
    cache, report = measured
    assert [path.name for path in cache.iterdir()] == ["releases"]
    assert len(list((cache / "releases").iterdir())) == 3

    def not_again(*_):
        raise AssertionError("measured twice")

    monkeypatch.setattr(matrix, "audit_system", not_again)
    asked = replace(ASKED, versions=("1.0", "1.1", "2.0"))
    again = measure_releases([asked], options(cache))
    assert again.releases == tuple(one for one in report.releases if one.verdicts)


def test_another_choice_is_another_result(measured, monkeypatch):
    cache, _ = measured
    asked = []

    def audited(*given):
        asked.append(given)
        return [Verdict("small", "fit_line", "2.0", "exact", "why", runs=1)]

    monkeypatch.setattr(matrix, "audit_system", audited)
    chosen = replace(options(cache), options=Options((), sys.executable, quick=True))
    measure_releases([replace(ASKED, versions=("2.0",))], chosen)
    assert len(asked) == 1


@pytest.mark.parametrize("search", [measure_releases, find_changes])
def test_verdicts_by_outcomes_are_proved_by_a_control_seen_so(small, monkeypatch, tmp_path, search):
    """Also where the verdict was kept from an earlier run."""
    evidence = OutcomeEvidence(3000, 1e-6, (), "law", (), None, -20.0)
    verdict = Verdict("small", "fit_line", "2.0", "exact", "why", runs=1, outcomes=evidence)
    monkeypatch.setattr(matrix, "audit_system", lambda *_: [verdict])
    asked = []

    def controls(laws, seconds, **how):
        asked.append(laws)
        by_outcomes = laws == OUTCOME_CONTROLS
        return (replace(CONTROL, name="by outcomes" if by_outcomes else "exact"),)

    monkeypatch.setattr(proof, "measure_controls", controls)
    for _ in range(2):
        report = search([replace(ASKED, versions=("2.0",))], options(tmp_path))
        assert [control.name for control in report.controls] == ["exact", "by outcomes"]
    assert asked == [controls_for("any"), OUTCOME_CONTROLS] * 2


KILLED = """
import os, signal, sys
from pathlib import Path
from ransac_fix.audit.releases.folders import kept_folder, scratch_folder
kept, cache = sys.argv[1] == "kept", Path(sys.argv[2])
with kept_folder(cache) if kept else scratch_folder(cache, "environments-") as folder:
    for path in ("shared/a.part/b", "half-1.0/incomplete", "whole-1.0/environment"):
        (folder / path).mkdir(parents=True)
    os.kill(os.getpid(), getattr(signal, sys.argv[3]))
"""


def run_and_kill(kind, folder, how):
    done = subprocess.run([sys.executable, "-c", KILLED, kind, str(folder), how])
    assert done.returncode == -getattr(signal, how)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
@pytest.mark.parametrize("how", ["SIGTERM", "SIGKILL"])
def test_what_a_killed_run_left_is_cleared_by_the_next(tmp_path, how):
    run_and_kill("scratch", tmp_path, how)
    (left,) = (path for path in tmp_path.iterdir() if path.is_dir())
    with scratch_folder(tmp_path, "environments-") as folder:
        assert not left.exists()
        # Nobody clears away what a living run uses.
        with scratch_folder(tmp_path, "environments-"):
            assert folder.exists()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_environments_that_are_kept_are_whole(tmp_path):
    run_and_kill("kept", tmp_path, "SIGTERM")
    assert (tmp_path / "half-1.0").exists()
    with kept_folder(tmp_path) as folder:
        assert sorted(path.name for path in folder.iterdir()) == [".lock", "shared", "whole-1.0"]
        assert list((folder / "shared").iterdir()) == []
        (folder / "new-1.0" / "incomplete").mkdir(parents=True)
        with kept_folder(tmp_path):
            assert (folder / "new-1.0").exists()


def test_an_environment_that_failed_is_not_kept(small, monkeypatch, tmp_path):
    def fail(*_):
        raise packages.Unavailable("no more room")

    monkeypatch.setattr(packages.Packages, "environment", fail)
    asked = replace(ASKED, versions=("2.0",))
    report = measure_releases([asked], options(tmp_path, keep_environments=True))
    assert report.releases[0].unmeasured == "no more room"
    assert not (tmp_path / "environments" / "smallransac-2.0").exists()


def test_environments_can_be_kept(measured, small, monkeypatch, tmp_path):
    monkeypatch.setattr(
        matrix, "audit_system", lambda *_: [Verdict("small", "fit_line", "2.0", "exact", "why")]
    )
    asked = replace(ASKED, versions=("2.0",))
    measure_releases([asked], options(tmp_path, keep_environments=True))
    kept = tmp_path / "environments" / "smallransac-2.0"
    assert sorted(path.name for path in kept.iterdir()) == ["environment", "release"]
    assert (kept / "release" / "smallransac.py").exists()
    assert list((tmp_path / "environments" / "shared").iterdir())


def test_releases_are_listed_without_pre_releases(small, tmp_path):
    found = packages.Packages(sys.executable)
    assert found.versions("smallransac") == ["1.0", "1.1", "1.2", "1.3", "2.0"]
    assert found.versions("smallransac", pre=True)[-1] == "2.1rc1"
    with pytest.raises(RansacFixError, match="the index has nothing for CPython 3"):
        found.versions("no-such-distribution")


def test_an_index_that_does_not_answer_is_not_an_empty_one(monkeypatch):
    monkeypatch.delenv("PIP_NO_INDEX", raising=False)
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_RETRIES", "1")
    with pytest.raises(RansacFixError, match="numpy: the index cannot be reached: "):
        packages.Packages(sys.executable).versions("numpy")


def test_a_range_without_releases_is_an_error(small, tmp_path):
    asked = replace(ASKED, versions=(), specifier=">3")
    with pytest.raises(RansacFixError, match=r"smallransac>3: the index has 1\.0 to 2\.0"):
        find_changes([asked], options(tmp_path))


def test_a_constraint_is_obeyed(small, tmp_path):
    constraint = tmp_path / "constraints.txt"
    constraint.write_text("numpy<2\n", "utf-8")
    found = packages.Packages(sys.executable, constraint).resolve(["smallransac==2.0", "numpy"])
    assert [(one.name, one.version) for one in found] == [
        ("smallransac", "2.0"),
        ("numpy", "1.26.0"),
    ]


def test_bisection_of_a_real_history(measured):
    cache, _ = measured
    asked = replace(ASKED, versions=("1.0", "1.1", "2.0"))
    report = find_changes([asked], options(cache))
    assert [one.after for one in report.changes] == ["2.0"]
    assert report.not_tried == ()


@pytest.mark.parametrize("version", ["25.3", None])
def test_pip_must_be_there_and_new_enough(monkeypatch, version):
    def installed(name):
        if version is None:
            raise packages.importlib.metadata.PackageNotFoundError(name)
        return version

    metadata = SimpleNamespace(
        version=installed,
        PackageNotFoundError=packages.importlib.metadata.PackageNotFoundError,
    )
    monkeypatch.setattr(packages.importlib, "metadata", metadata)
    with pytest.raises(RansacFixError, match=r"pip install \"pip>=26\""):
        packages.Packages(sys.executable)
