"""RFX003, the rule beside a sampler that repeats."""

from collections.abc import Iterator
from typing import ClassVar

from ransac_fix.scan.findings import Fix, Related
from ransac_fix.scan.fixes import fix_sampler
from ransac_fix.scan.reading import ReadSite
from ransac_fix.scan.rules.base import ScannedFile, SiteRule, power_of


class SampleWithReplacement(SiteRule):
    """Stopping rule with a power, beside a minimal sample that is drawn with replacement.

    What it does
    ------------
    Finds the rules of RFX001 and RFX002 in files that draw their minimal sample with replacement:
    ``np.random.randint(n, size=k)``, ``np.random.choice(n, k)`` with its default,
    ``random.choices``, ``rng.integers``, ``torch.randint``; and one index at a time that nothing
    compares with those drawn before, in C and C++ too (``rand() % n``, a uniform distribution).

    Why is this bad
    ---------------
    The sample may hold one point twice, and then it defines no model. A useful sample has
    distinct points, so the probability of an all-inlier one is
    ``n_inliers * (n_inliers - 1) * ... / n_samples**k``, smaller than the power and smaller than
    what drawing without replacement would give. Replacing the power alone would be wrong here:
    sampler and rule belong together.

    Use instead
    -----------
    .. code-block:: python

        sample = rng.choice(n_samples, size=sample_size, replace=False)

    and the rule of RFX001.

    Fix safety
    ----------
    Unsafe: the fix changes the sampler together with the rule, so other samples are drawn.
    Where the call that draws has no form for distinct samples, both are left alone.
    """

    code = "RFX003"
    name = "sample-with-replacement"
    summary = "stopping rule with a power, and a minimal sample drawn with replacement"
    valid: ClassVar[dict[str, str]] = {
        "Distinct samples are RFX001.": """
import math, random

def ransac(points, fit, k, confidence):
    trials = 1000
    while trials > 0:
        inliers = fit(random.sample(points, k))
        w = len(inliers) / len(points)
        trials = math.log(1 - confidence) / math.log(1 - w**k)
""",
        "One index at a time, but never the same twice.": """
import math, random

def ransac(points, fit, k, confidence):
    trials = 1000
    while trials > 0:
        sample = []
        while len(sample) < k:
            i = random.randrange(len(points))
            if i not in sample:
                sample.append(i)
        w = len(fit(sample)) / len(points)
        inlier_trials = math.log(1 - confidence) / math.log(1 - w**k)
""",
    }
    invalid: ClassVar[dict[str, str]] = {
        "choice repeats by default.": """
import numpy as np

def ransac(points, fit, k, confidence):
    trials = 1000
    while trials > 0:
        sample = np.random.choice(len(points), k)
        inliers = fit(points[sample])
        w = len(inliers) / len(points)
        trials = np.log(1 - confidence) / np.log(1 - w**k)
""",
        "One index at a time, unchecked.": """
import math, random

def ransac(points, fit, k, confidence):
    trials = 1000
    while trials > 0:
        sample = [random.randint(0, len(points) - 1) for _ in range(k)]
        inliers = fit(sample)
        w = len(inliers) / len(points)
        trials = math.log(1 - confidence) / math.log(1 - w**k)
""",
    }

    def applies(self, read: ReadSite) -> bool:
        """Take the sites whose samples may repeat a point."""
        return read.sampler == "replacement"

    def message(self, read: ReadSite) -> str:
        """Say that neither the power nor the product fits the sampler."""
        return (
            f"the rule takes {power_of(read)}, but the sample is drawn with replacement and may"
            " repeat a point: draw distinct samples and use the exact probability"
        )

    def fix(self, read: ReadSite, file: ScannedFile) -> Fix | str:
        """Change sampler and rule together, or neither."""
        rule = super().fix(read, file)
        if isinstance(rule, str):
            return rule
        source = file.source()
        sampler = source if isinstance(source, str) else fix_sampler(read, source, file.path)
        if isinstance(sampler, str):
            return sampler
        return Fix(
            f"{sampler.message}, and {rule.message}",
            safe=False,
            edits=(*sampler.edits, *rule.edits),
        )

    def related(self, read: ReadSite, file: ScannedFile) -> Iterator[Related]:
        """Point at the sampler."""
        yield from super().related(read, file)
        if read.draw is not None:
            yield Related(file.location(read.draw.span), "the sample is drawn here")
