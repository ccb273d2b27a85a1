"""Start the worker: ``python .../worker PROBE_FILE``, requests on stdin, answers on stdout.

This copy of ransac_fix is found from the file's own place, so that the worker runs in
environments where ransac_fix is not installed, and nothing else of the audit's environment
becomes importable there.
"""

import contextlib
import importlib.util
import os
import sys
from pathlib import Path


def _make_importable(package: Path) -> None:
    """Make the ransac_fix at ``package`` the one that is imported."""
    spec = importlib.util.spec_from_file_location(
        "ransac_fix", package / "__init__.py", submodule_search_locations=[str(package)]
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["ransac_fix"] = module
    spec.loader.exec_module(module)


# Set in a worker that was started again, to what LD_PRELOAD was before.
_STARTED_AGAIN = "RANSAC_FIX_AUDIT_PRELOAD"


def _preload(probe_file: Path) -> None:
    """Start this process again with what the probe wants loaded before everything else."""
    from ransac_fix.audit.worker.serve import load_probe

    before = os.environ.pop(_STARTED_AGAIN, None)
    if before is not None:
        # For this process, not for those it starts.
        os.environ["LD_PRELOAD"] = before
        return
    library = None
    # What is wrong with a probe is reported where it is loaded to be used.
    with contextlib.suppress(Exception):
        probe = load_probe(probe_file)
        library = probe.preload() if probe.preload is not None else None
    if library is not None:
        before = os.environ.get("LD_PRELOAD", "")
        preloaded = f"{library}:{before}" if before else str(library)
        environment = {**os.environ, "LD_PRELOAD": preloaded, _STARTED_AGAIN: before}
        os.execve(sys.executable, [sys.executable, *sys.argv], environment)  # noqa: S606


def main() -> None:
    """Serve until stdin ends."""
    here = Path(__file__).resolve().parent
    # Python put the folder of this file first on the path; its modules are not top-level ones.
    sys.path = [entry for entry in sys.path if Path(entry or ".").resolve() != here]
    _make_importable(here.parent.parent)
    from ransac_fix.audit.worker.serve import serve

    _preload(Path(sys.argv[1]))
    # Libraries print. Answers keep the real standard output, everything else goes to stderr.
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answers:
        os.dup2(2, 1)
        serve(Path(sys.argv[1]), sys.stdin, answers)


if __name__ == "__main__":
    main()
