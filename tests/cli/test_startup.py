"""What starting up must not cost: measured by what is imported, not by the clock."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = {"numpy", "libcst", "rich", "msgspec", "joblib", "cv2", "torch", "sklearn", "skimage"}


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
    )


def imported(code: str) -> set[str]:
    done = run("-c", f"import sys; {code}; print(*sys.modules, file=sys.stderr)")
    assert done.returncode == 0, done.stderr
    return {name.partition(".")[0] for name in done.stderr.split()}


@pytest.mark.parametrize("option", ["--version", "--help", "-h"])
def test_the_command_line_starts_light(option: str) -> None:
    code = f"from ransac_fix.cli import main\ntry: main([{option!r}])\nexcept SystemExit: pass"
    done = run("-c", f"{code}\nimport sys; print(*sys.modules, file=sys.stderr)")
    assert done.stdout
    modules = {name.partition(".")[0] for name in done.stderr.split()}
    assert not modules & HEAVY


def test_the_package_starts_light() -> None:
    assert not imported("import ransac_fix") & (HEAVY | {"click", "decimal", "tomllib"})


def test_the_criterion_needs_the_standard_library_only() -> None:
    modules = imported("import ransac_fix; ransac_fix.required_trials(6, 20, 2, 0.99)")
    assert (
        modules - set(sys.stdlib_module_names)
        <= {"ransac_fix", "__main__"}
        | {
            name
            for name in modules
            if name.startswith(("__editable__", "_virtualenv", "sitecustomize"))
        }
        | preloaded()
    )


def preloaded() -> set[str]:
    """What the environment's own ``.pth`` files import in every program."""
    return imported("pass")


def test_every_public_name_loads() -> None:
    code = "import ransac_fix; [getattr(ransac_fix, name) for name in ransac_fix.__all__]"
    assert "ransac_fix" in imported(code)


def test_version() -> None:
    done = run("-m", "ransac_fix", "--version")
    assert done.returncode == 0
    assert done.stdout.startswith("ransac-fix, version ")


def test_help_names_every_command() -> None:
    from ransac_fix.cli import _COMMANDS

    done = run("-m", "ransac_fix", "--help")
    assert done.returncode == 0
    for name in _COMMANDS:
        assert f"  {name} " in done.stdout
        assert run("-m", "ransac_fix", name, "--help").returncode == 0


@pytest.mark.parametrize("arguments", [["nonsense"], ["--nonsense"]])
def test_a_wrong_command_is_one_clear_error(arguments: list[str]) -> None:
    done = run("-m", "ransac_fix", *arguments)
    assert done.returncode == 2
    assert "nonsense" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("arguments", [["audit"], ["probe", "a:b", "--problem", "line"]])
def test_what_measures_names_the_extra_where_there_is_no_numpy(arguments: list[str]) -> None:
    code = "import sys; sys.modules['numpy'] = None; from ransac_fix.cli import main; main()"
    done = run("-c", code, *arguments)
    assert done.returncode == 2
    assert done.stderr == ("ransac-fix: error: this needs numpy: pip install 'ransac-fix[audit]'\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no such device here")
def test_a_full_disk_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "ransac_fix", "rules"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "ransac-fix: error: cannot write: No space left on device\n"
