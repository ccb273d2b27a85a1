"""Libraries beyond the test extra: tested where they are installed, and always in CI."""

import os
import sys

import pytest

from ransac_fix.audit.host import WorkerHost
from ransac_fix.audit.session import probe_files

NOT_IN_CI = "CI is set, and there everything must be installed that the tests measure"


def described(system, how):
    """Yield a worker with the library, and its entry points by name; skip where it is missing."""
    with WorkerHost(probe_files()[system], sys.executable, 600) as host:
        answer = host.ask("describe")
        missing = f"{system} is not installed: {how}"
        if answer["installed"]:
            reasons = [one.get("unmeasured", "") for one in answer["entry_points"]]
            missing = next((why for why in reasons if "install " in why), "")
        if missing:
            if os.environ.get("CI"):
                pytest.fail(f"{missing} ({NOT_IN_CI})")
            pytest.skip(missing)
        yield host, {one["name"]: one for one in answer["entry_points"]}, answer["version"]
