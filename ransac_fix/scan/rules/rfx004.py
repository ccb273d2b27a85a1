"""RFX004, the exponent that is not the size of the sample."""

from collections.abc import Iterator
from typing import ClassVar

from ransac_fix.scan.findings import Certainty, Fix, Related
from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.rules.base import ScannedFile, SiteRule
from ransac_fix.scan.sizes import size_drawn


class WrongExponent(SiteRule):
    """Stopping rule whose exponent is not the size of the sample that is drawn.

    What it does
    ------------
    Compares the exponent of a rule with the number of indices drawn beside it, where both are
    written as numbers; and finds exponents that are the number of data.

    Why is this bad
    ---------------
    The probability of an all-inlier sample has one factor for each point of the sample. With too
    large an exponent the loop runs far too long, with too small a one it ends far too early, and
    nothing else shows it.

    Use instead
    -----------
    One name for the size, in the call that draws and in the rule.

    Fix safety
    ----------
    There is no fix: whether the sample or the exponent is wrong is for the author to say. Nor
    is the power of such a rule replaced under RFX001.
    """

    code = "RFX004"
    name = "wrong-exponent"
    summary = "exponent that is not the size of the sample drawn"
    valid: ClassVar[dict[str, str]] = {
        "The same number.": """
import math, random

def ransac(points, fit):
    trials = 1000.0
    while trials > 0:
        inliers = fit(random.sample(points, 4))
        w = len(inliers) / len(points)
        trials = math.log(0.01) / math.log(1 - w**4)
""",
        "The size is not written here.": """
import math, random

def ransac(points, fit, k):
    trials = 1000.0
    while trials > 0:
        inliers = fit(random.sample(points, k))
        w = len(inliers) / len(points)
        trials = math.log(0.01) / math.log(1 - w**4)
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "Eight for a sample of four.": """
import math, random

def ransac(points, fit):
    trials = 1000.0
    while trials > 0:
        inliers = fit(random.sample(points, 4))
        w = len(inliers) / len(points)
        trials = math.log(0.01) / math.log(1 - w**8)
""",
        "The number of data.": """
import math, random

def ransac(points, fit, w=0.5):
    n = len(points)
    for _ in range(int(math.log(0.01) / math.log(1 - w**n))):
        inliers = fit(random.sample(points, 4))
""",
    }

    def applies(self, read: ReadSite) -> bool:
        """Take the sites whose exponent differs from what is drawn beside them."""
        return size_drawn(read) is not None

    def message(self, read: ReadSite) -> str:
        """Say both numbers."""
        return (
            f"the exponent {read.roles.get('sample_size', 'k')} is not the size of the sample:"
            f" {size_drawn(read)} are drawn"
        )

    def certainty(self, read: ReadSite, certainty: Certainty) -> Certainty:
        """Never be surer than medium: the draw may be another's."""
        del read
        return "medium" if certainty == "high" else certainty

    def fix(self, read: ReadSite, file: ScannedFile) -> Fix | str:
        """Suggest both ways out: which of the two is wrong is for its author to say."""
        del file
        size = read.roles.get("sample_size", "k")
        return f"either draw {size}, or make the exponent {size_drawn(read)}"

    def related(self, read: ReadSite, file: ScannedFile) -> Iterator[Related]:
        """Point at the sampler."""
        if read.draw is not None:
            yield Related(file.location(read.draw.span), "the sample is drawn here")
