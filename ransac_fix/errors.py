"""The errors and warnings a user of ransac-fix can meet."""


class RansacFixError(Exception):
    """An error that is the user's to mend: one line saying what, where and what to do.

    The command line prints it without a traceback and exits with code 2.
    """


class PatchNotApplicable(RansacFixError):  # noqa: N818 -- a public name, read as a sentence
    """The code to be patched does not have the shape the patch was written for."""


class RansacFixWarning(UserWarning):
    """Something was left unpatched, or differs from what was asked, and the program goes on."""
