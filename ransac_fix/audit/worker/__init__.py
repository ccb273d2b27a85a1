"""The side of the audit that runs next to the audited library.

It is started by file path in the interpreter of any environment, so everything here imports the
standard library and numpy only, keeps to Python 3.10, and talks to the audit in JSON lines.
"""
