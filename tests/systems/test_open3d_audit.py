"""The verdicts on Open3D, of the `audit-all` extra, measured."""

import pytest
from optional_libraries import described

from ransac_fix.audit.judge import judge
from ransac_fix.audit.measure import measure


@pytest.fixture(scope="module")
def open3d():
    yield from described("open3d", "pip install ransac-fix[audit-all]")


@pytest.mark.parametrize(
    ("name", "k", "drawn"),
    [
        ("registration_ransac_based_on_correspondence", 3, "replacement"),
        ("registration_ransac_based_on_correspondence(with_scaling)", 3, "replacement"),
        ("registration_ransac_based_on_feature_matching", 3, "replacement"),
        ("PointCloud.segment_plane", 3, "distinct"),
        ("PointCloud.segment_plane(ransac_n=5)", 5, "distinct"),
        ("t.PointCloud.segment_plane", 3, "distinct"),
    ],
)
def test_registration_draws_with_replacement_and_segmentation_distinct(open3d, name, k, drawn):
    host, entry_points, _ = open3d
    verdict, reason = judge(found := measure(host, entry_points[name]))
    assert verdict == "undersamples"
    law = found.fit.law
    assert (law.assumed, law.sample_size, law.inlier_offset) == ("approximate", k, 0)
    assert (law.multiplier, law.phi) == (1.0, (1.0, 1.0))
    assert (found.sampler.drawn, found.sampler.sample_size) == (drawn, k)
    # What it should assume is that of its own sampler, which is smaller still.
    how = "indices with replacement" if drawn == "replacement" else "distinct indices"
    assert f"draws {k} {how}" in reason


def test_defaults_are_read_where_the_library_states_them(open3d):
    _, entry_points, _ = open3d
    defaults = entry_points["registration_ransac_based_on_feature_matching"]["defaults"]
    assert (defaults["confidence"], defaults["max_trials"]) == (0.999, 100_000)
    # Its plain interface asks for the number of iterations; the tensor one has a low default.
    assert entry_points["t.PointCloud.segment_plane"]["defaults"]["max_trials"] == 100
