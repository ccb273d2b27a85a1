"""Find, measure and fix the wrong stopping criterion in RANSAC code.

The public names are loaded when they are first used, so that ``import ransac_fix`` costs
nothing in a program that only wants its libraries patched.

With a pytest plugin in the package, pytest would warn that it was imported too early to have its
assertions rewritten wherever `ransac-fix site enable` is in force: PYTEST_DONT_REWRITE.
"""

from ransac_fix._version import __version__

TYPE_CHECKING = False  # what type checkers take for true; `typing` takes too long to import
if TYPE_CHECKING:
    from ransac_fix.criterion import (
        Stratum,
        all_inlier_probability,
        approximate_all_inlier_probability,
        approximate_required_trials,
        required_trials,
        success_probability,
        true_success_probability,
        undersampling,
    )
    from ransac_fix.errors import PatchNotApplicable, RansacFixError, RansacFixWarning
    from ransac_fix.patching import patch, patched, status, unpatch
    from ransac_fix.patching.tracing import trace

__all__ = [
    "PatchNotApplicable",
    "RansacFixError",
    "RansacFixWarning",
    "Stratum",
    "__version__",
    "all_inlier_probability",
    "approximate_all_inlier_probability",
    "approximate_required_trials",
    "patch",
    "patched",
    "required_trials",
    "status",
    "success_probability",
    "trace",
    "true_success_probability",
    "undersampling",
    "unpatch",
]

_HOME = {
    "PatchNotApplicable": "errors",
    "RansacFixError": "errors",
    "RansacFixWarning": "errors",
    "patch": "patching",
    "patched": "patching",
    "status": "patching",
    "trace": "patching.tracing",
    "unpatch": "patching",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value: object = getattr(import_module(f"ransac_fix.{_HOME.get(name, 'criterion')}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
