"""Put on PYTHONPATH by ransac-fix, so that worker processes patch what their parent patches.

Any Python may meet this file: an old one, one without ransac-fix. It stays silent there. The
sitecustomize module that would have been found without it runs first.
"""

# ruff: noqa: PTH100, PTH120 -- pathlib is slow to import

import os
import sys

_here = os.path.dirname(os.path.abspath(__file__))
sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry or ".") != _here]
del sys.modules[__name__]
try:
    try:
        __import__("sitecustomize")  # by name: it may well not exist
    except ImportError as error:
        if getattr(error, "name", "sitecustomize") != "sitecustomize":
            raise
        # There was none: this module is the one, as far as the rest of Python can see.
        sys.modules["sitecustomize"] = type(sys)("sitecustomize", __doc__)
finally:
    try:
        from ransac_fix.patching.startup import begin
    except Exception:  # noqa: BLE001, S110 -- not a Python that has ransac-fix
        pass
    else:
        begin()
