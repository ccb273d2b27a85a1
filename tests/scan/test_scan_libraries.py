"""The scan of the libraries that are installed, as they are."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from ransac_fix.scan import python, scan_paths
from ransac_fix.scan.reading import Text
from ransac_fix.scan.scanner import read


def folder(name: str) -> Path:
    spec = find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


@pytest.mark.parametrize(
    ("library", "path"),
    [("skimage", "measure/fit.py"), ("sklearn", "linear_model/_ransac.py")],
)
def test_finds_the_one_rule_of_a_library(library, path):
    result = scan_paths([folder(library)], jobs=1)
    assert not result.errors
    (finding,) = result.warnings
    (note,) = (one for one in result.findings if one.severity == "note")
    assert (note.code, note.expression) == ("RFX007", "log(1 - probability) / log(1 - e ** m)")
    assert finding.location.path == str(folder(library) / path)
    assert (finding.code, finding.certainty) == ("RFX001", "high")
    assert finding.roles == {
        "inlier_ratio": "inlier_ratio",
        "n_inliers": "n_inliers",
        "n_samples": "n_samples",
        "sample_size": "min_samples",
        "confidence": "probability",
    }
    line = Path(finding.location.path).read_text().splitlines()[finding.location.start_line - 1]
    assert line[finding.location.start_column - 1 :].startswith("np.log(nom) / np.log(denom)")


def test_sees_that_kornia_is_exact():
    root = folder("kornia")
    assert scan_paths([root / "geometry"], jobs=1).findings == ()
    exact = {}
    for name in ("ransac.py", "_ransac_program.py", "_degensac.py"):
        source = (root / "geometry" / name).read_text()
        exact[name] = [
            found.site.probability.kind for found in read(python.parse(source), Text(source), name)
        ]
    assert exact == {
        "ransac.py": ["exact", "exact"],
        "_ransac_program.py": ["exact"],
        "_degensac.py": ["exact"],
    }


def test_the_gates_lose_nothing():
    named = {
        "kornia": ("geometry/ransac.py", "geometry/_ransac_program.py", "geometry/_degensac.py"),
        "skimage": ("measure/fit.py", "transform/_geometric.py"),
        "sklearn": ("linear_model/_ransac.py", "linear_model/_theil_sen.py"),
    }
    for library, names in named.items():
        paths = [folder(library) / name for name in names]
        assert scan_paths(paths, gate=False) == scan_paths(paths)
