"""Which measurements agree with a model, for libraries that return the model and no inliers.

The planted data are exact, so the tolerance is only for what a solver loses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ransac_fix.audit.worker.planted import project

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ransac_fix.audit.worker.planted import Planted


def with_homography(
    planted: Planted, homography: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """Compare ``H (x, 1)`` with y.

    Parameters
    ----------
    planted : Planted
        The problem.
    homography : ndarray, shape (3, 3)
        At any scale.
    tolerance : float
        Largest distance, not included, in pixels.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    mapped = np.column_stack([planted.x, np.ones(planted.n_samples)]) @ homography.T
    return _within(mapped[:, :2] / mapped[:, 2:] - planted.y, tolerance)


def with_fundamental(
    planted: Planted, fundamental: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """Compare ``(y, 1) F (x, 1)`` with 0, by the Sampson distance.

    Parameters
    ----------
    planted : Planted
        The problem.
    fundamental : ndarray, shape (3, 3)
        At any scale.
    tolerance : float
        Largest distance, not included, in pixels.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    x = np.column_stack([planted.x, np.ones(planted.n_samples)])
    y = np.column_stack([planted.y, np.ones(planted.n_samples)])
    lines_y, lines_x = x @ fundamental.T, y @ fundamental
    scale = np.hypot(np.hypot(*lines_y[:, :2].T), np.hypot(*lines_x[:, :2].T))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.abs((y * lines_y).sum(axis=1)) / scale
    return np.asarray(distance < tolerance)


def with_motion(
    planted: Planted,
    linear: NDArray[np.float64],
    shift: NDArray[np.float64],
    tolerance: float,
) -> NDArray[np.bool_]:
    """Compare ``A x + b`` with y.

    Parameters
    ----------
    planted : Planted
        The problem.
    linear : ndarray, shape (d, d)
        A.
    shift : ndarray, shape (d,)
        b.
    tolerance : float
        Largest distance, not included, in the unit of y.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return _within(planted.x @ linear.T + shift - planted.y, tolerance)


def with_pose(
    planted: Planted,
    rotation: NDArray[np.float64],
    shift: NDArray[np.float64],
    tolerance: float,
) -> NDArray[np.bool_]:
    """Compare the projection of ``R x + t`` with y.

    Parameters
    ----------
    planted : Planted
        The problem.
    rotation : ndarray, shape (3, 3)
        R.
    shift : ndarray, shape (3,)
        t.
    tolerance : float
        Largest distance, not included, in pixels.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    return _within(project(planted.x @ rotation.T + shift) - planted.y, tolerance)


def _within(difference: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]:
    # Not <=: NaN must not agree.
    return np.asarray(np.linalg.norm(difference, axis=1) < tolerance)
