"""The audit's measurement for test suites: does my RANSAC stop when it should.

A RANSAC is wrapped in a function ``function(x, y, *, threshold, max_trials, confidence, seed)``
that returns the inliers as a boolean mask over the measurements (None where no model was found),
or such a mask and the number of trials run. x and y are arrays with one measurement a row, the
two sides of it:

=========================  =========================  ==========================  ==
problem                    x                          y                           k
=========================  =========================  ==========================  ==
``line``                   (n, 1) abscissa            (n, 1) ordinate             2
``plane``                  (n, 3) point               (n, 0) nothing              3
``plane_patch``            (n, 3) point, groups close  (n, 0) nothing              3
``circle``                 (n, 2) point               (n, 0) nothing              3
``line3d``                 (n, 3) point               (n, 0) nothing              2
``sphere``                 (n, 3) point               (n, 0) nothing              4
``translation``            (n, 2) pixel               (n, 2) pixel                1
``similarity``             (n, 2) pixel               (n, 2) pixel                2
``affine``                 (n, 2) pixel               (n, 2) pixel                3
``homography``             (n, 2) pixel               (n, 2) pixel                4
``segments``               (n, 4) two pixels          (n, 4) two pixels           4
``fundamental``            (n, 2) pixel               (n, 2) pixel                7
``essential``              (n, 2) pixel               (n, 2) pixel                5
``absolute_pose``          (n, 3) world point         (n, 2) pixel                3
``absolute_position``      (n, 3) world point         (n, 2) pixel                2
``rotation``               (n, 2) pixel               (n, 2) pixel                2
``translation_direction``  (n, 2) pixel               (n, 2) pixel                2
``translation3d``          (n, 3) point               (n, 3) point                1
``rigid3d``                (n, 3) point               (n, 3) point                3
``similarity3d``           (n, 3) point               (n, 3) point                3
``affine3d``               (n, 3) point               (n, 3) point                4
=========================  =========================  ==========================  ==

Cameras have a focal length of 1000 pixels and their centre at (512, 512). They only rotate in
``rotation``; their rotation is known, the identity, in ``absolute_position`` and
``translation_direction``. Any floor on the number of trials must be 0 and any multiplier 1. The
same seed must give the same samples, whatever the other arguments.
A function without a seed is measured too: by its trials where it returns them, and by the
outcomes of some thousand runs where it does not. So is one that takes no ``max_trials``: any limit
of its own must be 1000 or more.
"""

from collections.abc import Callable
from typing import Any

from ransac_fix.audit.judge import judge
from ransac_fix.audit.local import LocalHost
from ransac_fix.audit.measure import measure
from ransac_fix.audit.model import Judgement, Point, Verdict
from ransac_fix.audit.user import entry_point

__all__ = ["assert_stopping_rule", "measure_stopping_rule"]


def measure_stopping_rule(
    function: Callable[..., Any],
    *,
    problem: str,
    sample_size: int | None = None,
    typical_trials: int = 40,
) -> Verdict:
    """Measure which stopping rule a RANSAC obeys and how it draws its samples.

    Parameters
    ----------
    function : callable
        See the module's documentation.
    problem : str
        What it estimates: a row of the table there.
    sample_size : int, optional
        k, 1 to 20, where it is not the one in the table.
    typical_trials : int, optional
        How many trials a run may take, 10 to 1000; the measurement takes some hundred runs.

    Returns
    -------
    Verdict
        ``verdict`` is "exact", "undersamples", "oversamples", "other rule" or "not measured",
        ``reason`` says why; ``sampler_law`` and ``stopping_law`` are the laws found (None where
        there are none), ``points`` the evidence, ``runs`` how often the function was called.

    Raises
    ------
    RansacFixError
        If the problem is unknown, a number is out of range or the function returns something else
        than a mask.
    """
    host = LocalHost(
        entry_point(
            function, problem=problem, sample_size=sample_size, typical_trials=typical_trials
        )
    )
    measured = measure(host, host.described)
    verdict, reason = judge(measured)
    return Verdict(
        "your own",
        host.described["name"],
        None,
        verdict,
        reason,
        sampler_law=measured.sampler,
        stopping_law=measured.fit.law,
        points=measured.points,
        defects=measured.defects,
        outcomes=measured.outcomes,
        runs=measured.runs,
    )


def assert_stopping_rule(
    function: Callable[..., Any],
    *,
    problem: str,
    sample_size: int | None = None,
    typical_trials: int = 40,
    expected: Judgement = "exact",
) -> None:
    """Fail unless a RANSAC's stopping rule is what it should be.

    Parameters
    ----------
    function, problem, sample_size, typical_trials
        As in `measure_stopping_rule`.
    expected : str, optional
        The verdict that passes.

    Raises
    ------
    AssertionError
        With the law found, the reason and the evidence.
    RansacFixError
        As `measure_stopping_rule`.

    Examples
    --------
    >>> def test_my_ransac_stops_when_it_should():  # doctest: +SKIP
    ...     assert_stopping_rule(my_line_ransac, problem="line")
    """
    __tracebackhide__ = True  # pytest shows the call and the message
    found = measure_stopping_rule(
        function, problem=problem, sample_size=sample_size, typical_trials=typical_trials
    )
    if found.verdict != expected:
        raise AssertionError(_message(found, expected))


def _message(found: Verdict, expected: Judgement) -> str:
    law = f" by {found.stopping_law.formula}" if found.stopping_law else ""
    lines = [f"{found.entry_point}: {found.verdict}{law}, not {expected}: {found.reason}"]
    lines += [_point(point) for point in found.points[:3]]
    return "\n".join(lines)


def _point(point: Point) -> str:
    return (
        f"  with {point.n_inliers} of {point.n} in hand, trial {point.trials} happens from "
        f"-ln(1-s) = {point.u:.4f} on"
    )
