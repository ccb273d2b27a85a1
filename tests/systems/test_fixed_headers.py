"""The fixes, measured: OpenGV undersamples, and with headers fixed by ``--fix`` it is exact."""

import os
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from optional_libraries import described

from ransac_fix.audit.judge import judge
from ransac_fix.audit.measure import measure
from ransac_fix.cli import cli

INSTALLED = Path("/usr/include/opengv")
PROBLEMS = ("Ransac<AbsolutePoseSacProblem>(GAO)", "Ransac<PointCloudSacProblem>")


@pytest.fixture(scope="module")
def fixed(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        if INSTALLED.is_dir():
            folder = tmp_path_factory.mktemp("include")
            shutil.copytree(INSTALLED, folder / "opengv")
            result = CliRunner().invoke(cli, ["scan", "--fix", "--no-cache", str(folder)])
            assert "Fixed 1 finding in 1 file." in result.stderr
            # Of several sets of data the pooled counts are not the probability.
            assert "--unsafe-fixes would fix 1 more." in result.stderr
            known = os.environ.get("CPATH")
            patch.setenv("CPATH", os.pathsep.join([str(folder), *([known] if known else [])]))
        yield from described("opengv", "apt-get install libopengv-dev libeigen3-dev g++")


@pytest.mark.parametrize("problem", PROBLEMS)
def test_fixed_headers_are_exact_by_measurement(fixed, problem):
    host, entry_points, _ = fixed
    verdict, _ = judge(found := measure(host, entry_points[problem]))
    assert verdict == "exact"
    assert found.fit.law.assumed != "approximate"
    assert found.sampler.drawn == "distinct"
