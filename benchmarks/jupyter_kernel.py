"""Patch and trace in a Jupyter kernel: ``python benchmarks/jupyter_kernel.py``.

Needs ``ipykernel`` beside ransac-fix and OpenCV. Starts kernels as Jupyter does and runs cells in
them; the exit code is 1 where a result is not what it should be.
"""

import os
import sys
from typing import Any

from jupyter_client.manager import KernelManager

from ransac_fix.patching import startup
from ransac_fix.patching.plugins import discover

_PROBLEM = """
import numpy as np
rng = np.random.default_rng(0)
x, y = rng.uniform(0, 1000, (2, 24, 2))
y[:7] = x[:7] @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + 5
y[7:15] = x[7:15] @ np.array([[1, 0.2], [-0.2, 1]]) - 9
def find(cv2):
    return int(cv2.findHomography(x, y, cv2.RANSAC, 1.0, None, 100_000, 0.05)[1].sum())
"""
_STATE = "next(s.state for s in ransac_fix.status().systems if s.system == 'opencv')"
_POOL = """
from concurrent.futures import ProcessPoolExecutor
import multiprocessing
def work(_):
    import cv2, sys
    return hasattr(cv2.findHomography, "__ransac_fix__")
with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
    print(*pool.map(work, [0]))
"""

# What is run, cell by cell, and what it prints.
_CELLS: dict[str, list[tuple[str, str]]] = {
    "import ransac_fix.auto in the first cell": [
        ("import ransac_fix, ransac_fix.auto, cv2", ""),
        (f"print({_STATE})", "patched"),
        (_POOL, "True"),
        (f"ransac_fix.unpatch(); print({_STATE})", "off"),
    ],
    "patch after the library is in use": [
        (f"import cv2, ransac_fix\n{_PROBLEM}\nfirst = find(cv2)", ""),
        (f"ransac_fix.patch('opencv')\nprint({_STATE}, find(cv2) >= first)", "patched True"),
    ],
    "a trace of one cell": [
        (f"import cv2, ransac_fix\n{_PROBLEM}", ""),
        ("with ransac_fix.trace(verify=3) as t:\n    for _ in range(3): find(cv2)", ""),
        ("print(t.report.calls, t.report.verification.replayed)", "3 3"),
        ("print(t.report.sites[0].caller)", "find"),
    ],
    "a kernel started by `ransac-fix run`": [
        ("import cv2, sys; print(hasattr(cv2.findHomography, '__ransac_fix__'))", "True"),
        ("import ransac_fix", ""),
        (f"print({_STATE})", "patched"),
    ],
}


def run(cells: list[tuple[str, str]], environ: dict[str, str]) -> list[str]:
    """Run cells in one kernel; return what went wrong."""
    manager: Any = KernelManager(kernel_name="")
    manager._kernel_spec = _spec()
    manager.start_kernel(env=environ)
    client = manager.blocking_client()
    client.start_channels()
    wrong = []
    try:
        client.wait_for_ready(timeout=120)
        for source, expected in cells:
            said: list[str] = []

            def hear(message: Any, said: list[str] = said) -> None:
                content = message["content"]
                if message["msg_type"] == "stream":
                    said.append(content["text"])
                elif message["msg_type"] == "error":
                    said.append(f"{content['ename']}: {content['evalue']}")

            client.execute_interactive(source, output_hook=hear, timeout=300)
            printed = "".join(said).strip()
            if printed != expected:
                wrong.append(f"{source!r} printed {printed!r} in place of {expected!r}")
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
    return wrong


def _spec() -> Any:
    from jupyter_client.kernelspec import KernelSpec

    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    return KernelSpec(argv=command, display_name="Python", language="python")


def main() -> int:
    """Run every case."""
    failed = False
    for name, cells in _CELLS.items():
        environ = dict(os.environ)
        if "ransac-fix run" in name:
            systems = {system: patch.modules for system, patch in discover().patches.items()}
            startup.environment(environ, systems)
        wrong = run(cells, environ)
        print(f"{'failed' if wrong else 'passed'}: {name}", *wrong, sep="\n    ", flush=True)
        failed |= bool(wrong)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
