"""`ransac-fix site` in environments of its own: the one that runs the tests is never touched."""

import os
import shutil
import subprocess
import sys
import venv
from importlib import import_module
from pathlib import Path

import pytest
from small_library import APPROXIMATE, EXACT, LIBRARY, PATCH, install_patch

import ransac_fix

ENTRY_POINTS = "[ransac_fix.patches]\nscikit-learn = ransac_fix.patches.scikit_learn\n"
TRIALS = "import acme.robust; print(acme.robust.estimate(6, 20, 2))"


class Environment:
    """A virtual environment with ransac-fix, and the libraries of the tests' own behind it."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, with_pip=False, symlinks=True)
        self.python = folder / "bin" / "python"
        self.packages = next(folder.glob("lib/python*/site-packages"))
        self.package = self.packages / "ransac_fix"
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(Path(ransac_fix.__file__).parent, self.package, ignore=ignored)
        patches = import_module("ransac_fix.patches").__file__
        assert patches is not None
        shutil.copytree(
            Path(patches).parent, self.package / "patches", ignore=ignored, dirs_exist_ok=True
        )
        metadata = self.packages / "ransac_fix-0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: ransac-fix\nVersion: 0\n")
        (metadata / "entry_points.txt").write_text(ENTRY_POINTS)
        # Paths and no more: .pth files in there are not read.
        libraries = [path for path in sys.path if path.endswith("-packages")]
        (self.packages / "libraries.pth").write_text("\n".join(libraries) + "\n")
        package = self.packages / "acme"
        package.mkdir()
        (package / "__init__.py").write_text("__version__ = '2.1'\n")
        (package / "robust.py").write_text(LIBRARY)
        install_patch(self.packages, "acme", PATCH.replace("{name}", "acme"))

    def run(self, *args: str | Path, **environ: str) -> subprocess.CompletedProcess[str]:
        clean = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("RANSAC_FIX", "PYTHON"))
        }
        return subprocess.run(
            [self.python, *map(str, args)],
            env=clean | environ,
            cwd=self.packages.parent,
            capture_output=True,
            text=True,
            timeout=120,
        )

    def site(self, word: str) -> str:
        done = self.run("-m", "ransac_fix", "site", word)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    def prints(self, program: str, *flags: str, **environ: str) -> str:
        done = self.run(*flags, "-c", program, **environ)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout.strip()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    return Environment(tmp_path_factory.mktemp("environment"))


@pytest.fixture
def enabled(shared: Environment) -> Environment:
    shared.site("enable")
    return shared


def test_enable_and_disable(shared: Environment) -> None:
    def files() -> list[Path]:
        return sorted(path for path in shared.packages.iterdir() if path.name != "__pycache__")

    before = files()
    assert shared.site("status").startswith("disabled")
    assert shared.prints(TRIALS) == str(APPROXIMATE)
    said = shared.site("enable")
    assert said == shared.site("status") == shared.site("enable")
    assert f"enabled by {shared.packages}" in said
    assert "waits for acme, scikit-learn" in said
    assert shared.prints(TRIALS) == str(EXACT)
    shared.site("disable")
    assert shared.site("disable").startswith("disabled")
    assert shared.prints(TRIALS) == str(APPROXIMATE)
    assert files() == before


def test_a_patch_that_came_later_is_pointed_out(enabled: Environment) -> None:
    install_patch(enabled.packages, "other", PATCH.replace("{name}", "other"))
    try:
        assert "does not know the patches for other" in enabled.site("status")
        assert "does not know" not in enabled.site("enable")
    finally:
        (enabled.packages / "other_patch.py").unlink()
        shutil.rmtree(enabled.packages / "other_patch-1.0.dist-info")


def test_switched_off(enabled: Environment) -> None:
    program = f"{TRIALS}; import sys; print('ransac_fix' in sys.modules)"
    assert enabled.prints(program, RANSAC_FIX="0") == f"{APPROXIMATE}\nFalse"
    done = enabled.run("-m", "ransac_fix", "site", "status", RANSAC_FIX="0")
    assert "RANSAC_FIX=0 is set here" in done.stdout


@pytest.mark.parametrize("flag", ["-S", "-I"])
def test_shut_out_interpreters_are_left_alone(enabled: Environment, flag: str) -> None:
    program = "import sys; print('ransac_fix' in sys.modules, len(sys.meta_path))"
    before = enabled.prints(program, flag, RANSAC_FIX="0")
    assert enabled.prints(program, flag) == before == "False 3"


def test_another_environment_is_left_alone(enabled: Environment, tmp_path: Path) -> None:
    venv.create(tmp_path / "other", with_pip=False, symlinks=True)
    program = (
        "import subprocess; print(subprocess.run(["
        f"{str(tmp_path / 'other' / 'bin' / 'python')!r}, '-c',"
        " 'import sys; print(\"ransac_fix\" in sys.modules)'],"
        " capture_output=True, text=True, check=True))"
    )
    assert "stdout='False\\n', stderr=''" in enabled.prints(program)


def test_unrelated_programs_import_next_to_nothing(enabled: Environment) -> None:
    program = "import sys; print(*sorted(sys.modules))"
    bare = set(enabled.prints(program, RANSAC_FIX="0").split())
    assert set(enabled.prints(program).split()) - bare == {
        "__future__",
        "ransac_fix",
        "ransac_fix._version",
        "ransac_fix.patching",
        "ransac_fix.patching.finder",
        "ransac_fix.patching.startup",
        "types",
    }


def test_a_library_imported_later_is_patched(enabled: Environment) -> None:
    program = (
        "from sklearn.linear_model import _ransac as r\n"
        "print(r._dynamic_max_trials(6, 20, 2, 0.99))\n"
        "import ransac_fix; status = ransac_fix.status()\n"
        "print(*(s.state for s in status.systems), status.worker_processes)\n"
        "ransac_fix.unpatch()\n"
        "print(r._dynamic_max_trials(6, 20, 2, 0.99))\n"
    )
    assert enabled.prints(program).split() == ["56.0", "waiting", "patched", "True", "49.0"]


WORKERS = """
import multiprocessing

def trials(_=None):
    import acme.robust
    return acme.robust.estimate(6, 20, 2)

if __name__ == "__main__":
    print("here", trials())
    for method in ("fork", "spawn", "forkserver"):
        with multiprocessing.get_context(method).Pool(1) as pool:
            print(method, pool.map(trials, [0])[0])
    from joblib import Parallel, delayed
    print("loky", *set(Parallel(2, backend="loky")(delayed(trials)() for _ in range(4))))
"""


def test_worker_processes(enabled: Environment, tmp_path: Path) -> None:
    (tmp_path / "workers.py").write_text(WORKERS)
    done = enabled.run(tmp_path / "workers.py")
    found = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert found == dict.fromkeys(("here", "fork", "spawn", "forkserver", "loky"), str(EXACT))


def test_under_pytest(enabled: Environment, tmp_path: Path) -> None:
    (tmp_path / "test_trials.py").write_text(
        f"import acme.robust\ndef test(): assert acme.robust.estimate(6, 20, 2) == {EXACT}\n"
    )
    done = enabled.run("-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path)
    assert "1 passed" in done.stdout, done.stdout + done.stderr


def test_with_run_and_auto(enabled: Environment, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(f"import ransac_fix.auto\n{TRIALS}\n")
    done = enabled.run("-m", "ransac_fix", "run", tmp_path / "program.py")
    assert (done.stdout.strip(), done.stderr) == (str(EXACT), "")


def test_a_sitecustomize_still_runs(enabled: Environment) -> None:
    custom = enabled.packages / "sitecustomize.py"
    custom.write_text("import builtins; builtins.was_here = True\n")
    try:
        assert enabled.prints(f"{TRIALS}; print(was_here)") == f"{EXACT}\nTrue"
    finally:
        custom.unlink()


@pytest.mark.parametrize(
    "remove", ["patching/startup.py", "patching/finder.py", "patching", "__init__.py", ""]
)
def test_a_package_that_is_half_gone(tmp_path: Path, remove: str) -> None:
    environment = Environment(tmp_path / "environment")
    environment.site("enable")
    for cache in environment.package.rglob("__pycache__"):
        shutil.rmtree(cache)
    gone = environment.package / remove
    if gone.is_dir():
        shutil.rmtree(gone)
    else:
        gone.unlink()
    assert environment.prints("print('whole')") == "whole"
    if remove in ("patching", ""):
        assert environment.prints(TRIALS) == str(APPROXIMATE)


def test_an_engine_that_fails_leaves_the_library_as_it_is(tmp_path: Path) -> None:
    environment = Environment(tmp_path / "environment")
    environment.site("enable")
    (environment.package / "patching" / "engine.py").write_text("raise RuntimeError('broken')\n")
    done = environment.run("-c", TRIALS)
    assert (done.returncode, done.stdout.strip()) == (0, str(APPROXIMATE))
    assert "acme.robust is left as it is: broken" in done.stderr


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    environment = Environment(tmp_path / "environment")
    program = (
        "import pathlib\n"
        "def refuse(*args, **kwargs): raise PermissionError(13, 'Permission denied')\n"
        "pathlib.Path.write_text = refuse\n"
        "from ransac_fix.cli import main\n"
        "main(['site', 'enable'])\n"
    )
    done = environment.run("-c", program)
    assert done.returncode == 2
    assert "zzz_ransac_fix.pth cannot be changed: Permission denied" in done.stderr
    assert "Traceback" not in done.stderr
