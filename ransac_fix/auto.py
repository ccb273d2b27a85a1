"""Importing this module makes every supported library exact, here and in worker processes.

Libraries are patched when they are imported, or at once where they are already. Processes
started afterwards (joblib, multiprocessing, torch's data loaders, subprocesses) inherit it
through the environment. ``RANSAC_FIX=0`` switches it off; `ransac_fix.unpatch` undoes it;
`ransac_fix.status` says what happened.
"""

from ransac_fix.patching.startup import off

if not off():
    from ransac_fix.patching.engine import patch, share_with_workers

    patch()
    share_with_workers()
