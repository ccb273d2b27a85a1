"""Scanning with several processes, here and on a cluster, gives what one process gives."""

from pathlib import Path

import distributed
import pytest
from click.testing import CliRunner

from ransac_fix.cli import cli
from ransac_fix.errors import RansacFixError
from ransac_fix.scan import ScanResult, scan_paths

RULE = "import math\ndef ransac(w, k, s):\n    return math.log(1 - s) / math.log(1 - w**k)\n"


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("tree")
    for number in range(230):
        text = RULE if number % 10 == 0 else f"import os  # {number}\n"
        if number % 50 == 1:
            text = "def ransac(:\n    log(1 - w**k)\n"
        (folder / f"m{number:03}.py").write_text(text)
    (folder / "kernel.cu").write_text(
        "int ransac(int i, int n) { return log(0.1) / log(1 - pow((double)i / n, 3)); }\n"
    )
    (folder / "gone.py").symlink_to(folder / "missing.py")
    return folder


@pytest.fixture(scope="module")
def alone(tree) -> ScanResult:
    return scan_paths([tree])


def test_the_tree_holds_what_it_should(alone):
    assert len(alone.findings) == 24
    assert len(alone.errors) == 5


def test_processes_give_the_same(tree, alone):
    seen: list[tuple[int, int]] = []
    result = scan_paths([tree], jobs=2, progress=lambda done, total: seen.append((done, total)))
    assert result == alone
    assert seen[-1] == (231, 231)
    assert seen == sorted(seen)
    assert len(seen) > 1


def test_a_cluster_gives_the_same(tree, alone, tmp_path):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        seen: list[tuple[int, int]] = []
        address = cluster.scheduler_address
        result = scan_paths(
            [tree],
            dask_scheduler=address,
            cache=tmp_path / "cache",
            progress=lambda done, total: seen.append((done, total)),
        )
        assert result == alone
        assert seen[-1] == (231, 231)
        assert len(cluster.scheduler.workers) == 2
        command = ["scan", "--dask", address, "--output-format", "concise", str(tree)]
        output = CliRunner().invoke(cli, command)
        assert output.exit_code == 1
        assert output.stdout.count("RFX001") == 24
        with pytest.raises(RansacFixError, match="RFX101 asks about this environment"):
            scan_paths([tree], dask_scheduler=address, select=["RFX101"])


def test_a_scheduler_that_is_not_there_is_an_error(tree):
    with pytest.raises(RansacFixError, match="no dask scheduler at nonsense"):
        scan_paths([tree], dask_scheduler="nonsense")
