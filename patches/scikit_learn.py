"""scikit-learn: `sklearn.linear_model.RANSACRegressor`.

The rule is ``_dynamic_max_trials`` in ``sklearn/linear_model/_ransac.py``, called from
``RANSACRegressor.fit``; samples are drawn without replacement. Its default of ``max_trials=100``
stays a bound: raise it where the exact number is larger.

``from ransac_fix.patches.scikit_learn import RANSACRegressor`` is the exact estimator without
any change for the rest of the program.
"""

import functools
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.rules import count_rule

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


PATCH = LibraryPatch(
    system="scikit-learn",
    requirements=("scikit-learn>=1.2.2,<=1.9.1",),
    modules=("sklearn.linear_model._ransac",),
    plan=plan,
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
