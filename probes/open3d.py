"""Open3D: registration from correspondences, and plane segmentation.

Its loops are parallel and race for the best model; on the one CPU that this probe asks for
they do not.
"""

from typing import Any

import numpy as np

from ransac_fix.audit.worker import agreement
from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import Planted


def _entry_points(o3d: Any) -> list[EntryPoint | Unmeasured]:
    registration = o3d.pipelines.registration

    def cloud(points: Any) -> Any:
        return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))

    def register(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        o3d.utility.random.seed(seed % 2**31)
        options: dict[str, Any] = {}
        if settings is not None:
            options["criteria"] = registration.RANSACConvergenceCriteria(
                settings.max_trials, settings.confidence
            )
        pairs = np.repeat(np.arange(planted.n_samples), 2).reshape(-1, 2)
        found = registration.registration_ransac_based_on_correspondence(
            cloud(planted.x),
            cloud(planted.y),
            o3d.utility.Vector2iVector(pairs),
            planted.threshold,
            **options,
        )
        motion = np.asarray(found.transformation)
        return Outcome(
            agreement.with_motion(planted, motion[:3, :3], motion[:3, 3], planted.threshold)
        )

    def segment(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        o3d.utility.random.seed(seed % 2**31)
        options: dict[str, Any] = {"num_iterations": _ITERATIONS}
        if settings is not None:
            options = {
                "num_iterations": settings.max_trials,
                "probability": settings.confidence,
            }
        _, inliers = cloud(planted.x).segment_plane(planted.threshold, 3, **options)
        mask = np.zeros(planted.n_samples, dtype=bool)
        mask[list(inliers)] = True
        return Outcome(mask)

    return [
        EntryPoint(
            "registration_ransac_based_on_correspondence",
            "rigid3d",
            3,
            register,
            Defaults(0.999, max_trials=100_000, max_trials_name="max_iteration"),
        ),
        EntryPoint(
            "PointCloud.segment_plane",
            "plane",
            3,
            segment,
            Defaults(0.99999999, max_trials=_ITERATIONS, max_trials_name="num_iterations"),
        ),
    ]


# Open3D asks for the number of iterations; this is the one in its documentation.
_ITERATIONS = 1000


PROBE = Probe("open3d", "open3d", ("open3d", "open3d-cpu"), _entry_points, one_cpu=True)
