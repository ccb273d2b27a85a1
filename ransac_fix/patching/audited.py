"""Patch a library for the audit, in the process that measures it."""

from collections.abc import Callable

from ransac_fix.patching.engine import patch, status
from ransac_fix.patching.plugins import discover

__all__ = ["patch_for_audit"]


def patch_for_audit(system: str) -> Callable[[], str | None]:
    """Patch a system, and return what to ask once its library is imported.

    Parameters
    ----------
    system : str
        Its name.

    Returns
    -------
    callable
        Why the patched library cannot be measured, in one sentence; None where it can.
    """
    patch(system)

    def unmeasurable() -> str | None:
        state = next(one.state for one in status().systems if one.system == system)
        if state != "patched" or not discover().patches[system].wraps:
            return None
        return (
            "the patch draws the missing trials on fresh samples, so no point of its rule lies on"
            " one random stream; its numbers of trials and its outcomes are tested instead"
        )

    return unmeasurable
