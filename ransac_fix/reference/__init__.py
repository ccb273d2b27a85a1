"""The built-in exact RANSAC: samplers, models and the loop, each replaceable by a caller's own.

It shows what a right stopping rule does, and it is the audit's known quantity: any rule, any
sampler and any model run through one loop whose every trial can be seen.
"""

from ransac_fix.reference.interface import (
    BoolArray,
    FloatArray,
    IndexArray,
    KnownSampler,
    Model,
    Sampler,
    StoppingRule,
    SubsetSampler,
)
from ransac_fix.reference.loop import Candidate, RansacResult, Recording, Trial, ransac
from ransac_fix.reference.models import Affine, Circle, Ellipse, Homography, Line, Plane
from ransac_fix.reference.samplers import DistinctSampler, ReplacementSampler, StratifiedSampler

__all__ = [
    "Affine",
    "BoolArray",
    "Candidate",
    "Circle",
    "DistinctSampler",
    "Ellipse",
    "FloatArray",
    "Homography",
    "IndexArray",
    "KnownSampler",
    "Line",
    "Model",
    "Plane",
    "RansacResult",
    "Recording",
    "ReplacementSampler",
    "Sampler",
    "StoppingRule",
    "StratifiedSampler",
    "SubsetSampler",
    "Trial",
    "ransac",
]
