"""CGAL's Efficient_RANSAC, through a driver that counts the samples drawn until its first plane.

It draws each sample from one cell of an octree, and its stopping rule is about such samples: that
for samples drawn anywhere would be wrong here.
"""

from pathlib import Path
from typing import Any

from ransac_fix.audit.worker import native
from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe, Settings, Unmeasured
from ransac_fix.audit.worker.planted import Planted

_LIBRARY = native.Library(
    title="CGAL",
    source=Path(__file__).with_name("drivers") / "cgal.cpp",
    header=native.Header("CGAL/Shape_detection/Efficient_RANSAC.h", "libcgal-dev"),
    links=("gmp", "mpfr"),
    version_macro=("CGAL/version.h", "CGAL_VERSION"),
)
_NAME = "Efficient_RANSAC::detect"
# A plane of fewer than 10 points is none to it; on few points its cells hold nearly all of them.
_LEAST_PLANE = 10
_SOME_CELLS = 100


def _entry_points(_: Any) -> list[EntryPoint | Unmeasured]:
    try:
        driver = _LIBRARY.start()
    except native.Unusable as why:
        return [Unmeasured(_NAME, str(why))]

    def detect(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        return driver.run("planes", planted.x, planted.threshold, settings, seed)

    return [
        EntryPoint(
            _NAME,
            "plane_patch",
            3,
            detect,
            counted=True,
            fewest_samples=_SOME_CELLS,
            spare=_LEAST_PLANE,
            size_seen=True,
        )
    ]


PROBE = Probe("cgal", "CGAL", (), _entry_points, find=_LIBRARY.find)
