"""`ransac-fix trace`: programs, their worker processes, and the two forms of the report."""

import io
import json
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
from rich.console import Console

import ransac_fix
from ransac_fix.patching.summary import NOT_VISIBLE, TraceReport
from ransac_fix.report.trace_json import trace_json
from ransac_fix.report.trace_text import print_trace

RunPython = Callable[..., subprocess.CompletedProcess[str]]

CALL = """
import cv2, numpy as np
rng = np.random.default_rng(0)
x, y = rng.uniform(0, 1000, (2, 60, 2))
y[:25] = x[:25] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
def work(_=None):
    return int(cv2.findHomography(x, y, cv2.RANSAC, 1.0)[1].sum())
"""


@pytest.fixture
def trace(run_python: RunPython, tmp_path: Path) -> Callable[..., Any]:
    """Trace a program; return what it did, and the report."""

    def run(*args: str | Path, **environ: str) -> tuple[Any, Any]:
        file = tmp_path / "report.json"
        environ = {"PYTHONPATH": str(tmp_path), **environ}
        line = ["-m", "ransac_fix", "trace", "--json", file, *args]
        done = run_python(*line, environ=environ)
        return done, json.loads(file.read_text()) if file.exists() else None

    return run


def test_a_script(trace: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(
        f"{CALL}\nimport sys\nprint(work() == work(), sys.argv[1:], __name__)\nsys.exit(5)\n"
    )
    done, report = trace("program.py", "--json", "-m", "x y")
    assert done.stdout.strip() == "True ['--json', '-m', 'x y'] __main__"
    assert (done.returncode, done.stderr) == (5, "")
    (site,) = report["sites"]
    assert (site["function"], site["calls"], site["caller"]) == ("findHomography", 2, "work")
    assert site["file"] == str(tmp_path / "program.py")
    assert site["short"] == 2
    jsonschema.validate(report, schema())


def test_a_module_and_the_terminal(run_python: RunPython, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(f"{CALL}\nprint(work() > 0)\n")
    environ = {"PYTHONPATH": str(tmp_path)}
    done = run_python("-m", "ransac_fix", "trace", "-m", "program", environ=environ)
    assert (done.stdout, done.returncode) == ("True\n", 0)
    text = " ".join(done.stderr.split())
    assert "program.py:7 opencv findHomography" in text
    assert "1 call in work" in text
    assert "1 RANSAC call at 1 call site in 1 process" in text
    assert "1 short of the guarantee" in text
    assert "remedy: make opencv exact" in text
    assert NOT_VISIBLE in text


def test_a_program_that_is_killed(trace: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(f"{CALL}\nimport os\nwork()\nos.kill(os.getpid(), 9)\n")
    done, report = trace("program.py")
    assert (done.returncode, report["calls"]) == (137, 1)


WORKERS = (
    CALL
    + """
import multiprocessing, subprocess, sys
if __name__ == "__main__":
    import contextlib
    import ransac_fix
    with {block}:
        for method in ("fork", "spawn", "forkserver"):
            with multiprocessing.get_context(method).Pool(2) as pool:
                pool.map(work, range(4), chunksize=1)
        from joblib import Parallel, delayed
        Parallel(2, backend="loky")(delayed(work)() for _ in range(4))
        subprocess.run([sys.executable, "-c", "import workers; workers.work()"], check=True)
        work()
    {after}
"""
)


def test_worker_processes(trace: Callable[..., Any], tmp_path: Path) -> None:
    source = WORKERS.format(block="contextlib.nullcontext()", after="")
    (tmp_path / "workers.py").write_text(source)
    done, report = trace("workers.py")
    assert done.returncode == 0, done.stderr
    assert report["calls"] == report["short"] == 3 * 4 + 4 + 1 + 1
    assert report["processes"] > 4


def test_worker_processes_of_a_block(run_python: RunPython, tmp_path: Path) -> None:
    source = WORKERS.format(block="ransac_fix.trace() as t", after="print(t.report.calls)")
    (tmp_path / "workers.py").write_text(source)
    done = run_python("workers.py")
    assert done.stdout.split() == ["18"], done.stderr


def test_a_patched_program(trace: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(f"import ransac_fix.auto\n{CALL}\nwork()\n")
    _, report = trace("program.py", RANSAC_FIX_SLACK="0")
    (site,) = report["sites"]
    assert (site["patched"], site["short"]) == (1, 0)
    assert site["trials"] == site["needed"]


def test_patching_begins_before_the_library_is_imported(
    trace: Callable[..., Any], tmp_path: Path
) -> None:
    """The engine takes over the import hook, and keeps on watching."""
    (tmp_path / "program.py").write_text(
        f"import ransac_fix\nransac_fix.patch('scikit-learn')\n{CALL}\nwork()\n"
    )
    assert trace("program.py")[1]["calls"] == 1


def test_no_library(trace: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text("print('nothing')\n")
    done, report = trace("program.py")
    assert done.stdout == "nothing\n"
    assert (report["calls"], report["sites"]) == (0, [])
    jsonschema.validate(report, schema())


@pytest.mark.parametrize(
    ("args", "environ", "message"),
    [
        (["no/such.py"], {}, "there is no file 'no/such.py'"),
        (["-m", "json.tool"], {"RANSAC_FIX": "0"}, "nothing can be traced"),
        (["--json", "no/such/folder.json", "-m", "json.tool"], {}, "there is no folder"),
        (["--sample", "5", "-m", "json.tool"], {}, "add --verify"),
    ],
)
def test_bad_arguments(
    run_python: RunPython, args: list[str], environ: dict[str, str], message: str
) -> None:
    done = run_python("-m", "ransac_fix", "trace", *args, environ=environ)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_library_of_unknown_shape_is_named(trace: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "pydegensac").mkdir()
    (tmp_path / "pydegensac" / "__init__.py").write_text("def findHomography(x): return x\n")
    (tmp_path / "program.py").write_text("import pydegensac; print(pydegensac.findHomography(3))\n")
    done, report = trace("program.py")
    assert (done.stdout, done.stderr) == ("3\n", "")
    assert "takes no pts1_" in report["left_out"]["pydegensac"]


def schema() -> Any:
    return json.loads(files("ransac_fix.report").joinpath("schemas/trace.json").read_text())


def test_the_published_schema_is_that_of_the_model() -> None:
    assert schema() == json.loads(json.dumps(msgspec.json.schema(TraceReport)))


def test_text_of_every_kind_of_call() -> None:
    import cv2
    import numpy as np

    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1000, (2, 60, 2))
    y[:25] = x[:25] + 5
    with ransac_fix.trace() as t:
        for limit in (20, 100_000):
            for method in (cv2.RANSAC, 0):
                cv2.findHomography(x, y, method, 1.0, maxIters=limit)
        with pytest.raises(cv2.error):
            cv2.findHomography(x[:2], y[:2], cv2.RANSAC, 1.0)
    stream = io.StringIO()
    print_trace(t.report, Console(file=stream, width=80))
    assert all(line == line.rstrip() for line in stream.getvalue().splitlines())
    text = " ".join(stream.getvalue().split())
    for part in (
        "bound by the rule 1, a cap 1",
        "20 trials (limit 20) where",
        "2 could not be read",
        "1 raised an exception",
        "raise the limit on trials to",
        "It is not the success rate of a run",
    ):
        assert part in text
    jsonschema.validate(json.loads(trace_json(t.report)), schema())
    assert sys.getsizeof(str(t.report)) > 0
