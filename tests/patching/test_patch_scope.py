"""`patched`: who is exact, and until when. Threads, async tasks, generators, odd orders."""

import asyncio
import random
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import pytest
from small_library import APPROXIMATE, EXACT, Library, MakeLibrary

import ransac_fix

T = TypeVar("T")


def in_a_thread(function: Callable[[], T]) -> T:
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(function).result()


@pytest.fixture(autouse=True)
def import_it(library: Library) -> None:
    library.robust()


def test_a_block_holds_in_its_thread_only(library: Library) -> None:
    original = library.robust()._trials
    with ransac_fix.patched(library.name):
        assert library.trials() == EXACT
        assert in_a_thread(library.trials) == APPROXIMATE
        assert in_a_thread(library.status).here is False
    assert library.trials() == APPROXIMATE
    assert library.robust()._trials is original


def test_a_block_of_another_thread_changes_nothing_here(library: Library) -> None:
    inside, leave = threading.Event(), threading.Event()

    def block() -> float:
        with ransac_fix.patched(library.name):
            inside.set()
            leave.wait(30)
            return library.trials()

    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(block)
        assert inside.wait(30)
        assert library.trials() == APPROXIMATE
        status = library.status()
        assert (status.state, status.here, status.process_wide) == ("patched", False, False)
        assert "in other threads or tasks only" in str(status)
        ransac_fix.patch(library.name)
        ransac_fix.unpatch(library.name)  # does not reach into the block
        leave.set()
        assert future.result() == EXACT
    assert library.trials() == APPROXIMATE


def test_threads_true_covers_the_process(library: Library) -> None:
    with ransac_fix.patched(library.name, threads=True):
        assert library.trials() == in_a_thread(library.trials) == EXACT
        assert library.status().process_wide
        with ransac_fix.patched(library.name, threads=True):
            pass
        assert in_a_thread(library.trials) == EXACT
        ransac_fix.unpatch()  # undoes `patch`, not the block
        assert in_a_thread(library.trials) == EXACT
    assert library.trials() == in_a_thread(library.trials) == APPROXIMATE


def test_patch_stays_after_a_block(library: Library) -> None:
    ransac_fix.patch(library.name)
    with ransac_fix.patched(library.name):
        pass
    assert library.trials() == EXACT


def test_import_inside_the_block(make_library: MakeLibrary) -> None:
    library = make_library()
    with ransac_fix.patched(library.name):
        assert library.trials() == EXACT
        assert in_a_thread(library.trials) == APPROXIMATE
    assert library.trials() == APPROXIMATE


def test_an_error_in_the_block_ends_it(library: Library) -> None:
    with pytest.raises(KeyError), ransac_fix.patched(library.name):
        raise KeyError
    assert library.trials() == APPROXIMATE


def test_one_manager_entered_again_and_nested(library: Library) -> None:
    manager = ransac_fix.patched(library.name)
    for _ in range(2):
        with manager:
            with manager:
                assert library.trials() == EXACT
            assert library.trials() == EXACT
        assert library.trials() == APPROXIMATE


def test_blocks_left_in_the_order_they_were_entered(library: Library) -> None:
    first, second = ransac_fix.patched(library.name), ransac_fix.patched(library.name)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert library.trials() == EXACT
    second.__exit__(None, None, None)
    assert library.trials() == APPROXIMATE
    assert library.status().scopes == 0


def test_a_generator_closed_by_another_thread(library: Library) -> None:
    def generator() -> Iterator[float]:
        with ransac_fix.patched(library.name):
            yield library.trials()

    suspended = generator()
    assert next(suspended) == EXACT
    in_a_thread(suspended.close)
    assert library.trials() == APPROXIMATE
    assert library.status().scopes == 0


def test_it_is_no_decorator(library: Library) -> None:
    """On a coroutine function it would silently do nothing."""
    with pytest.raises(TypeError):
        ransac_fix.patched(library.name)(library.trials)  # type: ignore[operator]


def test_async_tasks_do_not_change_each_other(library: Library) -> None:
    async def exact(turns: int) -> set[float]:
        with ransac_fix.patched(library.name):
            return {await one() for _ in range(turns)}

    async def plain(turns: int) -> set[float]:
        return {await one() for _ in range(turns)}

    async def one() -> float:
        await asyncio.sleep(0)
        return library.trials()

    async def main() -> list[set[float]]:
        return await asyncio.gather(exact(20), plain(50), exact(35), plain(10))

    assert asyncio.run(main()) == [{EXACT}, {APPROXIMATE}, {EXACT}, {APPROXIMATE}]
    assert library.status().scopes == 0


def test_a_task_started_in_the_block_is_exact_until_the_block_ends(library: Library) -> None:
    async def main() -> list[float]:
        left = asyncio.Event()
        found = []

        async def child() -> None:
            found.append(library.trials())
            found.append(await asyncio.to_thread(library.trials))
            await left.wait()
            found.append(library.trials())

        async def other() -> None:
            with ransac_fix.patched(library.name):
                left.set()
                await asyncio.sleep(0.05)

        with ransac_fix.patched(library.name):
            task = asyncio.create_task(child())
            await asyncio.sleep(0.1)
        # Another block, so that the stand-in is in place when the child looks again.
        await asyncio.gather(task, asyncio.create_task(other()))
        return found

    assert asyncio.run(main()) == [EXACT, EXACT, APPROXIMATE]


def test_two_systems_are_independent(make_library: MakeLibrary) -> None:
    first, second = make_library(), make_library()
    first.robust(), second.robust()
    with ransac_fix.patched(first.name):
        assert (first.trials(), second.trials()) == (EXACT, APPROXIMATE)
        with ransac_fix.patched(second.name):
            assert (first.trials(), second.trials()) == (EXACT, EXACT)
        assert (first.trials(), second.trials()) == (EXACT, APPROXIMATE)


def test_threads_that_patch_and_unpatch_while_others_call(library: Library) -> None:
    """No crash, no third number, blocks always exact, and nothing left behind."""
    module = library.robust()
    original = module._trials
    stop = threading.Event()
    errors: list[BaseException] = []

    def hammer(work: Callable[[random.Random], None], seed: int) -> None:
        rng = random.Random(seed)
        try:
            while not stop.is_set():
                work(rng)
        except BaseException as error:  # noqa: BLE001 -- carried to the main thread
            errors.append(error)

    def call(_: random.Random) -> None:
        assert library.trials() in (APPROXIMATE, EXACT)

    def block(rng: random.Random) -> None:
        with ransac_fix.patched(library.name, threads=rng.random() < 0.3):
            assert library.trials() == EXACT

    def switch(rng: random.Random) -> None:
        rng.choice([ransac_fix.patch, ransac_fix.unpatch])(library.name)

    def look(_: random.Random) -> None:
        assert library.status().state in ("patched", "off", "waiting")

    work = [call, call, block, block, switch, switch, look]
    threads = [threading.Thread(target=hammer, args=(w, i)) for i, w in enumerate(work)]
    for thread in threads:
        thread.start()
    stop.wait(1.5)
    stop.set()
    for thread in threads:
        thread.join(30)
    assert not errors
    ransac_fix.unpatch()
    assert module._trials is original
    assert library.trials() == APPROXIMATE
    assert library.status().scopes == 0
