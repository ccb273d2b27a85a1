"""Squared residuals of geometric models, for libraries that do not return the score of theirs.

Every function takes measurements as rows and a model as an array, and returns one squared
residual a measurement; infinity where it is not defined.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Squares = NDArray[np.float64]

__all__ = ["rigid", "sampson", "symmetric_epipolar", "transfer"]


def transfer(x: Any, y: Any, model: Any) -> "Squares":
    """Return squared distances of y from x moved by an affine map (2 x 3) or homography (3 x 3).

    Parameters
    ----------
    x, y : array of shape (n, 2)
        Points in the first and in the second image.
    model : array
        The map from the first to the second.
    """
    import numpy as np

    moved = x @ model[:, :2].T + model[:, 2]
    if len(model) == 3:
        with np.errstate(all="ignore"):
            moved = moved[:, :2] / moved[:, 2:]
    return _defined(((moved - y) ** 2).sum(axis=1))


def sampson(x: Any, y: Any, model: Any) -> "Squares":
    """Return squared Sampson distances for a fundamental or essential matrix, y' F x = 0."""
    import numpy as np

    error, second, first = _epipolar(x, y, model)
    with np.errstate(all="ignore"):
        return _defined(error**2 / (second + first))


def symmetric_epipolar(x: Any, y: Any, model: Any) -> "Squares":
    """Return squared distances from both epipolar lines, added up."""
    import numpy as np

    error, second, first = _epipolar(x, y, model)
    with np.errstate(all="ignore"):
        return _defined(error**2 * (1.0 / second + 1.0 / first))


def rigid(x: Any, y: Any, model: Any) -> "Squares":
    """Return squared distances of y from x moved by a motion: rows times a 4 x 4 matrix."""
    return _defined(((x @ model[:3, :3] + model[3, :3] - y) ** 2).sum(axis=1))


def _epipolar(x: Any, y: Any, model: Any) -> tuple[Any, Any, Any]:
    """Return the algebraic errors, and squared lengths of the lines' normals in both images."""
    ahead = x @ model[:, :2].T + model[:, 2]
    back = y @ model[:2] + model[2]
    error = (y * ahead[:, :2]).sum(axis=1) + ahead[:, 2]
    return error, (ahead[:, :2] ** 2).sum(axis=1), (back[:, :2] ** 2).sum(axis=1)


def _defined(squares: Any) -> "Squares":
    import numpy as np

    found: Squares = np.where(np.isnan(squares), np.inf, squares)
    return found
