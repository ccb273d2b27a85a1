"""RFX001, the adaptive stopping rule."""

from typing import ClassVar

from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.rules.base import SiteRule, power_of, product_of


class ApproximateStoppingRule(SiteRule):
    """Adaptive stopping rule with the approximate probability of an all-inlier sample.

    What it does
    ------------
    Finds the rule that ends a RANSAC loop, ``log(1 - s) / log(1 - P)`` in any of its forms, where
    P is worked out as ``(n_inliers / n_samples) ** sample_size`` from the inliers found so far.

    Why is this bad
    ---------------
    The power is the probability for samples drawn with replacement. Minimal samples are drawn
    without, and then the probability is smaller,
    ``C(n_inliers, sample_size) / C(n_samples, sample_size)``: each inlier drawn leaves one less
    to draw. With the power the loop ends before the trials that the confidence asks for, the
    earlier the fewer inliers there are: up to ``k**k / k!`` times too early, 4.5 times for planes
    (k = 3), 10.7 for homographies (k = 4), 163 for fundamental matrices (k = 7).

    Use instead
    -----------
    .. code-block:: python

        p = 1.0
        for i in range(sample_size):
            p *= (n_inliers - i) / (n_samples - i)
        trials = math.log(1 - confidence) / math.log(1 - p)

    or ``ransac_fix.required_trials(n_inliers, n_samples, sample_size, confidence)``, which is the
    exact integer and has no special cases left to guard.

    Fix safety
    ----------
    ``--fix`` puts a call of a small function, which it adds to the file, for the power. That is
    safe where both counts stand there with the values that the ratio was made of; it is unsafe
    where only names say that they are counts, or where callers in other files pass the ratio,
    and the finding says what to check. Where only a ratio is known there is no fix, and the
    finding says where it comes from.

    References
    ----------
    J. Schönberger, V. Larsson, M. Pollefeys, "Fixing the RANSAC Stopping Criterion", ICCV 2025,
    section 3.
    """

    code = "RFX001"
    name = "approximate-stopping-rule"
    summary = "adaptive stopping rule with the power of the inlier ratio"
    valid: ClassVar[dict[str, str]] = {
        "The product over the sample is exact.": """
import math

def ransac_trials(n_inliers, n_samples, sample_size, confidence):
    p = 1.0
    for i in range(sample_size):
        p *= (n_inliers - i) / (n_samples - i)
    return math.log(1 - confidence) / math.log(1 - p)
""",
        "Binomial coefficients are exact.": """
from math import comb, log

def ransac_trials(n_inliers, n_samples, sample_size, confidence):
    p = comb(n_inliers, sample_size) / comb(n_samples, sample_size)
    return log(1 - confidence) / log(1 - p)
""",
        "A plain success rate has no power in it.": """
import math

def ransac_restarts(confidence, success_rate):
    return math.ceil(math.log(1 - confidence) / math.log(1 - success_rate))
""",
        "LSH bands have the same algebra and another meaning.": """
def collision_probability(similarity, rows, bands):
    return 1 - (1 - similarity**rows) ** bands
""",
        "A comment is not code.": """
# ransac: N = log(1 - p) / log(1 - w**k)
N = 100
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "The rule as the textbooks have it.": """
import math

def ransac_trials(n_inliers, n_samples, sample_size, confidence):
    w = n_inliers / n_samples
    return math.log(1 - confidence) / math.log(1 - w**sample_size)
""",
        "Numerator and denominator apart and clipped.": """
import numpy as np

def ransac_trials(n_inliers, n_samples, min_samples, probability):
    inlier_ratio = n_inliers / float(n_samples)
    nom = max(np.spacing(1), 1 - probability)
    denom = max(np.spacing(1), 1 - inlier_ratio**min_samples)
    if denom == 1:
        return float("inf")
    return abs(float(np.ceil(np.log(nom) / np.log(denom))))
""",
        "Names that are bound again, and the ratio of outliers.": """
import math

def ransac(points, fit, confidence=0.99):
    trials, best = 1000, 0
    while trials > 0:
        inliers = fit(points)
        eps = 1 - len(inliers) / len(points)
        d = 1 - (1 - eps) ** 4
        d = math.log(d)
        trials = min(trials, math.log(1 - confidence) / d)
""",
        "No logarithm at all: the loop tests the probability itself.": """
def ransac(points, fit, confidence):
    trials = 0
    while True:
        trials += 1
        w = len(fit(points)) / len(points)
        inlier_ratio = w
        if 1 - (1 - inlier_ratio**3) ** trials > confidence:
            break
""",
        "The power written out as a product.": """
from math import log1p

def ransac_trials(inliers, total, confidence):
    w = inliers / total
    return log1p(-confidence) / log1p(-w * w * w)
""",
    }

    def applies(self, read: ReadSite) -> bool:
        """Take the rules that use what the run finds, with samples not known to repeat."""
        return read.adaptive and read.sampler != "replacement"

    def message(self, read: ReadSite) -> str:
        """Say which power stands where which product belongs."""
        if read.site.form == "inverse":
            return (
                "the number of inliers that would have been seen by now is worked out as if samples"
                " were drawn with replacement; without it is larger, and the search stops too early"
            )
        return (
            f"the stopping rule takes {power_of(read)} for the probability of an all-inlier"
            f" sample; without replacement it is {product_of(read)}, which asks for more trials"
        )
