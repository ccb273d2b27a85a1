"""RFX002, the trial budget from an assumed ratio."""

from typing import ClassVar

from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.rules.base import SiteRule, power_of


class ApproximateTrialBudget(SiteRule):
    """Number of trials worked out once, from an assumed inlier ratio, with the approximate power.

    What it does
    ------------
    Finds ``log(1 - s) / log(1 - w**k)`` where w is an assumption (a constant, a setting, a
    parameter) rather than the ratio of the inliers found so far.

    Why is this bad
    ---------------
    As in RFX001, the power is the probability for samples drawn with replacement, and the budget
    is too small for the confidence it was made for. How much depends on the number of data: with
    w = 0.5 and k = 4, a budget for 20 points is too small by a factor of 1.5, for 1000 by 1.006.

    Use instead
    -----------
    .. code-block:: python

        n_inliers = math.floor(w * n_samples)
        trials = ransac_fix.required_trials(n_inliers, n_samples, k, s)

    and let the loop stop earlier, by the same rule, when it has found more.

    Fix safety
    ----------
    Unsafe: the fix takes ``round(w * n_samples)`` for the number of inliers, where the sampler
    beside it shows how many data there are. Otherwise there is none.
    """

    code = "RFX002"
    name = "approximate-trial-budget"
    summary = "trial budget from an assumed ratio with the power of that ratio"
    valid: ClassVar[dict[str, str]] = {
        "A fixed number of trials assumes nothing.": """
def ransac(points, fit, max_trials=1000):
    for _ in range(max_trials):
        inliers = fit(points)
""",
        "The expected number of inliers, and the exact probability.": """
from math import comb, floor, log

def ransac_budget(n_samples, sample_size, inlier_ratio=0.5, confidence=0.99):
    n_inliers = floor(inlier_ratio * n_samples)
    p = comb(n_inliers, sample_size) / comb(n_samples, sample_size)
    return log(1 - confidence) / log(1 - p)
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "Constants for everything.": """
import math

# settings of ransac
n = 6
epsilon = 0.1
p = 0.99
N = int(math.log(1 - p) / math.log(1 - (1 - epsilon) ** n))
""",
        "A setting with a default.": """
import numpy as np

def calculate_num_ransac_iterations(prob_success, sample_size, ind_prob_correct=0.5):
    numerator = np.log(1 - prob_success)
    denominator = np.log(1 - ind_prob_correct**sample_size)
    return int(numerator / denominator)
""",
    }

    def applies(self, read: ReadSite) -> bool:
        """Take the budgets, with samples not known to repeat."""
        return not read.adaptive and read.sampler != "replacement"

    def message(self, read: ReadSite) -> str:
        """Say which power the budget was made with."""
        return (
            f"the number of trials is made with {power_of(read)}, the probability of an all-inlier"
            " sample drawn with replacement; for distinct samples it is too small"
        )
