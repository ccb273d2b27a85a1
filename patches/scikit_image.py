"""scikit-image: `skimage.measure.ransac`.

The rule is ``_dynamic_max_trials``, called from ``ransac`` in the same module; samples are drawn
without replacement. Up to 0.26 that module is ``skimage.measure.fit``. From 0.27 it is
``_skimage2.measure.fit``, and the old one only re-exports its names. The default of
``max_trials=100`` stays a bound, and the default ``stop_probability=1`` is taken as 1 - 2**-52,
as the library does.

``from ransac_fix.patches.scikit_image import ransac`` is the exact function without any change
for the rest of the program.
"""

import functools
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ransac_fix.patching.interface import LibraryPatch, Replacement
from ransac_fix.patching.rules import count_rule

if TYPE_CHECKING:
    from skimage.measure import ransac

__all__ = ["PATCH", "ransac"]


def plan(module: ModuleType) -> tuple[Replacement, ...]:
    """Return what to replace, in the module where ``ransac`` looks its rule up."""
    return count_rule(
        module,
        "_dynamic_max_trials",
        caller="ransac",
        parameters=("n_inliers", "n_samples", "min_samples", "probability"),
        limit="max_trials",
    )


PATCH = LibraryPatch(
    system="scikit-image",
    requirements=("scikit-image>=0.20,<=0.27.0rc1",),
    modules=("skimage.measure.fit", "_skimage2.measure.fit"),
    plan=plan,
)


def _drop_in() -> Callable[..., Any]:
    from skimage.measure import ransac as original

    from ransac_fix.patching.engine import exactly, planned

    if not planned(PATCH):
        return original  # type: ignore[no-any-return]

    @functools.wraps(original)
    def ransac(*args: Any, **kwargs: Any) -> Any:
        with exactly(PATCH):
            return original(*args, **kwargs)

    ransac.__module__ = __name__
    return ransac


def __getattr__(name: str) -> object:
    if name != "ransac":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals().setdefault(name, _drop_in())
