"""`ransac-fix run`, `ransac_fix.auto` and the processes started from them."""

import os
import shutil
import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path

import pytest
from small_library import APPROXIMATE, EXACT, LIBRARY, PATCH, install_patch

import ransac_fix.patching

RunPython = Callable[..., subprocess.CompletedProcess[str]]

START = "import os, sys, acme.robust\ntrials = acme.robust.estimate(6, 20, 2)\n"


@pytest.fixture
def acme(tmp_path: Path) -> Path:
    """A library in the working directory of `run_python`, with its patch."""
    package = tmp_path / "acme"
    package.mkdir()
    (package / "__init__.py").write_text("__version__ = '2.1'\n")
    (package / "robust.py").write_text(LIBRARY)
    install_patch(tmp_path, "acme", PATCH.replace("{name}", "acme"))
    return tmp_path


@pytest.fixture
def run(acme: Path, run_python: RunPython) -> RunPython:
    """Run with the library and its patch importable, as if installed."""

    def run(
        *args: str | Path, environ: dict[str, str] | None = None, python: str = sys.executable
    ) -> subprocess.CompletedProcess[str]:
        environ = environ or {}
        path = os.pathsep.join(filter(None, [environ.get("PYTHONPATH", ""), str(acme)]))
        return run_python(*args, environ={**environ, "PYTHONPATH": path}, python=python)

    return run


def test_run_a_script(acme: Path, run: RunPython) -> None:
    (acme / "tool").mkdir()
    (acme / "tool" / "helper.py").write_text("")
    script = acme / "tool" / "script.py"
    script.write_text(
        START + "import helper\n"  # beside the script, as under python
        "print(trials, __name__, sys.argv[1:], sys.argv[0] == __file__)\n"
        "sys.exit(7)\n"
    )
    done = run("-m", "ransac_fix", "run", script, "-m", "--help", "x y")
    assert done.stdout.strip() == f"{EXACT} __main__ ['-m', '--help', 'x y'] True"
    assert done.returncode == 7
    assert done.stderr == ""


def test_run_a_module(acme: Path, run: RunPython) -> None:
    (acme / "program.py").write_text(START + "print(trials, __name__, sys.argv[1:])\n")
    done = run("-m", "ransac_fix", "run", "-m", "program", "-q", "--version")
    assert done.stdout.strip() == f"{EXACT} __main__ ['-q', '--version']", done.stderr


def test_run_the_patched_module_itself(acme: Path, run: RunPython) -> None:
    """`python -m` asks the loader for the code of a module that is being waited for."""
    with (acme / "acme" / "robust.py").open("a") as file:
        file.write("if __name__ == '__main__': print('ran')\n")
    done = run("-m", "ransac_fix", "run", "-m", "acme.robust")
    assert done.stdout.strip() == "ran", done.stderr


def test_run_without_a_program(run_python: RunPython) -> None:
    done = run_python("-m", "ransac_fix", "run", "no/such/script.py")
    assert done.returncode == 2
    assert "there is no file 'no/such/script.py'" in done.stderr
    assert "Traceback" not in done.stderr


def test_run_switched_off(acme: Path, run: RunPython) -> None:
    (acme / "script.py").write_text(START + "print(trials)\n")
    done = run("-m", "ransac_fix", "run", "script.py", environ={"RANSAC_FIX": "0"})
    assert done.stdout.strip() == str(APPROXIMATE)


@pytest.mark.parametrize("when", ["before", "after"])
def test_auto_before_and_after_the_import(acme: Path, run: RunPython, when: str) -> None:
    lines = ["import ransac_fix.auto", "import acme.robust"]
    program = "\n".join(lines if when == "before" else reversed(lines))
    done = run("-c", f"{program}\nprint(acme.robust.estimate(6, 20, 2))")
    assert done.stdout.strip() == str(EXACT), done.stderr


def test_auto_switched_off_changes_nothing(acme: Path, run: RunPython) -> None:
    program = (
        "import os, sys; before = dict(os.environ), list(sys.meta_path)\n"
        "import ransac_fix.auto\n"
        "print((dict(os.environ), list(sys.meta_path)) == before)"
    )
    assert run("-c", program, environ={"RANSAC_FIX": "0"}).stdout.strip() == "True"


WORKERS = """
import multiprocessing, os, subprocess, sys

def trials(_=None):
    import acme.robust
    return acme.robust.estimate(6, 20, 2)

def grandchild(_=None):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.map(trials, [0])[0]

if __name__ == "__main__":
    {first}
    print("here", trials())
    for method in multiprocessing.get_all_start_methods():
        with multiprocessing.get_context(method).Pool(1) as pool:
            print(method, pool.map(trials, [0])[0])
    from concurrent.futures import ProcessPoolExecutor
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        print("grandchild", pool.submit(grandchild).result())
    from joblib import Parallel, delayed
    print("loky", *set(Parallel(2, backend="loky")(delayed(trials)() for _ in range(4))))
    code = "import acme.robust; print(acme.robust.estimate(6, 20, 2))"
    def child():
        line = [sys.executable, "-c", code]
        return subprocess.run(line, capture_output=True, text=True).stdout.strip()
    print("subprocess", child())
    ransac_fix = sys.modules.get("ransac_fix")
    if {undo}:
        import ransac_fix
        ransac_fix.unpatch()
        print("undone", child())
        print("workers", ransac_fix.status().worker_processes)
"""


@pytest.mark.parametrize("way", ["run", "auto"])
def test_worker_processes_inherit(acme: Path, run: RunPython, way: str) -> None:
    first = "import ransac_fix.auto" if way == "auto" else "pass"
    (acme / "workers.py").write_text(WORKERS.format(first=first, undo=True))
    start = ["-m", "ransac_fix", "run"] if way == "run" else []
    done = run(*start, "workers.py")
    found = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert found.pop("undone") == str(APPROXIMATE), done.stderr
    assert found.pop("workers") == "False"
    assert set(found) >= {"here", "spawn", "grandchild", "loky", "subprocess"}
    assert set(found.values()) == {str(EXACT)}, found


DATA_LOADER = """
import torch

class Data(torch.utils.data.Dataset):
    def __len__(self):
        return 4
    def __getitem__(self, index):
        import acme.robust
        return acme.robust.estimate(6, 20, 2)

if __name__ == "__main__":
    for context in ("fork", "spawn"):
        loader = torch.utils.data.DataLoader(
            Data(), num_workers=2, multiprocessing_context=context
        )
        print(context, *{float(batch) for batch in loader})
"""


def test_data_loader_workers_inherit(acme: Path, run: RunPython) -> None:
    (acme / "workers.py").write_text(DATA_LOADER)
    done = run("-m", "ransac_fix", "run", "workers.py")
    assert done.stdout.splitlines() == [f"fork {EXACT}", f"spawn {EXACT}"], done.stderr


def test_patch_alone_is_not_inherited_by_fresh_processes(acme: Path, run: RunPython) -> None:
    (acme / "workers.py").write_text(
        WORKERS.format(first="import ransac_fix; ransac_fix.patch()", undo=False)
    )
    done = run("workers.py")
    found = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert {found[name] for name in ("here", "fork")} == {str(EXACT)}, done.stderr
    assert {found[name] for name in ("spawn", "loky", "subprocess")} == {str(APPROXIMATE)}


def test_a_status_in_a_worker_says_what_is_waited_for(acme: Path, run: RunPython) -> None:
    program = (
        "import ransac_fix\n"
        "before = next(s for s in ransac_fix.status().systems if s.system == 'acme')\n"
        "import acme.robust\n"
        "after = next(s for s in ransac_fix.status().systems if s.system == 'acme')\n"
        "print(before.state, after.state, ransac_fix.status().worker_processes)\n"
    )
    (acme / "script.py").write_text(program)
    assert run("-m", "ransac_fix", "run", "script.py").stdout.split() == [
        "waiting",
        "patched",
        "True",
    ]


def _inherited(acme: Path) -> dict[str, str]:
    """Return the environment that a patched program gives to its children."""
    from ransac_fix.patching import startup

    environ = {"PYTHONPATH": ""}
    startup.environment(environ, {"acme": ("acme.robust",)})
    return environ


def test_a_sitecustomize_that_was_there_still_runs(acme: Path, run: RunPython) -> None:
    (acme / "sitecustomize.py").write_text("import builtins; builtins.was_here = __file__\n")
    program = START + "import sitecustomize; print(trials, was_here == sitecustomize.__file__)"
    done = run("-c", program, environ=_inherited(acme))
    assert done.stdout.split() == [str(EXACT), "True"], done.stderr


def test_a_sitecustomize_that_fails_fails_as_before(acme: Path, run: RunPython) -> None:
    (acme / "sitecustomize.py").write_text("raise RuntimeError('of its own')\n")
    done = run("-c", START + "print(trials)", environ=_inherited(acme))
    assert "of its own" in done.stderr
    assert done.stdout.strip() == str(EXACT)


def test_our_folder_is_not_on_the_workers_path(acme: Path, run: RunPython) -> None:
    program = "import sys; print([entry for entry in sys.path if '_site' in entry])"
    assert run("-c", program, environ=_inherited(acme)).stdout.strip() == "[]"


@pytest.mark.parametrize("flag", ["-S", "-I", "-E"])
def test_shut_out_interpreters_are_left_alone(acme: Path, run: RunPython, flag: str) -> None:
    program = "import sys; print('ransac_fix' in sys.modules)"
    done = run(flag, "-c", program, environ=_inherited(acme))
    assert (done.stdout.strip(), done.stderr) == ("False", "")


def test_a_python_without_ransac_fix_stays_silent(
    acme: Path, run: RunPython, tmp_path: Path
) -> None:
    venv.create(tmp_path / "bare", with_pip=False, symlinks=True)
    python = tmp_path / "bare" / "bin" / "python"
    done = run("-c", START + "print(trials)", environ=_inherited(acme), python=str(python))
    assert (done.stdout.strip(), done.stderr) == (str(APPROXIMATE), "")


@pytest.mark.parametrize("version", ["2.7", "3.6", "3.8", "3.13"])
def test_other_pythons_can_read_the_start_file(version: str, acme: Path, run: RunPython) -> None:
    python = shutil.which(f"python{version}")
    if python is None or subprocess.run([python, "-V"], capture_output=True).returncode:
        # Where there is no such Python, at least nothing newer than its grammar may be used.
        import ast

        source = Path(ransac_fix.patching.__file__).with_name("_site") / "sitecustomize.py"
        ast.parse(source.read_text(), feature_version=(3, 7))
        return
    environ = {"PYTHONPATH": _inherited(acme)["PYTHONPATH"]}
    done = run("-c", "import sys; print(sys.version_info[0])", environ=environ, python=python)
    assert (done.stdout.strip(), done.stderr) == (version[0], "")


def test_a_worker_imports_next_to_nothing_at_its_start(acme: Path, run: RunPython) -> None:
    program = "import sys; print(*sorted(sys.modules))"
    bare = set(run("-c", program).stdout.split())
    patched = set(run("-c", program, environ=_inherited(acme)).stdout.split())
    ours = {name for name in patched if name.startswith("ransac_fix.")}
    assert ours == {
        "ransac_fix._version",
        "ransac_fix.patching",
        "ransac_fix.patching.finder",
        "ransac_fix.patching.startup",
    }
    heavy = {
        "dataclasses",
        "importlib.metadata",
        "inspect",
        "numpy",
        "packaging",
        "re",
        "threading",
    }
    assert not (patched - bare) & heavy


def test_a_refusal_in_a_worker_is_a_warning(acme: Path, run: RunPython) -> None:
    (acme / "acme" / "robust.py").write_text(LIBRARY.replace("min_samples", "size"))
    done = run("-c", START + "print(trials)", environ=_inherited(acme))
    assert done.stdout.strip() == str(APPROXIMATE)
    assert "acme 2.1 is left as it is" in done.stderr
