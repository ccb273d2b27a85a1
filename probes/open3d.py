"""Open3D: registration from correspondences and from features, and plane segmentation.

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

# Open3D's legacy segment_plane asks for the number of iterations; this one is its documentation's.
_ITERATIONS = 1000
# Features lie on a circle of this radius: those of one match equal, those of others far off.
_FEATURE_RADIUS = 100.0


class _Functions:
    """The estimators, each as a probe wants it."""

    def __init__(self, o3d: Any) -> None:
        self.o3d = o3d
        self.registration = o3d.pipelines.registration

    def seed(self, seed: int) -> None:
        self.o3d.utility.random.seed(seed % 2**31)

    def cloud(self, points: Any) -> Any:
        return self.o3d.geometry.PointCloud(self.o3d.utility.Vector3dVector(points))

    def criteria(self, settings: Settings | None) -> dict[str, Any]:
        if settings is None:
            return {}
        chosen = self.registration.RANSACConvergenceCriteria(
            settings.max_trials, settings.confidence
        )
        return {"criteria": chosen}

    def from_correspondences(self, with_scaling: bool) -> Any:
        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            self.seed(seed)
            pairs = np.repeat(np.arange(planted.n_samples), 2).reshape(-1, 2)
            found = self.registration.registration_ransac_based_on_correspondence(
                self.cloud(planted.x),
                self.cloud(planted.y),
                self.o3d.utility.Vector2iVector(pairs),
                planted.threshold,
                estimation_method=self._estimation(with_scaling),
                **self.criteria(settings),
            )
            return self._moved(planted, found)

        return run

    def from_features(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        self.seed(seed)
        angles = 2 * np.pi * np.arange(planted.n_samples) / planted.n_samples
        feature = self.registration.Feature()
        feature.data = _FEATURE_RADIUS * np.array([np.cos(angles), np.sin(angles)])
        found = self.registration.registration_ransac_based_on_feature_matching(
            self.cloud(planted.x),
            self.cloud(planted.y),
            feature,
            feature,
            mutual_filter=True,
            max_correspondence_distance=planted.threshold,
            **self.criteria(settings),
        )
        return self._moved(planted, found)

    def segment(self, ransac_n: int) -> Any:
        def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
            self.seed(seed)
            options: dict[str, Any] = {"num_iterations": _ITERATIONS}
            if settings is not None:
                options = {
                    "num_iterations": settings.max_trials,
                    "probability": settings.confidence,
                }
            _, inliers = self.cloud(planted.x).segment_plane(planted.threshold, ransac_n, **options)
            return self._masked(planted, list(inliers))

        return run

    def segment_tensor(self, planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        self.seed(seed)
        options: dict[str, Any] = {}
        if settings is not None:
            options = {"num_iterations": settings.max_trials, "probability": settings.confidence}
        cloud = self.o3d.t.geometry.PointCloud(self.o3d.core.Tensor(planted.x))
        _, inliers = cloud.segment_plane(planted.threshold, 3, **options)
        return self._masked(planted, inliers.numpy())

    def _estimation(self, with_scaling: bool) -> Any:
        return self.registration.TransformationEstimationPointToPoint(with_scaling)

    @staticmethod
    def _moved(planted: Planted, found: Any) -> Outcome:
        motion = np.asarray(found.transformation)
        return Outcome(
            agreement.with_motion(planted, motion[:3, :3], motion[:3, 3], planted.threshold)
        )

    @staticmethod
    def _masked(planted: Planted, inliers: Any) -> Outcome:
        mask = np.zeros(planted.n_samples, dtype=bool)
        mask[inliers] = True
        return Outcome(mask)


def _entry_points(o3d: Any) -> list[EntryPoint | Unmeasured]:
    functions = _Functions(o3d)
    untouched = functions.registration.RANSACConvergenceCriteria()
    registration = Defaults(
        float(untouched.confidence),
        max_trials=int(untouched.max_iteration),
        max_trials_name="max_iteration",
    )
    # As the signatures of 0.20 have them.
    segmentation = Defaults(0.99999999, max_trials=_ITERATIONS, max_trials_name="num_iterations")
    tensor = Defaults(0.999, max_trials=100, max_trials_name="num_iterations")
    entry_points: list[EntryPoint | Unmeasured] = [
        EntryPoint(
            "registration_ransac_based_on_correspondence",
            "rigid3d",
            3,
            functions.from_correspondences(with_scaling=False),
            registration,
        ),
        EntryPoint(
            "registration_ransac_based_on_correspondence(with_scaling)",
            "similarity3d",
            3,
            functions.from_correspondences(with_scaling=True),
            registration,
        ),
        EntryPoint(
            "registration_ransac_based_on_feature_matching",
            "rigid3d",
            3,
            functions.from_features,
            registration,
        ),
        EntryPoint("PointCloud.segment_plane", "plane", 3, functions.segment(3), segmentation),
        EntryPoint(
            "PointCloud.segment_plane(ransac_n=5)", "plane", 5, functions.segment(5), segmentation
        ),
    ]
    if "probability" in (o3d.t.geometry.PointCloud.segment_plane.__doc__ or ""):
        entry_points.append(
            EntryPoint("t.PointCloud.segment_plane", "plane", 3, functions.segment_tensor, tensor)
        )
    return entry_points


PROBE = Probe("open3d", "open3d", ("open3d", "open3d-cpu"), _entry_points, one_cpu=True)
