"""C++ drivers: compiled on demand, kept, and no trouble where they cannot be compiled."""

import os
import shutil
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from ransac_fix.audit.host import WorkerHost
from ransac_fix.audit.session import probe_files
from ransac_fix.audit.worker import native
from ransac_fix.audit.worker.interface import Settings

DRIVER = """
#include "driver.hpp"
#include <invented/library.hpp>

int main() {
    using driver::Answer;
    using driver::Request;
    return driver::serve({
        {"echo", [](const Request& request) {
            std::printf("noise on standard output\\n");
            Answer answer;
            answer.trials = request.at_defaults() ? -1 : request.max_trials;
            answer.found = true;
            for (std::size_t i = 0; i < request.rows; ++i)
                if (request.row(i)[0] < request.threshold && request.confidence == 1.0 / 3)
                    answer.inliers.push_back(static_cast<int>(i));
            return answer;
        }},
        {"nothing", [](const Request&) { return Answer{}; }},
        {"throw", [](const Request&) -> Answer { throw std::runtime_error("not\\ntoday"); }},
        {"crash", [](const Request&) -> Answer { std::abort(); }},
    });
}
"""
SETTINGS = Settings(max_trials=7, confidence=1 / 3)
DATA = np.array([[0.1, 5.0], [0.3, 5.0], [0.1 + 2**-52, 5.0]])


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "ransac-fix" / "drivers"


@pytest.fixture
def library(tmp_path, monkeypatch, cache):
    """An invented library of one header, and its driver."""
    if native._compiler() is None:
        assert not os.environ.get("CI"), "install g++: in CI nothing is skipped"
        pytest.skip("needs a C++ compiler")
    header = tmp_path / "include" / "invented" / "library.hpp"
    header.parent.mkdir(parents=True)
    header.write_text('#define INVENTED_VERSION "1.2.3"\n')
    monkeypatch.setenv("CPATH", str(tmp_path / "include"))
    folder = tmp_path / "drivers"
    folder.mkdir()
    (folder / "invented.cpp").write_text(DRIVER)
    shutil.copy(Path(probe_files()["opengv"]).parent / "drivers" / "driver.hpp", folder)
    return native.Library(
        title="Invented",
        source=folder / "invented.cpp",
        header=native.Header("invented/library.hpp", "libinvented-dev"),
        version_macro=("invented/library.hpp", "INVENTED_VERSION"),
    )


def run(driver, entry, settings=SETTINGS):
    return driver.run(entry, DATA, 0.1 + 2**-52, settings, 3)


def test_numbers_arrive_as_they_were_sent_and_output_of_the_library_does_not_mix(library):
    driver = library.start()
    for _ in range(3):
        outcome = run(driver, "echo")
        assert outcome.trials == 7
        assert outcome.inliers.tolist() == [True, False, False]
    assert run(driver, "echo", None).trials == -1
    assert run(driver, "nothing").inliers is None


def test_an_exception_is_an_error_and_a_crash_ends_the_driver_only(library):
    driver = library.start()
    with pytest.raises(native.DriverError, match="not today"):
        run(driver, "throw")
    with pytest.raises(native.DriverError, match="Invented crashed with SIGABRT"):
        run(driver, "crash")
    assert run(driver, "echo").trials == 7


def test_a_driver_is_compiled_once_and_again_when_the_library_changes(library, cache):
    library.start()
    (first,) = cache.iterdir()
    made = first.stat().st_mtime_ns
    library.start()
    assert [file.name for file in cache.iterdir()] == [first.name]
    assert first.stat().st_mtime_ns == made
    header = library.header.find() / library.header.path
    header.write_text('#define INVENTED_VERSION "1.2.4"\n')
    assert library.version() == "1.2.4"
    library.start()
    assert len(list(cache.iterdir())) == 2


@pytest.mark.parametrize("mode", [0o755, 0o644])
def test_a_kept_driver_that_does_not_start_is_compiled_again(library, cache, mode):
    library.start()
    (kept,) = cache.iterdir()
    kept.unlink()
    kept.write_text("#!/bin/sh\nexit 127\n")
    kept.chmod(mode)
    assert run(library.start(), "echo").trials == 7


def test_drivers_compiled_at_the_same_time_do_not_meet(library, cache):
    outcomes = []
    threads = [
        threading.Thread(target=lambda: outcomes.append(run(library.start(), "echo").trials))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert outcomes == [7, 7]
    assert len(list(cache.iterdir())) == 1


def test_a_driver_that_does_not_compile_says_why_and_leaves_nothing(library, cache):
    library.source.write_text(DRIVER.replace("request.rows", "request.no_such_member"))
    with pytest.raises(native.Unusable, match=r"does not compile: .*no_such_member"):
        library.start()
    assert list(cache.iterdir()) == []


def test_without_a_compiler_it_says_what_to_install(library, monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler -O2")
    with pytest.raises(native.Unusable, match=r"Invented is there.* install a C\+\+ compiler"):
        library.start()


def test_a_missing_header_is_named_by_its_package(library):
    needy = native.Library(
        library.title,
        library.source,
        library.header,
        needs=(native.Header("no/such.hpp", "libneeded-dev"),),
    )
    with pytest.raises(native.Unusable, match=r"install libneeded-dev$"):
        needy.start()


def test_a_cache_that_cannot_be_written_to_is_named(library, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(native.Unusable, match="set XDG_CACHE_HOME"):
        library.start()


def test_nothing_is_run_or_compiled_where_the_library_is_absent(monkeypatch, tmp_path, cache):
    """A machine without these packages is asked with a few file names only."""
    monkeypatch.setattr(native, "_include_directories", lambda: [tmp_path])
    monkeypatch.setattr(native.subprocess, "run", None)
    monkeypatch.setattr(native.subprocess, "Popen", None)
    started = time.perf_counter()
    assert not native.Library("X", Path("x.cpp"), native.Header("x.hpp", "libx-dev")).installed()
    assert time.perf_counter() - started < 1
    assert not cache.exists()


def test_a_driver_ends_with_its_worker(library, tmp_path):
    """Closing the worker closes the driver's standard input."""
    driver = library.start()
    process = driver._process
    process.stdin.close()
    assert process.wait(10) == 0


def test_without_a_compiler_every_entry_point_is_named_and_not_measured(monkeypatch, cache):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with WorkerHost(probe_files()["opengv"], sys.executable, 60) as host:
        answer = host.ask("describe")
    if answer["installed"]:
        driven = [one for one in answer["entry_points"] if one["name"].startswith("Ransac<")]
        assert len(driven) >= 11
        assert all("install a C++ compiler" in one["unmeasured"] for one in driven)
    assert not cache.exists()
