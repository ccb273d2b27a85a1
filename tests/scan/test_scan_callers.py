"""Ratios without their counts: where a finding says that they come from."""

import textwrap

import pytest

from ransac_fix.scan import scan_paths, scan_text

RULE = """
#include <cmath>
inline int trials(double inlier_ratio, int k, double s) {
  return std::ceil(std::log(1 - s) / std::log(1 - std::pow(inlier_ratio, k)));
}
"""
CALLER = """
#include "rule.h"
void Ransac::run() {
  stats.inlier_ratio =
      static_cast<double>(n_inliers) / n_data;
  max_trials = trials(stats.inlier_ratio, 3, 0.99);
}
void other() { schema.trials(); }
"""


def test_calls_from_other_files_are_listed_with_the_line_that_divides(tmp_path):
    (tmp_path / "rule.h").write_text(RULE)
    (tmp_path / "ransac.cpp").write_text(CALLER)
    (finding,) = scan_paths([tmp_path]).findings
    assert finding.fix is None
    assert "trials is not called in this file: let it and its callers pass" in finding.no_fix
    (related,) = finding.related
    assert related.location.path == str(tmp_path / "ransac.cpp")
    assert related.location.start_line == 6
    assert related.message == (
        "called here, with stats.inlier_ratio of line 4: trials(stats.inlier_ratio, 3, 0.99)"
    )


def test_a_call_in_another_language_is_another_function(tmp_path):
    (tmp_path / "rule.h").write_text(RULE)
    (tmp_path / "ransac.py").write_text("trials(n_inliers / n, 3, 0.99)\n")
    (finding,) = scan_paths([tmp_path]).findings
    assert finding.related == ()


def test_many_calls_are_counted(tmp_path):
    rule = """
        from math import log

        def ransac_trials(w, k, s):
            return log(1 - s) / log(1 - w**k)
    """
    (tmp_path / "rule.py").write_text(textwrap.dedent(rule))
    (tmp_path / "calls.py").write_text("ransac_trials(w, k=3, s=0.99)\n" * 7)
    (tmp_path / "broken.py").write_text("ransac_trials(\n")
    (finding,) = scan_paths([tmp_path]).findings
    assert len(finding.related) == 5
    assert finding.related[-1].message.endswith(", and 2 more")


BODY = """import math

class Ransac:
    def run(self, data, s, k):
        trials = 1000
        while trials > 0:
            best = self.fit(data)
            {made}
            trials = min(trials, math.log(1 - s) / math.log(1 - w**k))
"""


@pytest.mark.parametrize(
    ("made", "why"),
    [
        ("w = inlier_ratio(best)", "it is what inlier_ratio gives, called in line 8"),
        ("w = best.ratio", "it is the member ratio of best, which this file does not set"),
        ("w = len(best) / len(data) + 0.1", "it is changed in line 8"),
    ],
)
def test_a_ratio_without_counts_is_traced_to_where_it_is_made(made, why):
    (finding,) = scan_text(BODY.format(made=made).encode(), "a.py", ignore=["RFX005"]).findings
    assert finding.fix is None
    assert why in finding.no_fix


def test_the_lines_that_set_a_member_are_named():
    source = BODY.format(made="w = best.ratio") + "\n    def fit(self, d):\n        r.ratio = 1\n"
    (finding,) = scan_text(source.encode(), "a.py", ignore=["RFX005"]).findings
    assert "the member ratio of best, set in line 12: keep both counts" in finding.no_fix
