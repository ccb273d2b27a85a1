"""The controls of an audit, in words."""

from collections.abc import Iterator, Sequence

from ransac_fix.audit.model import Control


def controls_summary(controls: Sequence[Control]) -> str:
    """Return how many known laws were identified."""
    if not controls:
        return "no controls, as there was nothing to measure"
    passed = sum(control.passed for control in controls)
    return f"{passed} of {len(controls)} controls identified"


def failure_lines(controls: Sequence[Control]) -> Iterator[str]:
    """Yield a line for each known law that was taken for another."""
    for control in controls:
        if not control.passed:
            yield (
                f"control failed: {control.name}: put in {control.expected}, "
                f"found {control.identified}"
            )
