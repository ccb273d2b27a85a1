"""Make installed libraries exact at run time, and undo it.

`patch` and `unpatch` act on the whole process, ``with patched():`` on the thread or async task
that enters it, `status` says what is in force. A library is added by one file: see
`ransac_fix.patching.interface`.

The names are loaded when first used: what a worker process imports at its start
(`ransac_fix.patching.startup`) must cost next to nothing.
"""

TYPE_CHECKING = False  # what type checkers take for true; importing `typing` takes longer than all
if TYPE_CHECKING:
    from ransac_fix.patching.engine import patch, patched, status, unpatch

__all__ = ["patch", "patched", "status", "unpatch"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ransac_fix.patching import engine

    value: object = getattr(engine, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
