"""Levenberg-Marquardt for the refits whose residuals are not linear in the parameters."""

from collections.abc import Callable

import numpy as np

from ransac_fix.reference.interface import FloatArray

_STEPS = 100
# A step that lowers the cost by less than this fraction is the last, and residuals this small
# are rounding.
_CONVERGED = 1e-14
_ROUNDING = 1e-15


def minimise(
    residuals_and_jacobian: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    start: FloatArray,
) -> FloatArray:
    """Return parameters with a locally smallest sum of squared residuals.

    Parameters
    ----------
    residuals_and_jacobian : callable
        From parameters of shape (p,) to residuals of shape (m,) and their derivatives (m, p).
        Residuals that are not finite mark parameters to step back from.
    start : ndarray of shape (p,)
        Where to begin. Parameters and residuals should be of the order of one.

    Returns
    -------
    ndarray of shape (p,)
        Never worse than `start`.
    """
    best = start
    residuals, jacobian = residuals_and_jacobian(best)
    cost = float(residuals @ residuals)
    damping = 1e-4
    for _ in range(_STEPS):
        if not _ROUNDING**2 * len(residuals) < cost < np.inf or damping > 1e8:
            break
        normal = jacobian.T @ jacobian
        weights = np.maximum(np.diag(normal), 1e-12)
        step = np.linalg.solve(normal + damping * np.diag(weights), -(jacobian.T @ residuals))
        candidate = best + step
        new_residuals, new_jacobian = residuals_and_jacobian(candidate)
        new_cost = float(new_residuals @ new_residuals)
        if new_cost < cost:
            gain = (cost - new_cost) / cost
            best, residuals, jacobian, cost = candidate, new_residuals, new_jacobian, new_cost
            damping = max(damping * 0.1, 1e-12)
            if gain < _CONVERGED:
                break
        else:
            damping *= 10.0
    return best
