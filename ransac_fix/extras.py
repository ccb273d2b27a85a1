"""What a command needs beyond the base install."""

from importlib.util import find_spec

from ransac_fix.errors import RansacFixError


def need(*modules: str, extra: str) -> None:
    """Raise an error that names the extra if a module is not installed.

    Raises
    ------
    RansacFixError
        With the modules that are missing and the line that installs them.
    """
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise RansacFixError(f"this needs {', '.join(missing)}: pip install 'ransac-fix[{extra}]'")
