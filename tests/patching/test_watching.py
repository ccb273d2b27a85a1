"""Which call is being watched."""

import threading

from ransac_fix.patching.watching import CURRENT, Watched, note, watching

FACTS = (5, 20, 3, 0.9, 10.0, 100.0)


def test_a_block_inside_another_takes_over_until_it_ends() -> None:
    outer, inner = Watched(True), Watched(False)
    with watching(outer):
        with watching(inner):
            assert note(*FACTS) is inner
        assert CURRENT.watched is outer
        assert note(*FACTS[:4], None, 100.0) is outer
        note(*FACTS)
    assert CURRENT.watched is None
    assert note(*FACTS) is None
    assert inner.first == inner.facts == (*FACTS, "distinct", None)
    assert outer.first is not None
    assert outer.facts is not None
    assert (outer.first[4], outer.facts[4]) == (None, 10.0)


def test_another_thread_is_not_watched() -> None:
    seen: list[Watched | None] = []
    with watching(Watched(True)):
        thread = threading.Thread(target=lambda: seen.append(CURRENT.watched))
        thread.start()
        thread.join()
    assert seen == [None]
