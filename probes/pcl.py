"""PCL, its sample consensus templates and SACSegmentation, through a driver."""

from pathlib import Path
from typing import Any

import numpy as np

from ransac_fix.audit.worker import native
from ransac_fix.audit.worker.interface import (
    Defaults,
    EntryPoint,
    Outcome,
    Probe,
    Settings,
    Unmeasured,
)
from ransac_fix.audit.worker.planted import Planted

_LIBRARY = native.Library(
    title="PCL",
    source=Path(__file__).with_name("drivers") / "pcl.cpp",
    header=native.Header("pcl/pcl_config.h", "libpcl-dev", ("pcl-*",)),
    needs=(
        native.Header("Eigen/Core", "libeigen3-dev", ("eigen3",)),
        native.Header("boost/version.hpp", "libboost-dev"),
        native.Header("flann/flann.hpp", "libflann-dev"),
    ),
    links=("pcl_segmentation", "pcl_sample_consensus", "pcl_search", "pcl_kdtree", "pcl_common"),
    version_macro=("pcl/pcl_config.h", "PCL_VERSION_PRETTY"),
)
# As the constructors of SampleConsensus and SACSegmentation have it.
_CONFIDENCE = 0.99
# PCL computes in single precision, which loses more in some samples than the data do.
_SLACK = 10.0

# What a user writes, the driver's name, the planted problem and k.
_FUNCTIONS = (
    ("RandomSampleConsensus(SampleConsensusModelPlane)", "ransac.plane", "plane", 3),
    ("SACSegmentation(SACMODEL_PLANE, SAC_RANSAC)", "segmentation.plane", "plane", 3),
    ("RandomSampleConsensus(SampleConsensusModelLine)", "ransac.line", "line3d", 2),
    ("RandomSampleConsensus(SampleConsensusModelCircle2D)", "ransac.circle", "circle", 3),
    ("RandomSampleConsensus(SampleConsensusModelSphere)", "ransac.sphere", "sphere", 4),
    (
        "RandomSampleConsensus(SampleConsensusModelRegistration)",
        "ransac.registration",
        "rigid3d",
        3,
    ),
    ("MEstimatorSampleConsensus(SampleConsensusModelPlane)", "msac.plane", "plane", 3),
    ("MaximumLikelihoodSampleConsensus(SampleConsensusModelPlane)", "mlesac.plane", "plane", 3),
    ("RandomizedRandomSampleConsensus(SampleConsensusModelPlane)", "rransac.plane", "plane", 3),
    ("RandomizedMEstimatorSampleConsensus(SampleConsensusModelPlane)", "rmsac.plane", "plane", 3),
    ("ProgressiveSampleConsensus(SampleConsensusModelPlane)", "prosac.plane", "plane", 3),
    ("LeastMedianSquares(SampleConsensusModelPlane)", "lmeds.plane", "plane", 3),
)


def _defaults(driver: native.Driver, name: str) -> Defaults:
    """Ask for the default cap, which differs from method to method; one trial more is run."""
    cap = driver.run(name, np.empty((0, 6)), 0.0, None, 0).trials
    assert cap is not None
    return Defaults(_CONFIDENCE, max_trials=cap + 1, max_trials_name="setMaxIterations")


def _driven(driver: native.Driver, name: str) -> Any:
    def run(planted: Planted, settings: Settings | None, seed: int) -> Outcome:
        flat = np.zeros((planted.n_samples, 3 - planted.x.shape[1]))
        points = np.hstack([planted.x, flat, planted.y])
        return driver.run(name, points, _SLACK * planted.threshold, settings, seed)

    return run


def _entry_points(_: Any) -> list[EntryPoint | Unmeasured]:
    try:
        driver = _LIBRARY.start()
    except native.Unusable as why:
        return [Unmeasured(name, str(why)) for name, *_ in _FUNCTIONS]
    return [
        EntryPoint(
            name,
            problem,
            k,
            _driven(driver, driven),
            _defaults(driver, driven),
            counted=True,
        )
        for name, driven, problem, k in _FUNCTIONS
    ]


PROBE = Probe("pcl", "pcl", (), _entry_points, find=_LIBRARY.find)
