"""The verdicts on libraries that can neither be seeded nor counted, and on two that never stop."""

import sys

import pytest

from ransac_fix.audit.host import WorkerFailed, WorkerHost
from ransac_fix.audit.judge import judge
from ransac_fix.audit.measure import measure
from ransac_fix.audit.session import probe_files


def described(system):
    with WorkerHost(probe_files()[system], sys.executable, 300) as host:
        answer = host.ask("describe")
        assert answer["installed"]
        yield host, {one["name"]: one for one in answer["entry_points"]}


@pytest.fixture
def probe(request):
    yield from described(request.param)


@pytest.mark.parametrize(
    ("probe", "name"),
    [
        ("magsac", "findRigidTransformation(sampler=0)"),
        ("gc-ransac", "findRigidTransform(sampler=0)"),
    ],
    indirect=["probe"],
)
def test_magsac_and_gc_ransac_assume_too_much(probe, name):
    """Which of two laws that undersample it is, so few measurements in a sample do not tell."""
    host, entry_points = probe
    verdict, reason = judge(found := measure(host, entry_points[name]))
    assert verdict == "undersamples", reason
    assert (found.fit.law.assumed, found.fit.law.sample_size) == ("approximate", 3)
    assert found.fit.law.phi is None
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", 3)
    exact = next(r for r in found.outcomes.ratios if r.law == "ln(1-s)/ln(1-C(I,3)/C(n,3))")
    assert exact.log_ratio > 13.8


@pytest.mark.parametrize("probe", ["opencv"], indirect=True)
def test_a_function_of_opencv_that_takes_no_number_of_trials(probe):
    """Its generator is fixed, so that this comes out the same every time."""
    host, entry_points = probe
    verdict, reason = judge(found := measure(host, entry_points["estimateAffine3D(RANSAC)"]))
    assert verdict == "undersamples", reason
    assert (found.fit.law.assumed, found.fit.law.sample_size) == ("approximate", 4)
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", 4)
    exact = next(r for r in found.outcomes.ratios if r.law == "ln(1-s)/ln(1-C(I,4)/C(n,4))")
    assert exact.log_ratio > 13.8


@pytest.mark.parametrize("probe", ["magsac"], indirect=True)
def test_a_function_that_crashes_is_not_measured(probe):
    host, entry_points = probe
    with pytest.raises(WorkerFailed, match="crashed with SIGSEGV"):
        measure(host, entry_points["findLine2D(sampler=0)"])


@pytest.mark.parametrize("probe", ["pyransac3d"], indirect=True)
@pytest.mark.parametrize(("name", "k"), [("Plane.fit", 3), ("Line.fit", 2)])
def test_pyransac3d_has_no_stopping_rule(probe, name, k):
    host, entry_points = probe
    verdict, reason = judge(found := measure(host, entry_points[name]))
    assert (verdict, reason) == ("other rule", "it has no stopping rule: it always uses its budget")
    assert (found.sampler.drawn, found.sampler.sample_size) == ("distinct", k)
