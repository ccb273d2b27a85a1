"""Where ransac-fix keeps what it can do without."""

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """Return the folder of the user's own cache; it need not exist."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "ransac-fix"
