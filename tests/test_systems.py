import re

import pytest

from ransac_fix.errors import RansacFixError
from ransac_fix.systems import find_system, load_systems

SYSTEMS = load_systems()


def test_every_system_of_the_design_is_there() -> None:
    names = {system.name for system in SYSTEMS}
    assert names == {
        *("opencv", "scikit-image", "scikit-learn", "kornia", "ransaclib", "magsac"),
        *("progressive-x", "gc-ransac", "vsac", "colmap", "theia", "openmvg", "alicevision"),
        *("opensfm", "orb-slam3", "poselib", "opengv", "open3d", "pcl", "cgal", "pydegensac"),
        *("usac", "pyransac3d", "superansac", "kornia-rs"),
    }


@pytest.mark.parametrize("system", SYSTEMS, ids=lambda system: system.name)
def test_facts_use_the_vocabulary(system) -> None:
    assert system.sampler in {"distinct", "replacement", "stratified", "local"}
    assert system.stopping in {"approximate", "exact", "other"}
    assert system.evidence in {"measured", "unmeasured"}
    assert re.fullmatch(r"[\w.-]+/[\w.-]+", system.upstream)
    assert system.note.endswith(".")


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("opencv", "opencv"),
        ("opencv-python", "opencv"),
        ("cv2", "opencv"),
        ("skimage", "scikit-image"),
        ("scikit_learn", "scikit-learn"),
        ("PyColmap", "colmap"),
        ("kornia-rs", "kornia-rs"),
        ("kornia_rs", "kornia-rs"),
        ("libpcl-dev", "pcl"),
        ("python3-opengv", "opengv"),
    ],
)
def test_found_by_any_name(given: str, name: str) -> None:
    assert find_system(given).name == name


def test_no_name_means_two_systems() -> None:
    for kind in ("distributions", "modules", "debian"):
        names = [name for system in SYSTEMS for name in getattr(system, kind)]
        assert len(names) == len(set(names))


def test_an_unknown_name_is_one_clear_line() -> None:
    with pytest.raises(RansacFixError, match=r"unknown system 'vision': use one of opencv, "):
        find_system("vision")
