"""Geometric models: a minimal solver, residuals and a refit each, in numpy alone."""

from ransac_fix.reference.models.affine import Affine
from ransac_fix.reference.models.circle import Circle
from ransac_fix.reference.models.ellipse import Ellipse
from ransac_fix.reference.models.homography import Homography
from ransac_fix.reference.models.line import Line
from ransac_fix.reference.models.plane import Plane

__all__ = ["Affine", "Circle", "Ellipse", "Homography", "Line", "Plane"]
