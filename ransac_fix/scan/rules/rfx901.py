"""RFX901, the comment that sets nothing aside."""

from collections.abc import Iterable, Iterator
from typing import ClassVar

from ransac_fix.scan.findings import Finding
from ransac_fix.scan.rules.base import Rule, ScannedFile
from ransac_fix.scan.suppressions import Suppression


class UnusedSuppression(Rule):
    """Comment that sets a finding aside where there is none.

    What it does
    ------------
    Finds ``# ransac-fix: ignore[...]`` and ``# noqa: RFX...`` on lines without the finding that
    they name.

    Why is this bad
    ---------------
    The comment says that something is wrong here, and nothing is; and it will hide what is wrong
    later.

    Use instead
    -----------
    Nothing: take the comment away.

    ``# noqa: RFX001`` is read by ruff too, which warns of codes it does not know unless its
    settings have ``lint.external = ["RFX"]``.

    Fix safety
    ----------
    There is no fix: the reason that the comment gives may be worth keeping somewhere else.
    """

    code = "RFX901"
    name = "unused-suppression"
    summary = "comment that sets nothing aside"
    about_code = False
    valid: ClassVar[dict[str, str]] = {
        "It is needed.": """
import math

def ransac_trials(n_inliers, n_samples, k, s):
    w = n_inliers / n_samples
    return math.log(1 - s) / math.log(1 - w**k)  # ransac-fix: ignore[RFX001] -- as published
""",
        "A noqa without a code is not ours.": """
N = 100  # noqa
""",
        "Codes of other tools are not ours.": """
N = 100  # noqa: E501
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "Nothing is wrong here.": """
N = 100  # ransac-fix: ignore[RFX001]
""",
        "The same, as other tools write it.": """
N = 100  # noqa: E501, RFX001
""",
    }

    def check(self, file: ScannedFile) -> Iterator[Finding]:
        """Find nothing before the other rules have."""
        del file
        return iter(())

    def check_unused(self, unused: Iterable[Suppression], file: ScannedFile) -> Iterator[Finding]:
        """Find the comments that are left over."""
        for one in unused:
            codes = ", ".join(one.codes) or "any rule"
            yield Finding(
                self.code,
                file.location(one.span),
                "high",
                f"nothing on this line breaks {codes}: take the comment away",
                expression=file.text.at(one.span),
            )
