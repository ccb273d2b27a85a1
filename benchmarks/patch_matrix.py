"""Try the patches on every release they are declared for, each in an environment of its own.

    python benchmarks/patch_matrix.py [--cache FOLDER] [--only SYSTEM] [--output docs/patch-matrix]

For each release: a virtual environment that holds that release, on top of a shared one with its
dependencies (``--no-deps``; NumPy 1 for releases built against it; torch is taken from the
environment this script runs in) and with ransac-fix installed from a wheel built here. In it,
this script is run again with ``--check``, and there it

- patches before the import, and reads the state that `ransac_fix.status` reports;
- compares the patched rule with an oracle of its own (fractions and 60-digit decimals);
- runs the library on planted problems and counts its trials, bare, patched and with the drop-in;
- looks that a bound without a finite cap is not raised where there are fewer inliers than a
  sample holds, and that `ransac_fix.unpatch` brings the very same functions back;
- runs the library's own tests of its RANSAC, where the wheel has them, under ``ransac-fix run``.

Releases without a wheel for the Python at hand are listed as such. The result is written as
Markdown and JSON; a release that does not behave as its row in `RELEASES` says makes the exit
code 1.
"""

import argparse
import functools
import json
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent

# system -> (release, Python, base, expected state)
RELEASES: dict[str, list[tuple[str, str, str, str]]] = {
    "scikit-image": [
        *(
            (release, "3.11", "", "no wheel")
            for release in ("0.17.2", "0.18.3", "0.19.0", "0.19.3")
        ),
        *((r, "3.11", "numpy1", "patched") for r in ("0.20.0", "0.21.0", "0.22.0", "0.23.2")),
        *((r, "3.11", "numpy2", "patched") for r in ("0.24.0", "0.25.0", "0.25.2", "0.26.0")),
        ("0.27.0rc1", "3.12", "numpy2", "patched"),
    ],
    "scikit-learn": [
        *((release, "3.11", "", "no wheel") for release in ("0.24.2", "1.0.2")),
        *((release, "3.11", "numpy1", "patched") for release in ("1.2.2", "1.3.2")),
        *((r, "3.11", "numpy2", "patched") for r in ("1.5.2", "1.6.1", "1.7.2", "1.8.0")),
        *((release, "3.11", "numpy2", "patched") for release in ("1.9.0", "1.9.1")),
    ],
    "kornia": [
        ("0.6.0", "3.11", "torch", "cannot be imported"),
        *((f"0.6.{minor}", "3.11", "torch", "patched") for minor in range(1, 13)),
        ("0.7.0", "3.11", "torch", "patched"),
        *((f"0.7.{minor}", "3.11", "torch", "refused") for minor in (1, 2)),
        *((f"0.7.{minor}", "3.11", "torch", "patched") for minor in (3, 4)),
        *((f"0.8.{minor}", "3.11", "torch", "patched") for minor in range(3)),
        ("0.8.3", "3.11", "torch", "refused"),
        ("0.9.0", "3.11", "torch", "already exact"),
    ],
}

_COMMON = ["networkx", "pillow", "imageio", "tifffile", "packaging", "joblib", "threadpoolctl"]
_COMMON += ["lazy_loader", "pytest", "click", "narwhals", "PyWavelets"]
BASES = {
    "numpy1": ["numpy==1.26.4", "scipy==1.11.4", *_COMMON],
    "numpy2": ["numpy>=2", "scipy", *_COMMON],
    "torch": ["packaging", "kornia_rs", "click"],
}

# The library's own tests of its RANSAC; 0.26 and later of scikit-image ship none.
UPSTREAM_TESTS = {
    "scikit-image": "skimage.measure.tests.test_fit",
    "scikit-learn": "sklearn.linear_model.tests.test_ransac",
}

_COLUMNS = """\
Each release ran in an environment of its own, with its dependencies shared and torch taken from
the environment at hand. *State* is what `ransac_fix.status()` says after the import. *Wrong*
counts rule values that differ from an oracle of fractions and 60-digit decimals. *Bare*,
*patched* and *drop-in* are trials counted in real runs on planted problems (s = 0.99), beside the
*exact* number. *Tests* names the library's own tests of its RANSAC that fail under the patch and
not without it, where its wheel has them."""

# (n, I, k): N_a and N_e differ, and the exact one is soon run.
PLANTED = {
    "scikit-image": [(20, 6, 2), (30, 9, 2), (25, 12, 2)],
    "scikit-learn": [(20, 6, 2), (30, 9, 2), (25, 12, 2)],
    "kornia": [(12, 6, 4), (16, 8, 4)],
}


# --- in the environment of one release -------------------------------------------------------


def oracle(n_inliers: int, n_samples: int, sample_size: int, confidence: float) -> int:
    """Return the exact number of trials, from fractions and long decimals."""
    probability = Fraction(math.comb(n_inliers, sample_size), math.comb(n_samples, sample_size))
    if probability == 1:
        return 1
    with localcontext(prec=60):
        allowed = Decimal(1) - Decimal(confidence)
        miss = Decimal(probability.denominator - probability.numerator) / probability.denominator
        trials = int((allowed.ln() / miss.ln()).to_integral_value(rounding="ROUND_FLOOR"))
        while miss**trials > allowed:
            trials += 1
        return trials


def approximate(n_inliers: int, n_samples: int, sample_size: int, confidence: float) -> float:
    return math.log(1 - confidence) / math.log(1 - (n_inliers / n_samples) ** sample_size)


def check(system: str) -> dict[str, Any]:
    """Try the patch on the release that is installed here."""
    import ransac_fix

    ransac_fix.patch(system)
    waiting = _state(system).state
    adapter = {"scikit-image": _ScikitImage, "scikit-learn": _ScikitLearn, "kornia": _Kornia}
    try:
        library = adapter[system]()
    except Exception as error:  # noqa: BLE001 -- the release cannot be used here at all
        # kornia 0.6.0 downloads the weights of a network whenever it is imported.
        return {"state": "cannot be imported", "reason": f"{type(error).__name__}: {error}"}
    after = _state(system)
    result: dict[str, Any] = {
        "before import": waiting,
        "state": after.state,
        "reason": after.reason,
        "version": after.version,
        "declared": after.checked,
        "sites": list(after.sites),
    }
    if after.state == "refused":
        return result
    grid = [
        (inliers, n, k, s)
        for n in (8, 20, 97, 1000)
        for k in (1, 2, 3, 4, 7)
        for inliers in sorted({k, k + 1, n // 3, n // 2, n - 1, n})
        if k <= inliers
        for s in (0.5, 0.9, 0.99, 0.999999)
        if oracle(inliers, n, k, s) < 10**8
    ]
    wrong = [case for case in grid if int(library.rule()(*case)) != oracle(*case)]
    result["rule"] = {"cases": len(grid), "wrong": wrong[:5], "n_wrong": len(wrong)}
    patched = [library.trials(library.original, *problem) for problem in PLANTED[system]]
    patched_rule = library.rule()
    ransac_fix.unpatch(system)
    bare_rule = library.rule()
    result["trials"] = {
        "problems": PLANTED[system],
        "exact": [oracle(i, n, k, 0.99) for n, i, k in PLANTED[system]],
        "approximate": [math.ceil(approximate(i, n, k, 0.99)) for n, i, k in PLANTED[system]],
        "patched": patched,
        "bare": [library.trials(library.original, *problem) for problem in PLANTED[system]],
        "drop-in": [library.trials(library.drop_in(), *problem) for problem in PLANTED[system]],
    }
    result["restored"] = bare_rule is not patched_rule or after.state == "already exact"
    if system != "kornia":
        with ransac_fix.patched(system):
            result["fewer inliers than a sample, no cap"] = {
                "library": float(bare_rule(7, 12, 8, 0.99)),
                "patched": float(library.rule()(7, 12, 8, 0.99)),
            }
    result["restored"] = result["restored"] and library.rule() is bare_rule
    result["dependencies"] = library.dependencies()
    return result


def _state(system: str) -> Any:
    import ransac_fix

    return next(entry for entry in ransac_fix.status().systems if entry.system == system)


class _ScikitImage:
    def __init__(self) -> None:
        from skimage.measure import ransac

        self.original = ransac
        # Read through the function itself: where it looks its rule up.
        self._namespace = _unwrapped(ransac).__globals__

    def rule(self) -> Any:
        return self._namespace["_dynamic_max_trials"]

    def drop_in(self) -> Any:
        from ransac_fix.patches.scikit_image import ransac

        return ransac

    def trials(self, ransac: Any, n: int, inliers: int, _size: int) -> int:
        from skimage.measure import LineModelND

        count = 0

        def counted(*_: Any) -> bool:
            nonlocal count
            count += 1
            return True

        ransac(
            _line(n, inliers),
            LineModelND,
            2,
            1e-6,
            is_data_valid=counted,
            max_trials=10**6,
            stop_probability=0.99,
            **_seed(ransac),
        )
        return count

    def dependencies(self) -> dict[str, str]:
        import numpy

        return {"numpy": numpy.__version__}


class _ScikitLearn:
    def __init__(self) -> None:
        from sklearn.linear_model import RANSACRegressor

        self.original = RANSACRegressor

    def rule(self) -> Any:
        from sklearn.linear_model import _ransac

        return _ransac._dynamic_max_trials

    def drop_in(self) -> Any:
        from ransac_fix.patches.scikit_learn import RANSACRegressor

        return RANSACRegressor

    def trials(self, regressor: Any, n: int, inliers: int, size: int) -> int:
        points = _line(n, inliers)
        # A share below 1 makes the size of a sample a NumPy float in the rule.
        share = size / n - 1e-9
        estimator = regressor(
            min_samples=share if n == 30 else size,
            residual_threshold=1e-6,
            max_trials=10**6,
            random_state=3,
        )
        try:
            estimator.fit(points[:, :1], points[:, 1])
        except TypeError:  # a release that cannot draw a NumPy float of samples
            estimator.set_params(min_samples=size).fit(points[:, :1], points[:, 1])
        return int(estimator.n_trials_)

    def dependencies(self) -> dict[str, str]:
        import numpy

        return {"numpy": numpy.__version__}


class _Kornia:
    def __init__(self) -> None:
        import torch
        from kornia.geometry import RANSAC

        torch.set_num_threads(1)
        self.original = RANSAC

    def rule(self) -> Any:
        return self.original.max_samples_by_conf

    def drop_in(self) -> Any:
        from ransac_fix.patches.kornia import RANSAC

        return RANSAC

    def trials(self, cls: Any, n: int, inliers: int, _size: int) -> int:
        import torch

        generator = torch.Generator().manual_seed(2)
        source = torch.rand(n, 2, generator=generator, dtype=torch.float64) * 100
        matrix = torch.tensor([[1.1, 0.02, 5.0], [-0.03, 0.95, -3.0], [1e-4, -2e-4, 1.0]])
        ones = torch.ones(n, 1, dtype=torch.float64)
        image = torch.cat([source, ones], 1) @ matrix.double().T
        target = image[:, :2] / image[:, 2:]
        target[inliers:] = 300 + 100 * torch.rand(n - inliers, 2, generator=generator).double()
        torch.manual_seed(0)
        ransac = cls("homography", inl_th=0.1, batch_size=1, max_iter=1500, confidence=0.99)
        sample, drawn = ransac.sample, 0

        def counted(*args: Any, **kwargs: Any) -> Any:
            nonlocal drawn
            indices = sample(*args, **kwargs)
            drawn += len(indices)
            return indices

        ransac.sample = counted
        _, mask = ransac(source, target)
        if int(mask.sum()) != inliers:
            raise AssertionError(f"{int(mask.sum())} inliers found in place of {inliers}")
        return drawn

    def dependencies(self) -> dict[str, str]:
        import torch

        return {"torch": torch.__version__}


def _unwrapped(function: Any) -> Any:
    while hasattr(function, "__wrapped__"):
        function = function.__wrapped__
    return function


def _seed(ransac: Any) -> dict[str, int]:
    code = _unwrapped(ransac).__code__
    names = code.co_varnames[: code.co_argcount]
    return {"rng" if "rng" in names else "random_state": 3}


def _line(n: int, inliers: int) -> Any:
    """Return points of which `inliers` lie on a line, and no other three do."""
    import numpy as np

    rng = np.random.default_rng(5)
    x = np.arange(n, dtype=float)
    points = np.column_stack([x, 0.5 * x + 1.0])
    points[inliers:, 1] += 10.0 + rng.uniform(0.0, 100.0, n - inliers)
    return points


# --- in the environment the script is started in ---------------------------------------------


def interpreter(version: str) -> str:
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return sys.executable
    found = shutil.which(f"python{version}")
    if found is None or subprocess.run([found, "--version"], capture_output=True).returncode:
        raise FileNotFoundError(f"no python{version} on PATH")
    return found


def build_wheel(folder: Path) -> Path:
    folder = folder / "dist"
    shutil.rmtree(folder, ignore_errors=True)
    _pip("wheel", "--no-deps", "--no-build-isolation", "-w", str(folder), str(ROOT))
    return next(folder.glob("*.whl"))


def environment(cache: Path, version: str, name: str) -> Path:
    """Return the python of a bare virtual environment, made if it is not there."""
    folder = cache / f"py{version}-{name}"
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([interpreter(version), "-m", "venv", "--without-pip", folder], check=True)
    return python


@functools.cache
def base(cache: Path, version: str, name: str, wheel: Path) -> Path:
    """Return the site-packages of the shared dependencies, with ransac-fix."""
    python = environment(cache, version, f"base-{name}")
    _pip("install", "-q", *BASES[name], python=python)
    _pip("install", "-q", "--no-deps", "--force-reinstall", str(wheel), python=python)
    return _site_packages(python)


def try_release(
    cache: Path, wheel: Path, system: str, release: str, version: str, base_name: str
) -> dict[str, Any]:
    python = environment(cache, version, f"{system}-{release}")
    try:
        _pip(
            "install",
            "-q",
            "--no-deps",
            "--only-binary=:all:",
            f"{system}=={release}",
            python=python,
        )
    except subprocess.CalledProcessError as error:
        if "No matching distribution" in error.stderr:
            return {"state": "no wheel"}
        raise
    paths = [str(base(cache, version, base_name, wheel))]
    if base_name == "torch":
        import importlib.util

        spec = importlib.util.find_spec("torch")
        if spec is None or spec.origin is None:
            return {"state": "not tried", "reason": "there is no torch in this environment"}
        paths.append(str(Path(spec.origin).parent.parent))
    (_site_packages(python) / "base.pth").write_text("\n".join(paths) + "\n")
    done = subprocess.run(
        [python, "-W", "ignore", __file__, "--check", system],
        capture_output=True,
        text=True,
        cwd=cache,
        env=_clean(),
    )
    if done.returncode:
        return {"state": "failed", "reason": done.stderr.strip().splitlines()[-1:]}
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    if system in UPSTREAM_TESTS:
        result["own tests"] = own_tests(python, cache, UPSTREAM_TESTS[system])
    return result


def own_tests(python: Path, cache: Path, module: str) -> dict[str, Any] | None:
    """Run the library's own tests under the patch and without it."""
    found = subprocess.run(
        [python, "-c", f"import {module}"], capture_output=True, cwd=cache, env=_clean()
    )
    if found.returncode:
        return None
    outcome = {}
    for name, switch in (("patched", "1"), ("bare", "0")):
        done = subprocess.run(
            [
                python,
                "-m",
                "ransac_fix",
                "run",
                "-m",
                "pytest",
                "--pyargs",
                module,
                "-q",
                "-rf",
                "-p",
                "no:cacheprovider",
                "-W",
                "ignore",
            ],
            capture_output=True,
            text=True,
            cwd=cache,
            env={**_clean(), "RANSAC_FIX": switch},
        )
        lines = done.stdout.splitlines()
        outcome[name] = {
            "summary": lines[-1].strip("= ") if lines else done.stderr.strip()[-200:],
            "failed": sorted(
                line.split("::")[-1].split(" ")[0] for line in lines if line.startswith("FAILED")
            ),
        }
    outcome["approximate assertions"] = approximate_assertions(python, module)
    return outcome


def approximate_assertions(python: Path, module: str) -> list[dict[str, Any]]:
    """Return what a test file asserts of the rule that is not the exact number."""
    path = _site_packages(python).joinpath(*module.split(".")).with_suffix(".py")
    number = r"(\d+(?:\.\d+)?)"
    call = rf"_dynamic_max_trials\({number}, {number}, {number}, {number}\)(?:,| ==) {number}\b"
    found = []
    for match in re.finditer(call, path.read_text(encoding="utf-8")):
        n_inliers, n, size = map(int, match.groups()[:3])
        confidence, asserted = float(match[4]), int(match[5])
        if n_inliers < size or confidence == 0:
            continue
        # Both libraries take certainty for the largest confidence their floats can tell from it.
        exact = oracle(n_inliers, n, size, min(confidence, 1 - 2**-52))
        if exact != asserted:
            counts = [n_inliers, n, size, confidence]
            found.append({"counts": counts, "asserted": asserted, "exact": exact})
    return found


def is_good(result: dict[str, Any], expected: str) -> bool:
    if result["state"] != expected:
        return False
    if expected not in ("patched", "already exact"):
        return True
    trials = result["trials"]
    cap = result.get("fewer inliers than a sample, no cap", {"library": 0, "patched": 0})
    return bool(
        result["declared"]
        and result["rule"]["n_wrong"] == 0
        and trials["patched"] == trials["exact"] == trials["drop-in"]
        and result["restored"]
        and cap["library"] == cap["patched"]
    )


def markdown(report: dict[str, Any]) -> str:
    lines = [
        "# The patches, release by release",
        "",
        f"Made on {report['date']} by `python benchmarks/patch_matrix.py` on {report['platform']}.",
        _COLUMNS,
        "",
    ]
    for system, releases in report["systems"].items():
        problems = ", ".join(f"({n}, {i}, {k})" for n, i, k in PLANTED[system])
        lines += [
            f"## {system}",
            "",
            f"Planted problems (n, I, k): {problems}.",
            "",
            "| release | Python | state | wrong | bare | patched | drop-in | exact | tests |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        ]
        for release, row in releases.items():
            result = row["result"]
            state = result["state"]
            if "trials" not in result:
                lines.append(f"| {release} | {row['python']} | {state} | | | | | | |")
                continue
            trials, rule = result["trials"], result["rule"]
            own = result.get("own tests")
            tests = ""
            if own:
                alone = sorted(set(own["patched"]["failed"]) - set(own["bare"]["failed"]))
                tests = f"{', '.join(f'`{name}`' for name in alone) or 'none'}"
                tests += f" ({own['patched']['summary'].split(' in ')[0]})"
            cells = [
                " ".join(map(str, trials[key])) for key in ("bare", "patched", "drop-in", "exact")
            ]
            lines.append(
                f"| {release} | {row['python']} | {state} | {rule['n_wrong']} / {rule['cases']} |"
                f" {' | '.join(cells)} | {tests} |"
            )
        lines += ["", *_assertions(releases)]
        notes: dict[str, list[str]] = {}
        for release, row in releases.items():
            if row["result"].get("reason") and row["result"]["state"] != "already exact":
                notes.setdefault(row["result"]["reason"], []).append(release)
        lines += [""]
        lines += [f"- {', '.join(found)}: {reason.rstrip('.')}." for reason, found in notes.items()]
        lines += [""]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def _assertions(releases: dict[str, Any]) -> list[str]:
    """Return a table of what the libraries' own tests assert of the approximate rule."""
    asserted: dict[tuple[float, ...], tuple[int, int]] = {}
    for row in releases.values():
        for entry in (row["result"].get("own tests") or {}).get("approximate assertions", ()):
            asserted[tuple(entry["counts"])] = entry["asserted"], entry["exact"]
    if not asserted:
        return []
    return [
        "What `test_ransac_dynamic_max_trials` asserts that the exact rule does not give:",
        "",
        "| I, n, k, s | asserted | exact |",
        "| --- | --- | --- |",
        *(f"| {', '.join(map(str, k))} | {a} | {e} |" for k, (a, e) in asserted.items()),
    ]


def _clean() -> dict[str, str]:
    environ = dict(os.environ)
    for name in ("PYTHONPATH", "RANSAC_FIX", "RANSAC_FIX_WATCH"):
        environ.pop(name, None)
    return environ


def _site_packages(python: Path) -> Path:
    return next((python.parent.parent / "lib").glob("python3*/site-packages"))


def _pip(*args: str, python: Path | None = None) -> None:
    where = ["--python", str(python)] if python else []
    subprocess.run(
        [sys.executable, "-m", "pip", *where, *args], check=True, capture_output=True, text=True
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="Try the patches on every release.")
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ransac-fix"
    parser.add_argument("--cache", type=Path, default=default / "patch-matrix")
    parser.add_argument("--only", choices=RELEASES, action="append")
    parser.add_argument("--release", action="append")
    parser.add_argument("--output", type=Path, help="write OUTPUT.md and OUTPUT.json")
    parser.add_argument("--check", choices=RELEASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.check:
        print(json.dumps(check(options.check)))
        return 0
    options.cache.mkdir(parents=True, exist_ok=True)
    cache = options.cache.resolve()
    wheel = build_wheel(cache)
    report: dict[str, Any] = {
        "date": datetime.now(UTC).date().isoformat(),
        "platform": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "systems": {},
    }
    good = True
    for system in options.only or RELEASES:
        rows = report["systems"].setdefault(system, {})
        for release, version, base_name, expected in RELEASES[system]:
            if options.release and release not in options.release:
                continue
            try:
                result = try_release(cache, wheel, system, release, version, base_name)
            except FileNotFoundError as error:
                result = {"state": "not tried", "reason": str(error)}
            fine = is_good(result, expected)
            good = good and fine
            rows[release] = {"python": version, "expected": expected, "result": result}
            print(f"{'ok  ' if fine else 'BAD '} {system} {release}: {result['state']}", flush=True)
            if not fine:
                print(json.dumps(result, indent=1), flush=True)
    if options.output:
        options.output.with_suffix(".json").write_text(json.dumps(report, indent=1) + "\n")
        options.output.with_suffix(".md").write_text(markdown(report))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
