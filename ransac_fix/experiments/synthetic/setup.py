"""What a synthetic experiment is made of, and the paper's numbers for it."""

import math
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Literal

Shape = Literal["line", "ellipse"]
Noise = Literal["determinant", "variance", "deviation"]
Scope = Literal["instance", "measurement"]
Placement = Literal["free", "whole", "absent"]
Outliers = Literal["anywhere", "clear"]
Limit = Literal["distance", "square"]
Conics = Literal["counted", "redrawn"]
Ties = Literal["first", "inliers", "all"]
Distance = Literal["geometric", "sampson", "radial"]
Error = Literal["euclidean", "whitened"]
Streams = Literal["shared", "own"]

SAMPLE_SIZE: dict[Shape, int] = {"line": 2, "ellipse": 5}
THRESHOLDS = (1.0, 2.0, 3.0)
"""The AUC's, in the unit of the box."""

HALF_BOX = 100.0
WHITENED_LIMIT = {"distance": 3.0, "square": math.sqrt(3.0)}
"""Largest whitened distance of an inlier."""

NOISE_RANGE = (0.5, 2.0)


@dataclass(frozen=True, slots=True)
class Setup:
    """One row of a synthetic table. The fields after `confidence` are not given by the paper.

    Parameters
    ----------
    shape : "line" or "ellipse"
        What is fitted.
    n_samples, n_inliers : int
        Measurements, and how many of them come from the shape.
    confidence : Fraction
        s.
    noise : "determinant", "variance" or "deviation"
        What of the isotropic Gaussian noise is uniform in [0.5, 2]: the determinant of its
        covariance (the deviation's fourth power), the variance, or the standard deviation.
    scope : "instance" or "measurement"
        What has its own noise; outliers too have a covariance, which whitens their distances.
    placement : "free", "whole" or "absent"
        A line segment between two uniform points of the box (free), or the whole chord through
        them (whole). An ellipse with a uniform centre, semi-axes uniform in [0, 100] and a
        uniform direction (free), or the same drawn again until the box holds it whole. Absent is
        a control: as free, but all measurements are outliers.
    outliers : "anywhere" or "clear"
        Uniform in the box, which leaves some of them near the shape, or drawn again until none
        is an inlier of the true line or ellipse, so that the ratio of inliers is what it says.
    limit : "distance" or "square"
        Whether an inlier's whitened distance, or its square, is at most 3.
    conics : "counted" or "redrawn"
        Whether five points that lie on no ellipse are a trial without a model, or are replaced
        by others within the trial.
    ties : "first", "inliers" or "all"
        Of two models with as many inliers the better is the first, the one with the smaller sum
        of squared whitened distances of its inliers (as in COLMAP, whose RANSAC is of the
        paper's first author), or the same over all measurements (as in scikit-image).
    distance : "geometric", "sampson" or "radial"
        The ellipse's distance that decides who is an inlier; radial is along the ray from the
        ellipse's centre, which is longer than the geometric one but on the axes.
    error : "euclidean" or "whitened"
        Unit of a ground-truth point's distance to the model in the AUC: the box's, or the
        noise's deviation.
    streams : "shared" or "own"
        Whether both rules read the same samples, so that they differ only where they stop, or
        each its own.
    """

    shape: Shape
    n_samples: int
    n_inliers: int
    confidence: Fraction = Fraction(99, 100)
    noise: Noise = "determinant"
    scope: Scope = "instance"
    placement: Placement = "free"
    outliers: Outliers = "anywhere"
    limit: Limit = "distance"
    conics: Conics = "counted"
    ties: Ties = "inliers"
    distance: Distance = "geometric"
    error: Error = "euclidean"
    streams: Streams = "shared"

    @property
    def sample_size(self) -> int:
        """k: 2 for a line, 5 for an ellipse."""
        return SAMPLE_SIZE[self.shape]

    @property
    def inlier_ratio(self) -> float:
        """Inliers divided by measurements."""
        return self.n_inliers / self.n_samples

    def key(self) -> str:
        """Return the setup as text: equal texts mean equal results."""
        return " ".join(f"{field.name}={getattr(self, field.name)}" for field in fields(self))


@dataclass(frozen=True, slots=True)
class PaperRow:
    """A row of the paper's synthetic tables, in percent.

    Parameters
    ----------
    approximate, exact : tuple of float
        AUC at 1, 2, 3.
    more_trials : float
        N_e/a.
    """

    approximate: tuple[float, float, float]
    exact: tuple[float, float, float]
    more_trials: float


PAPER_N: dict[Shape, int] = {"line": 50, "ellipse": 100}
"""Measurements, from the tables' captions."""

PAPER: dict[Shape, dict[Fraction, PaperRow]] = {
    "line": {
        Fraction(1, 5): PaperRow((36.144, 57.057, 67.783), (36.709, 57.782, 68.497), 7.2),
        Fraction(3, 10): PaperRow((42.238, 65.013, 75.777), (42.696, 65.483, 76.163), 4.8),
        Fraction(2, 5): PaperRow((44.542, 67.426, 77.778), (44.833, 67.732, 78.022), 1.6),
        Fraction(1, 2): PaperRow((45.744, 68.639, 78.730), (45.899, 68.792, 78.850), 0.8),
    },
    "ellipse": {
        Fraction(1, 5): PaperRow((14.033, 24.414, 31.154), (14.600, 25.714, 33.053), 49.4),
        Fraction(3, 10): PaperRow((32.002, 53.570, 65.583), (33.202, 56.222, 68.146), 21.4),
        Fraction(2, 5): PaperRow((34.992, 57.757, 70.009), (36.035, 59.833, 71.832), 15.4),
        Fraction(1, 2): PaperRow((36.256, 60.236, 72.475), (37.068, 61.422, 73.486), 7.7),
    },
}


def paper_row(setup: Setup) -> PaperRow | None:
    """Return the paper's row for this shape, n, p and s; None where it has none."""
    if setup.n_samples != PAPER_N[setup.shape] or setup.confidence != Fraction(99, 100):
        return None
    return PAPER[setup.shape].get(Fraction(setup.n_inliers, setup.n_samples))
