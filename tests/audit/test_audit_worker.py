"""A library that crashes, hangs, raises or prints does not take the audit with it."""

import ast
import sys
import textwrap
import time
from pathlib import Path

import pytest

from ransac_fix.audit import host, session, worker
from ransac_fix.audit.host import WorkerFailed, WorkerHost
from ransac_fix.audit.proof import Controls
from ransac_fix.audit.session import Options

HEAD = """
import os, sys, time
from ransac_fix.audit.worker.interface import EntryPoint, Outcome, Probe, Unmeasured

def is_pipe(fd):
    try:
        return os.readlink(f"/proc/self/fd/{{fd}}").startswith("pipe:")
    except OSError:
        return False

def misbehave(planted, settings, seed):
    {body}

def fine(planted, settings, seed):
    print("noise on standard output")
    os.write(1, b"noise below Python\\n")
    return Outcome(planted.labels == planted.labels.max())

def entry_points(module):
    return [
        EntryPoint("first", "line", 2, misbehave),
        EntryPoint("second", "line", 2, fine),
        Unmeasured("third", "has no stopping rule"),
    ]

PROBE = Probe("invented", "{module}", ("no-such-distribution",), entry_points)
"""


def probe(tmp_path: Path, body: str, module: str = "json") -> Path:
    file = tmp_path / "invented.py"
    file.write_text(HEAD.format(body=body, module=module))
    return file


def audit(file: Path, seconds: float = 20.0):
    options = Options((), sys.executable, seconds)
    job = session._Job("invented", file)
    crew = session._Crew([job], options, lambda _: None, Controls(seconds))
    crew._drive(job)
    return job.verdicts() if job.installed else None


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("os.abort()", "crashed with SIGABRT"),
        ("sys.stderr.write('last words'); sys.stderr.flush(); os._exit(3)", "last words"),
        ("raise RuntimeError('not today')", "RuntimeError: not today"),
        ("import ctypes; ctypes.string_at(0)", "crashed with SIGSEGV"),
        # Into the pipe that answers go through, whichever it is.
        (
            "[os.write(fd, b'{') for fd in range(3, 30) if is_pipe(fd)]; os._exit(4)",
            "exited with 4",
        ),
    ],
)
def test_a_crash_is_a_verdict_and_the_next_entry_point_is_measured(tmp_path, body, reason):
    verdicts = audit(probe(tmp_path, body))
    assert [v.entry_point for v in verdicts] == ["first", "second", "third"]
    assert all(v.verdict == "not measured" for v in verdicts)
    assert reason in verdicts[0].reason
    # The second one finds the larger model at once, so its streams show no rule: it was run.
    assert verdicts[1].runs > 0
    assert verdicts[2].reason == "has no stopping rule"


@pytest.mark.skipif(sys.platform != "linux", reason="pipes are told by /proc")
def test_a_library_that_closes_the_pipe_of_the_answers_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(host, "_LAST_SECONDS", 0.2)
    body = "[os.close(fd) for fd in range(3, 30) if is_pipe(fd)]; time.sleep(1000)"
    verdicts = audit(probe(tmp_path, body))
    assert verdicts[0].reason == "closed the pipe that its answers go through"
    assert verdicts[1].runs > 0


def test_a_hang_is_a_verdict_after_its_time(tmp_path):
    started = time.monotonic()
    verdicts = audit(probe(tmp_path, "time.sleep(1000)"), seconds=3.0)
    assert "no answer within its time (3 s)" in verdicts[0].reason
    assert time.monotonic() - started < 30


def test_output_of_the_library_does_not_mix_with_answers(tmp_path):
    with WorkerHost(probe(tmp_path, "pass"), sys.executable, 20) as asked:
        assert asked.ask("describe")["version"] != ""
        case = {"entry_point": "second", "cases": [[5, 3, 1, "groups", []]], "seed": 0}
        assert asked.ask("hits", **case)["hits"] == [True]


def test_a_library_that_is_absent_is_not_installed(tmp_path):
    assert audit(probe(tmp_path, "pass", module="no_such_library")) is None


def test_a_library_that_fails_to_import_says_why(tmp_path):
    broken = tmp_path / "broken_library.py"
    broken.write_text("import another_missing_module\n")
    file = probe(tmp_path, "pass", module="broken_library")
    text = file.read_text().replace(
        "import os,", f"import os; sys_path = {str(tmp_path)!r}\nimport"
    )
    file.write_text(text.replace("import time", "import time\nsys.path.insert(0, sys_path)", 1))
    file.write_text(
        textwrap.dedent(file.read_text()).replace(
            "from ransac_fix", "sys.path.insert(0, sys_path)\nfrom ransac_fix", 1
        )
    )
    verdicts = audit(file)
    assert verdicts is not None
    assert verdicts[0].verdict == "not measured"
    assert "another_missing_module" in verdicts[0].reason


@pytest.mark.skipif(sys.platform != "linux", reason="preloading is for Linux")
def test_a_worker_starts_again_with_what_its_probe_wants_loaded_first(tmp_path, monkeypatch):
    monkeypatch.setenv("LD_PRELOAD", "")
    mapped = "'libresolv' in open('/proc/self/maps').read()"
    file = probe(tmp_path, f"raise RuntimeError(str((os.environ['LD_PRELOAD'], {mapped})))")
    with_preload = "entry_points, preload=lambda: 'libresolv.so.2')"
    file.write_text(file.read_text().replace('",), entry_points)', f'",), {with_preload}'))
    verdicts = audit(file)
    # Loaded, and not handed on to what the library starts.
    assert verdicts[0].reason == "RuntimeError: ('', True)"
    assert verdicts[1].runs > 0


def test_an_interpreter_that_is_absent_is_reported(tmp_path):
    with pytest.raises(WorkerFailed, match="did not start"):
        WorkerHost(probe(tmp_path, "pass"), "/no/such/python", 5)


def test_the_worker_needs_nothing_but_numpy():
    allowed = {"numpy", "ransac_fix", "__future__"} | set(sys.stdlib_module_names)
    for file in Path(worker.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                assert name.split(".")[0] in allowed, (file.name, name)
                if name.startswith("ransac_fix"):
                    # And what finds the cache, of the standard library only.
                    ours = ("ransac_fix.audit.worker", "ransac_fix.folders")
                    assert name.startswith(ours), (file.name, name)
