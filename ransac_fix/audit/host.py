"""The audit's end of a worker: start it, ask, and survive its crashes and hangs."""

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

_WORKER = Path(__file__).parent / "worker" / "__main__.py"
# One thread each: several workers run at once, and some libraries race with more.
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)

NO_ANSWER = "gave no answer within its time"
# For a process that will answer no more to end by itself.
_LAST_SECONDS = 10.0


class WorkerFailed(Exception):  # noqa: N818 -- what happened, in the words of a verdict
    """The worker gave no answer; the text says why, in one line."""


class WorkerHost:
    """One worker process.

    Parameters
    ----------
    probe_file : Path
        The probe.
    python : str
        Interpreter of the environment to measure.
    seconds : float
        How long to wait for its answers; see `allow`.
    arguments : sequence of str, optional
        Further arguments of the worker, for probes that read some.
    """

    def __init__(
        self, probe_file: Path, python: str, seconds: float, arguments: Sequence[str] = ()
    ) -> None:
        self.allow(seconds)
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 -- closed by close()
        try:
            self._process = subprocess.Popen(  # noqa: S603 -- the interpreter the user named
                [python, str(_WORKER), str(probe_file), *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr,
                env={**os.environ, **_ONE_THREAD},
                start_new_session=True,
                text=True,
                encoding="utf-8",
            )
        except OSError as error:
            self._stderr.close()
            raise WorkerFailed(f"{python} did not start: {error.strerror}") from None
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._answer()
        except WorkerFailed:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def allow(self, seconds: float) -> None:
        """Wait for answers for so many seconds from now on, all requests together."""
        self._deadline = time.monotonic() + seconds

    def ask(self, do: str, **request: Any) -> dict[str, Any]:
        """Send one request and return its answer.

        Raises
        ------
        WorkerFailed
            If the library raised, crashed or hung.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"do": do, **request}) + "\n")
            self._process.stdin.flush()
        except OSError:
            raise WorkerFailed(self._death()) from None
        return self._answer()

    def close(self) -> None:
        """End the process and everything it started."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
            self._process.wait(timeout=0.5)
        except (OSError, subprocess.TimeoutExpired):
            self._kill()
        self._stderr.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put("")

    def _answer(self) -> dict[str, Any]:
        started = time.monotonic()
        try:
            line = self._lines.get(timeout=max(0.01, self._deadline - started))
        except queue.Empty:
            self._kill()
            seconds = time.monotonic() - started
            raise WorkerFailed(f"{NO_ANSWER} ({seconds:.0f} s)") from None
        # A line that does not end is what a crash has left of an answer.
        if not line.endswith("\n"):
            raise WorkerFailed(self._death())
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise WorkerFailed(str(answer["error"]))
        return answer

    def _death(self) -> str:
        try:
            code = self._process.wait(timeout=_LAST_SECONDS)
        except subprocess.TimeoutExpired:
            self._kill()
            return "closed the pipe that its answers go through"
        self._stderr.seek(0)
        said = self._stderr.read().decode("utf-8", "replace").strip().splitlines()
        how = f"crashed with {signal.Signals(-code).name}" if code < 0 else f"exited with {code}"
        return f"{how}: {said[-1][:200]}" if said else how

    def _kill(self) -> None:
        if sys.platform == "win32":
            self._process.kill()
        else:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
