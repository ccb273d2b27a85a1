"""How many models a traced program really missed: a sample of its calls, made again exactly."""

import json
import math
import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep

from ransac_fix.patching import startup
from ransac_fix.patching.calls import Key
from ransac_fix.patching.samples import SUFFIX, kept

__all__ = ["Verified", "interval", "verify"]

# Seconds for one call, and for all.
_LONGEST_CALL = 60.0
_LONGEST = 600.0
_POLL = 0.02


@dataclass(slots=True)
class Verified:
    """Calls made again.

    Attributes
    ----------
    telling : int
        Calls of the program in which a model can have been missed: they stopped short while
        their limits allowed more trials. The sample is drawn from these.
    replayed, missed : dict
        For each call site, how many calls were made again, and how many of them then found a
        model with more inliers.
    gains : list of int
        How many more, for each of these.
    not_replayed : dict
        Reasons why calls of the sample could not be made again, and how many there were.
    """

    telling: int
    replayed: dict[Key, int] = field(default_factory=dict)
    missed: dict[Key, int] = field(default_factory=dict)
    gains: list[int] = field(default_factory=list)
    not_replayed: dict[str, int] = field(default_factory=dict)

    def leave(self, why: str) -> None:
        """Count a call that could not be made again."""
        self.not_replayed[why] = self.not_replayed.get(why, 0) + 1


def verify(folder: str, telling: Mapping[str, int], sample_size: int) -> Verified:
    """Make a sample of the recorded calls again.

    Parameters
    ----------
    folder : str
        Where processes kept theirs.
    telling : mapping
        How many calls each process drew its sample from.
    sample_size : int
        How many to make again.
    """
    verified = Verified(sum(telling.values()))
    heads: dict[str, Key] = {}
    for path in _drawn(folder, telling, sample_size):
        head, _ = kept(path)
        if head["why"]:
            verified.leave(head["why"])
        else:
            system, function, file, line, caller = head["key"]
            heads[str(path)] = system, function, file, line, caller
    for file, outcome in _replayed(folder, list(heads)):
        if isinstance(outcome, str):
            verified.leave(outcome)
            continue
        key, gain = heads[file], outcome[1] - outcome[0]
        verified.replayed[key] = verified.replayed.get(key, 0) + 1
        if gain > 0:
            verified.missed[key] = verified.missed.get(key, 0) + 1
            verified.gains.append(gain)
    return verified


def _drawn(folder: str, telling: Mapping[str, int], sample_size: int) -> list[Path]:
    """Return a uniform sample of all calls, from the samples of the processes."""
    chance = random.Random(sample_size)  # noqa: S311 -- not for secrets
    files: dict[str, list[Path]] = {name: [] for name in telling}
    for path in sorted(Path(folder).glob(f"*{SUFFIX}")):
        name = path.name.removesuffix(SUFFIX).rpartition(".")[0]
        if name in files:
            files[name].append(path)
    left = {name: count for name, count in telling.items() if files[name]}
    for paths in files.values():
        chance.shuffle(paths)
    drawn: list[Path] = []
    while left and len(drawn) < sample_size:
        name = chance.choices(list(left), list(left.values()))[0]
        drawn.append(files[name].pop())
        left[name] -= 1
        if not left[name] or not files[name]:
            del left[name]
    return drawn


def _replayed(folder: str, files: list[str]) -> Iterator[tuple[str, tuple[int, int] | str]]:
    """Yield what became of each call: inliers with both rules, or why it was not made again."""
    results = Path(folder, "replayed")
    environ = {**os.environ, "RANSAC_FIX_SLACK": "0"}
    environ.pop(startup.TRACE, None)
    startup.environment(environ, {})
    end = monotonic() + _LONGEST
    left = list(files)
    while left:
        results.write_text("")
        # -P: nothing in the current folder may stand in for a module.
        command = [sys.executable, "-P", "-m", "ransac_fix.patching.replay", str(results), *left]
        with subprocess.Popen(  # noqa: S603 -- this interpreter, this package
            command,
            env=environ,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as program:
            why = _watch(program, results, end)
        lines = [json.loads(line) for line in results.read_text().splitlines()]
        for line in lines:
            if "done" in line:
                left.remove(line["done"])
                yield line["done"], line.get("why") or tuple(line["n_inliers"])
        if not left:
            return
        if monotonic() >= end:
            for file in left:
                yield file, f"there was no time left after {_LONGEST:.0f} s"
            return
        # The call under way, or all of them where the program did not begin any.
        stuck = left[:1] if lines else left[:]
        for file in stuck:
            left.remove(file)
            yield file, why


def _watch(program: "subprocess.Popen[bytes]", results: Path, end: float) -> str:
    """Wait for the program; end it where one call takes too long. Return why it ended."""
    size, since = -1, monotonic()
    while program.poll() is None:
        now = monotonic()
        if results.stat().st_size != size:
            size, since = results.stat().st_size, now
        if now - since > _LONGEST_CALL or now > end:
            program.kill()
            return f"the call took more than {_LONGEST_CALL:.0f} s when it was made again"
        sleep(_POLL)
    return "the library crashed when the call was made again"


def interval(successes: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of Clopper and Pearson for a probability.

    Parameters
    ----------
    successes, runs : int
        What was seen.
    level : float, default 0.95
        The least chance with which the interval covers the true probability.
    """
    tail = (1 - level) / 2
    low = 0.0 if successes == 0 else _solve(lambda p: 1 - _cdf(successes - 1, runs, p), tail)
    high = 1.0 if successes == runs else _solve(lambda p: -_cdf(successes, runs, p), -tail)
    return low, high


def _solve(rising: Callable[[float], float], value: float) -> float:
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if rising(middle) < value else (low, middle)
    return (low + high) / 2


def _cdf(successes: int, runs: int, chance: float) -> float:
    """Return the chance of no more than so many successes."""
    if chance <= 0 or chance >= 1:
        return float(chance <= 0)
    return math.fsum(
        math.exp(
            math.lgamma(runs + 1)
            - math.lgamma(count + 1)
            - math.lgamma(runs - count + 1)
            + count * math.log(chance)
            + (runs - count) * math.log1p(-chance)
        )
        for count in range(successes + 1)
    )
