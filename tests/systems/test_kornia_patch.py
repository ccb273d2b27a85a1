"""kornia: 0.9 is exact already; older releases, played by a stand-in, are mended or refused."""

import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
import torch
from kornia.geometry import RANSAC

import ransac_fix
from ransac_fix import required_trials
from ransac_fix.patches.kornia import RANSAC as Exact  # noqa: N811 -- a class in capitals
from ransac_fix.patches.kornia import plan


@pytest.fixture(autouse=True)
def undo() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
    ransac_fix.unpatch()


def correspondences(n: int, inliers: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return points and their images, of which `inliers` are under one homography."""
    generator = torch.Generator().manual_seed(2)
    source = torch.rand(n, 2, generator=generator, dtype=torch.float64) * 100
    matrix = torch.tensor(
        [[1.1, 0.02, 5.0], [-0.03, 0.95, -3.0], [1e-4, -2e-4, 1.0]], dtype=torch.float64
    )
    image = torch.cat([source, torch.ones(n, 1, dtype=torch.float64)], 1) @ matrix.T
    target = image[:, :2] / image[:, 2:]
    target[inliers:] = 300 + 100 * torch.rand(n - inliers, 2, generator=generator).double()
    return source, target


def drawn(cls: type, n: int, inliers: int) -> int:
    torch.manual_seed(0)
    ransac = cls("homography", inl_th=0.1, batch_size=1, max_iter=2000, confidence=0.99)
    sample, count = ransac.sample, 0

    def counted(*args, **kwargs):  # type: ignore[no-untyped-def]
        nonlocal count
        indices = sample(*args, **kwargs)
        count += len(indices)
        return indices

    ransac.sample = counted
    _, mask = ransac(*correspondences(n, inliers))
    assert int(mask.sum()) == inliers
    return count


def test_the_installed_release_is_exact_already() -> None:
    before = dict(vars(RANSAC))
    ransac_fix.patch("kornia")
    status = next(s for s in ransac_fix.status().systems if s.system == "kornia")
    assert (status.state, status.sites) == ("already exact", ())
    assert dict(vars(RANSAC)) == before
    assert drawn(RANSAC, 12, 6) == required_trials(6, 12, 4, 0.99)


def test_the_drop_in_is_kornias_own_class() -> None:
    assert Exact is RANSAC
    assert pickle.loads(pickle.dumps(Exact("homography"))).confidence == 0.99


# A stand-in, and it says so: kornia's class and loop in the shape they have up to 0.8.2, on
# counts in place of images. The releases themselves are tried in the patch matrix.
STAND_IN = '''
"""A stand-in for kornia up to 0.8.2, not kornia."""
import math
import torch

class RANSAC(torch.nn.Module):
    """Estimate by sampling."""

    def __init__(self, batch_size=4, max_iter=400, confidence=0.99):
        super().__init__()
        self.batch_size, self.max_iter, self.confidence = batch_size, max_iter, confidence
        self.minimal_sample_size = 2
        self.drawn = self.estimated = 0

    def sample(self, sample_size, pop_size, batch_size, device=None):
        """Draw samples."""
        out = torch.rand(batch_size, pop_size, device=device).topk(k=sample_size, dim=1)[1]
        self.drawn += len(out)
        return out

    @staticmethod
    def max_samples_by_conf(n_inl: int, num_tc: int, sample_size: int, conf: float) -> float:
        """Say how many samples are enough."""
        eps = 1e-9
        if num_tc <= sample_size or n_inl == num_tc:
            return 1.0
        p = (n_inl / num_tc) ** sample_size
        return math.log(1.0 - conf) / min(-eps, math.log(max(eps, 1.0 - p)))

    def remove_bad_samples(self, kp1, kp2):
        """Keep samples that can give a model."""
        kp1[:, 0]  # an index that fails on nothing but an empty sample
        kp1.sum(dim=(1, 2)).max()
        return kp1, kp2

    def estimate_model_from_minsample(self, kp1, kp2):
        """Fit models: here the larger of two labels."""
        self.estimated += 1
        return kp1.amax(dim=(1, 2))

    def forward(self, kp1, kp2, weights=None):
        """Find the largest group of equal labels."""
        best, best_model = self.minimal_sample_size, None
        for i in range(self.max_iter):
            drawn = self.sample(self.minimal_sample_size, len(kp1), self.batch_size, kp1.device)
            first, second = self.remove_bad_samples(kp1[drawn], kp2[drawn])
            if len(first) == 0:
                continue
            models = self.estimate_model_from_minsample(first, second)
            pure = (first == models[:, None, None]).all(dim=2).all(dim=1)
            counts = (kp1[None, :, 0] == models[:, None]).sum(dim=1) * pure
            if counts.max() > best:
                best, best_model = int(counts.max()), models[counts.argmax()]
                enough = self.max_samples_by_conf(
                    int(best), len(kp1), self.minimal_sample_size, self.confidence
                )
                if (i + 1) * self.batch_size >= int(enough):
                    break
        return best_model, best
'''

PROGRAM = """
import inspect, pickle, threading
import torch, ransac_fix
{before}
from kornia.geometry.ransac import RANSAC
import kornia
original = dict(vars(RANSAC))
n, inliers = 20, 8
labels = torch.arange(n, dtype=torch.float32)
labels[:inliers] = 99.0
def run(cls=RANSAC, seed=0, **options):
    torch.manual_seed(seed)
    ransac = cls(**options)
    model, best = ransac(labels[:, None], labels[:, None])
    assert (float(model), best) == (99.0, inliers)
    return ransac.drawn
"""


def run_stand_in(tmp_path: Path, program: str, source: str = STAND_IN, before: str = "") -> str:
    for name, text in {
        "kornia/__init__.py": "__version__ = '0.8.2'\n",
        "kornia/geometry/__init__.py": "from .ransac import RANSAC\n",
        "kornia/geometry/ransac.py": source,
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(before=before) + program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_loop_is_mended(tmp_path: Path) -> None:
    """It ran to the end of its budget; now it ends in the batch in which enough are drawn."""
    exact = required_trials(8, 20, 2, 0.99)
    program = """
print(run(), run(batch_size=7, max_iter=100))
with ransac_fix.patched("kornia"):
    print(run(batch_size=1, max_iter=1600), run(), run(batch_size=7), run(max_iter=3))
ransac_fix.patch("kornia")
print(run(batch_size=1))
ransac_fix.unpatch()
print(run(), {k for k in original if vars(RANSAC).get(k) is not original[k]})
"""
    out = run_stand_in(tmp_path, program).splitlines()
    assert out[0] == "1600 700"
    assert out[1] == f"{exact} {-(-exact // 4) * 4} {-(-exact // 7) * 7} 12"
    assert out[2] == str(exact)
    assert out[3] == "1600 set()"


def test_patched_before_the_import(tmp_path: Path) -> None:
    out = run_stand_in(tmp_path, "print(run(batch_size=1))", before="ransac_fix.patch()")
    assert out == str(required_trials(8, 20, 2, 0.99))


def test_the_drop_in_class_for_releases_that_need_it(tmp_path: Path) -> None:
    program = """
from ransac_fix.patches.kornia import RANSAC as Exact  # noqa: N811 -- a class in capitals
from ransac_fix.patches.kornia import plan
assert Exact is not RANSAC and issubclass(Exact, RANSAC)
assert Exact.__name__ == "RANSAC" and Exact.__doc__ == RANSAC.__doc__
assert inspect.signature(Exact) == inspect.signature(RANSAC)
for name in ("forward", "sample", "max_samples_by_conf"):
    ours, own = getattr(Exact, name), getattr(RANSAC, name)
    assert inspect.signature(ours) == inspect.signature(own) and ours.__doc__ == own.__doc__
assert isinstance(inspect.getattr_static(Exact, "max_samples_by_conf"), staticmethod)
copy = pickle.loads(pickle.dumps(Exact(batch_size=1)))
assert type(copy) is Exact
assert dict(vars(RANSAC)) == original
found = []
threads = [threading.Thread(target=lambda c=c: found.append((c is Exact, run(c, batch_size=1))))
           for c in (Exact, RANSAC)]
for thread in threads: thread.start(); thread.join()
print(found)
torch.manual_seed(0)
print(copy(labels[:, None], labels[:, None])[1], copy.drawn)
# A method called from outside the loop is the library's own.
print(len(copy.sample(2, 20, 5)), Exact.max_samples_by_conf(8, 20, 2, 0.99))
with ransac_fix.patched("kornia", threads=True):
    print(run(Exact, batch_size=1), run(batch_size=1))
"""
    exact = required_trials(8, 20, 2, 0.99)
    out = run_stand_in(tmp_path, program).splitlines()
    assert out == [
        f"[(True, {exact}), (False, 400)]",
        f"8 {exact}",
        f"5 {float(exact)}",
        f"{exact} {exact}",
    ]


FAULTY = {
    "0.8.3: exact formula, faulty guard": (
        "p = (n_inl / num_tc) ** sample_size",
        (
            "p = math.comb(n_inl, sample_size) / math.comb(num_tc, sample_size); "
            "eps = math.inf if n_inl <= sample_size else eps"
        ),
        "formula is exact but its loop is not",
    ),
    "0.7.1: a wrong sign": (
        "min(-eps, math.log(max(eps, 1.0 - p)))",
        "max(eps, math.log(max(eps, 1.0 - p)))",
        "a wrong sign in its rule",
    ),
    "another method": (
        "batch_size, device=None",
        "batch_size, iteration=0, device=None",
        "RANSAC.sample takes self, sample_size, pop_size, batch_size, iteration, device and not",
    ),
    "another loop": (
        "self.remove_bad_samples(kp1[drawn], kp2[drawn])",
        "kp1[drawn], kp2[drawn]",
        "the loop in RANSAC.forward does not use remove_bad_samples",
    ),
    "another class": ("class RANSAC(", "class Ransac(", "has no class RANSAC"),
    "no rule": ("def max_samples_by_conf", "def samples", "no method max_samples_by_conf"),
}


@pytest.mark.parametrize("case", FAULTY)
def test_faulty_and_unknown_releases_are_refused_with_the_reason(case: str) -> None:
    old, new, reason = FAULTY[case]
    assert old in STAND_IN
    module = ModuleType("stand_in_for_kornia")
    exec(STAND_IN.replace(old, new), vars(module))
    before = {k: dict(vars(v)) for k, v in vars(module).items() if isinstance(v, type)}
    with pytest.raises(ransac_fix.PatchNotApplicable, match=reason):
        plan(module)
    assert {k: dict(vars(v)) for k, v in vars(module).items() if isinstance(v, type)} == before


def test_data_loader_workers(tmp_path: Path) -> None:
    """torch's DataLoader with spawned workers inherits `ransac-fix run`."""
    (tmp_path / "loader.py").write_text(
        "import torch\n"
        "class Trials(torch.utils.data.Dataset):\n"
        "    def __len__(self):\n"
        "        return 4\n"
        "    def __getitem__(self, index):\n"
        "        from sklearn.linear_model import _ransac\n"
        "        return _ransac._dynamic_max_trials(6, 20, 2, 0.99)\n"
        "if __name__ == '__main__':\n"
        "    for method in ('spawn', 'fork'):\n"
        "        loader = torch.utils.data.DataLoader(\n"
        "            Trials(), num_workers=1, multiprocessing_context=method)\n"
        "        print(method, *(float(batch) for batch in loader))\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "ransac_fix", "run", "loader.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.stdout.splitlines() == [f"{m} 56.0 56.0 56.0 56.0" for m in ("spawn", "fork")], (
        done.stderr
    )
