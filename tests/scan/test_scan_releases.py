"""RFX101: which release a call runs with, and what is said of it."""

import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.errors import RansacFixError
from ransac_fix.scan import releases
from ransac_fix.scan.releases import Release, release_of
from ransac_fix.scan.rules import rfx101
from ransac_fix.verdicts import StoredVerdict

CALL = "from sklearn.linear_model import RANSACRegressor\n\nmodel = RANSACRegressor()\n"


@pytest.fixture
def project(tmp_path: Path, monkeypatch) -> Path:
    """A project whose environment has no library at all."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(releases, "_installed", lambda _python: {})
    releases._stated_in.cache_clear()
    rfx101._gates()  # made of what was really measured, whatever a test puts in its place
    (tmp_path / ".git").mkdir()
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "fit.py").write_text(CALL)
    return tmp_path


FILES = {
    "uv.lock": ('[[package]]\nname = "scikit-learn"\nversion = "1.9.1"\n', "1.9.1", 2),
    "poetry.lock": (
        '# @generated\n[[package]]\nname = "scikit-learn"\nversion = "1.9.1"\n',
        "1.9.1",
        3,
    ),
    "pylock.toml": ('[[packages]]\nname = "scikit-learn"\nversion = "1.9.1"\n', "1.9.1", 2),
    "Pipfile.lock": (
        json.dumps({"default": {"scikit-learn": {"version": "==1.9.1"}}}, indent=1),
        "1.9.1",
        3,
    ),
    "requirements.txt": (
        "numpy\nscikit_learn[extra]==1.9.1 ; python_version > '3.8'  # why\n",
        "1.9.1",
        2,
    ),
    "requirements-dev.txt": (
        "Scikit.Learn == 1.9.1 \\\n    --hash=sha256:00\n",
        "1.9.1",
        1,
    ),
    "pyproject.toml": (
        '[project]\nname = "x"\ndependencies = [\n  "numpy",\n  "scikit-learn==1.9.1",\n]\n',
        "1.9.1",
        5,
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_reads_the_release_and_its_line(project, name):
    text, version, line = FILES[name]
    (project / name).write_text(text)
    found = release_of(["scikit-learn"], str(project / "src" / "fit.py"), None)
    assert found is not None
    assert (found.version, found.path, found.line) == (version, name, line)


def test_reads_ranges(project):
    (project / "requirements.txt").write_text("-r more.txt\n-c ../none.txt\n--no-index\n\x00\n")
    (project / "more.txt").write_text("-r requirements.txt\nscikit-learn>=1.2,<2\n")
    found = release_of(["scikit-learn"], "src/fit.py", None)
    assert found is not None
    assert (found.version, found.range, found.line) == (None, ">=1.2,<2", 2)
    assert found.path == "more.txt"


@pytest.mark.parametrize(
    ("spec", "wanted"),
    [
        ("^1.2.3", ">=1.2.3,<2"),
        ("^0.2", ">=0.2,<0.3"),
        ("~1.2", "~=1.2"),
        ("*", ""),
        (">=1", ">=1"),
    ],
)
def test_reads_poetry_ranges(project, spec, wanted):
    (project / "pyproject.toml").write_text(
        f'[tool.poetry.dependencies]\nscikit-learn = {{version = "{spec}", optional = true}}\n'
    )
    found = release_of(["scikit-learn"], "src/fit.py", None)
    assert found is not None
    assert (found.version, found.range) == (None, wanted)


def test_the_closest_file_decides_and_the_repository_ends_the_search(project):
    (project.parent / "requirements.txt").write_text("scikit-learn==0.1\n")
    assert release_of(["scikit-learn"], "src/fit.py", None) is None
    (project / "uv.lock").write_text(FILES["uv.lock"][0])
    (project / "src" / "requirements.txt").write_text("scikit-learn==1.0\n")
    releases._stated_in.cache_clear()
    found = release_of(["scikit-learn"], "src/fit.py", None)
    assert found is not None
    assert found.version == "1.0"


def test_the_environment_goes_first(tmp_path):
    import sklearn

    found = release_of(["scikit-learn"], str(tmp_path / "a.py"), None)
    assert found == Release("scikit-learn", sklearn.__version__)
    assert release_of(["scikit-learn"], str(tmp_path / "a.py"), sys.executable) == found
    with pytest.raises(RansacFixError, match="cannot ask"):
        release_of(["scikit-learn"], str(tmp_path / "a.py"), str(tmp_path / "nothing"))


def _stored(*verdicts: tuple[str, str]) -> tuple[StoredVerdict, ...]:
    return tuple(
        StoredVerdict(
            "scikit-learn", "scikit-learn", version, "RANSACRegressor", verdict, "N", "2026-11-25"
        )
        for version, verdict in verdicts
    )


JUDGED = {
    "a release that undersamples": (
        "==1.5",
        [("1.5", "undersamples"), ("1.9", "exact")],
        "undersamples in scikit-learn 1.5, where it stops by N (measured 2026-11-25)",
        "medium",
    ),
    "a release that is exact": ("==1.9", [("1.5", "undersamples"), ("1.9", "exact")], None, ""),
    "a release that was not measured": (
        "==1.6",
        [("1.5", "undersamples"), ("1.9", "exact")],
        "was not measured in scikit-learn 1.6; it undersamples in 1.5",
        "low",
    ),
    "a release beside an exact one": (
        "==2.0",
        [("1.5", "undersamples"), ("1.9", "exact")],
        None,
        "",
    ),
    "a range that agrees": (
        ">=1.2,<2",
        [("1.5", "undersamples"), ("1.6", "undersamples"), ("2.1", "exact")],
        "undersamples in every release of scikit-learn>=1.2,<2 that was measured (1.5, 1.6)",
        "medium",
    ),
    "a range that does not": (
        ">=1.2",
        [("1.5", "undersamples"), ("2.1", "exact")],
        "undersamples in some releases of scikit-learn>=1.2 (1.5), not in others (2.1)",
        "low",
    ),
    "a range without a measured one": (">=3", [("1.5", "undersamples")], None, ""),
}


@pytest.mark.parametrize(("spec", "stored", "what", "certainty"), JUDGED.values(), ids=JUDGED)
def test_judges_by_what_was_measured(project, monkeypatch, spec, stored, what, certainty):
    (project / "requirements.txt").write_text(f"scikit-learn{spec}\n")
    verdicts = _stored(*stored)
    monkeypatch.setattr("ransac_fix.verdicts.load_verdicts", lambda: verdicts)
    result = CliRunner().invoke(
        cli, ["scan", "--select", "RFX101", "--output-format", "json", "src"]
    )
    findings = json.loads(result.output)["findings"]
    assert result.exit_code == (0 if what is None else 1)
    assert [(one["certainty"], one["message"].split("; max_trials")[0]) for one in findings] == (
        [] if what is None else [(certainty, f"RANSACRegressor {what}")]
    )
    for finding in findings:
        (related,) = finding["related"]
        assert related["path"].endswith("requirements.txt")
        assert (related["start_line"], related["message"]) == (1, "scikit-learn is named here")


def test_is_off_unless_it_is_asked_for(tmp_path):
    path = tmp_path / "fit.py"
    path.write_text(CALL)
    assert CliRunner().invoke(cli, ["scan", str(path)]).exit_code == 0
    assert CliRunner().invoke(cli, ["scan", "--select", "RFX", str(path)]).exit_code == 1


REMEDIES = {
    "import cv2\nF = cv2.findFundamentalMat([], [], cv2.FM_RANSAC, 1.0, 0.99, 50)\n": (
        'call `ransac_fix.patch("opencv")`'
    ),
    "import poselib\nposelib.estimate_fundamental([], [], {}, {})\n": "mostly hide it",
    "import pydegensac\npydegensac.findHomography([], [], 1.0, max_iters=7)\n": (
        "the max_iters of this call may end a run first, or hide it"
    ),
    "from kornia_rs import ransac\nransac.homography([], [])\n": 'ransac_fix.patch("kornia-rs")',
}


@pytest.mark.parametrize(("source", "remedy"), REMEDIES.items(), ids=range(len(REMEDIES)))
def test_names_the_remedy(tmp_path, source, remedy):
    path = tmp_path / "fit.py"
    path.write_text(source)
    result = CliRunner().invoke(cli, ["scan", "--select", "RFX101", str(path)])
    assert result.exit_code == 1, result.output
    assert remedy in result.output


def test_every_measured_function_has_a_gate():
    for module, names in rfx101._gates():
        assert module
        assert names
