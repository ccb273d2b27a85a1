"""How the sampler beside a rule is read."""

import pytest

from ransac_fix.scan import python
from ransac_fix.scan.reading import Text
from ransac_fix.scan.scanner import read

LOOP = """
import math, random
import numpy as np
import torch
rng = np.random.default_rng()

def ransac(points, fit, k, s):
    n = len(points)
    N = 1000
    while N > 0:
        {draw}
        w = len(fit(sample)) / n
        N = math.log(1 - s) / math.log(1 - w**k)
"""

DRAWS = {
    "sample = random.sample(points, k)": "distinct",
    "sample = np.random.choice(n, k, replace=False)": "distinct",
    "sample = rng.choice(n, size=k, replace=False)": "distinct",
    "sample = np.random.permutation(n)[:k]": "distinct",
    "sample = torch.randperm(n)[:k]": "distinct",
    "sample = points.sample(n=k)": "distinct",
    "sample = torch.topk(torch.rand(n), k)[1]": "distinct",
    "sample = np.random.choice(n, k)": "replacement",
    "sample = np.random.choice(n, size=k)": "replacement",
    "sample = np.random.choice(n, k, True)": "replacement",
    "sample = np.random.randint(0, n, k)": "replacement",
    "sample = np.random.randint(n, size=k)": "replacement",
    "sample = rng.integers(0, n, size=k)": "replacement",
    "sample = random.choices(points, k=k)": "replacement",
    "sample = torch.randint(0, n, (k,))": "replacement",
    "sample = [random.randint(0, n - 1) for _ in range(k)]": "replacement",
    "sample = [random.choice(points) for _ in range(k)]": "replacement",
    "sample = np.random.choice(n, k, p=weights)": "weighted",
    "sample = rng.choice(n, k, replace=False, p=weights)": "weighted",
    "sample = random.choices(points, weights, k=k)": "weighted",
    "sample = pick(points, k)": "unknown",
}


@pytest.mark.parametrize(("draw", "law"), DRAWS.items())
def test_reads_the_law_of_a_draw(draw, law):
    source = LOOP.format(draw=draw)
    (found,) = read(python.parse(source), Text(source), "ransac.py")
    assert found.sampler == law


def test_a_draw_that_checks_for_repeats_is_distinct():
    source = LOOP.format(
        draw="""sample = np.random.randint(0, n, k)
        while len(set(sample)) < k:
            sample = np.random.randint(0, n, k)"""
    )
    (found,) = read(python.parse(source), Text(source), "ransac.py")
    assert found.sampler == "distinct"


def test_whether_a_whole_sample_was_drawn_before_says_nothing_of_repeats_in_it():
    source = LOOP.format(
        draw="""sample = np.random.randint(0, n, k)
        if sample in tried: continue"""
    )
    (found,) = read(python.parse(source), Text(source), "ransac.py")
    assert found.sampler == "replacement"


def test_the_draw_in_the_loop_counts_not_the_one_that_makes_data():
    source = LOOP.format(draw="sample = random.sample(points, k)").replace(
        "    N = 1000", "    noise = np.random.randint(0, 9, n)\n    N = 1000"
    )
    (found,) = read(python.parse(source), Text(source), "ransac.py")
    assert found.sampler == "distinct"
    assert found.draw is not None
    assert found.draw.span.line == 12


def test_the_finding_points_at_the_sampler():
    from ransac_fix.scan.files import SourceFile
    from ransac_fix.scan.scanner import scan_source

    source = LOOP.format(draw="sample = np.random.choice(n, k)")
    (finding,), errors = scan_source(source, SourceFile("ransac.py", "python", named=True))
    assert not errors
    assert finding.code == "RFX003"
    (related,) = finding.related
    assert (related.location.start_line, related.message) == (11, "the sample is drawn here")
