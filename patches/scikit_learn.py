"""scikit-learn: `sklearn.linear_model.RANSACRegressor`.

The rule is ``_dynamic_max_trials`` in ``sklearn/linear_model/_ransac.py``, called from
``RANSACRegressor.fit``; samples are drawn without replacement. Its default of ``max_trials=100``
stays a bound: raise it where the exact number is larger.

``from ransac_fix.patches.scikit_learn import RANSACRegressor`` is the exact estimator without
any change for the rest of the program.
"""

import functools
import math
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.errors import PatchNotApplicable
from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.missing import own_function
from ransac_fix.patching.rules import count_rule
from ransac_fix.patching.watching import note

if TYPE_CHECKING:
    from sklearn.linear_model import RANSACRegressor

__all__ = ["PATCH", "RANSACRegressor"]


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace. `min_samples` < 1 makes the size of a sample a NumPy float."""
    return count_rule(
        module,
        "_dynamic_max_trials",
        caller="RANSACRegressor.fit",
        parameters=("n_inliers", "n_samples", "min_samples", "probability"),
        limit="max_trials",
    )


def observe(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to watch: ``RANSACRegressor.fit``."""
    original = own_function(module.RANSACRegressor, "fit")
    if original is None:
        raise PatchNotApplicable("RANSACRegressor has no method fit")

    def fit(self: Any, *args: Any, **kwargs: Any) -> Any:
        result = original(self, *args, **kwargs)
        n_samples, n_inliers = len(self.inlier_mask_), int(self.inlier_mask_.sum())
        # With these the user asks for an end of another kind.
        if n_inliers < self.stop_n_inliers and self.stop_score == math.inf:
            k = self.min_samples
            if k is None:
                k = self.n_features_in_ + 1
            elif k < 1:
                k = math.ceil(k * n_samples)
            confidence = float(self.stop_probability)
            note(n_inliers, n_samples, int(k), confidence, self.n_trials_, self.max_trials)
        return result

    return (Replacement(holder=module.RANSACRegressor, name="fit", exact=fit),)


PATCH = LibraryPatch(
    system="scikit-learn",
    requirements=("scikit-learn>=1.2.2,<=1.9.1",),
    modules=("sklearn.linear_model._ransac",),
    plan=plan,
    observe=observe,
    counts_trials=True,
)


def _drop_in() -> type:
    from sklearn.linear_model import RANSACRegressor as Original

    from ransac_fix.patching.engine import exactly, planned

    if not planned(PATCH):
        return Original  # type: ignore[no-any-return]

    class RANSACRegressor(Original):  # type: ignore[misc]
        __doc__ = Original.__doc__
        __module__ = __name__

        @functools.wraps(Original.fit)
        def fit(self, *args: Any, **kwargs: Any) -> Any:
            with exactly(PATCH):
                return super().fit(*args, **kwargs)

    RANSACRegressor.__qualname__ = "RANSACRegressor"
    return RANSACRegressor


def __getattr__(name: str) -> object:
    if name != "RANSACRegressor":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, _drop_in())
