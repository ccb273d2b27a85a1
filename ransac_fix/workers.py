"""Where joblib's work runs: on this machine, or on the workers of a dask scheduler."""

from collections.abc import Iterator
from contextlib import contextmanager

from ransac_fix.errors import RansacFixError


@contextmanager
def workers(dask_scheduler: str | None) -> Iterator[None]:
    """Send what joblib runs inside to a dask scheduler, if one is named.

    Parameters
    ----------
    dask_scheduler : str or None
        Its address, such as ``tcp://10.0.0.1:8786``. Its workers need ransac-fix.

    Raises
    ------
    RansacFixError
        dask is not installed, or there is no scheduler.
    """
    if dask_scheduler is None:
        yield
        return
    import joblib

    try:
        from distributed import Client
    except ImportError:
        raise RansacFixError("--dask needs dask: pip install 'ransac-fix[dask]'") from None
    try:
        client = Client(dask_scheduler, timeout=20)
    except (OSError, ValueError) as error:
        raise RansacFixError(f"no dask scheduler at {dask_scheduler}: {error}") from None
    with client, joblib.parallel_config(backend="dask"):
        yield
