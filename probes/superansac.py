"""SupeRANSAC, whose samples are not defined: nothing of it can be measured.

The sampler of release 1.0 draws from n + 1 indices: its range ends at n, included, and one row
beyond the data is read for it. What a sample with that row gives is decided by what the memory
holds there. Of 200 runs of one trial on five measurements that all agree about 67 find the model,
C(5,4)/C(6,4) of them, where that row holds an ordinary number, and all 200 where it holds none:
then the sample gives no model and another is drawn in its place, uncounted.
"""

from typing import Any

from ransac_fix.audit.worker.interface import EntryPoint, Probe, Unmeasured

_REASON = (
    "its sampler draws from n + 1 indices, of which the last lies beyond the data: what a sample "
    "with that one gives depends on what the memory holds there"
)


def _entry_points(_pysuperansac: Any) -> list[EntryPoint | Unmeasured]:
    models = ("Homography", "FundamentalMatrix", "EssentialMatrix", "AbsolutePose")
    return [Unmeasured(f"estimate{model}", _REASON) for model in (*models, "RigidTransform")]


PROBE = Probe("superansac", "pysuperansac", ("pysuperansac",), _entry_points)
