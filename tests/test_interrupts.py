"""A process that is killed while it writes leaves whole files, and a folder that can be used again."""

import os
import signal
import time

import kill
import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
SIZES = {"report.html": 4_000_000, "run.rrd": 1_000_000, "augmented-rig.toml": 4000, "diagnosis.json": 90_000}


@pytest.fixture
def places(tmp_path):
    """Folders to write to, with old and with new results."""
    for version in (b"old ", b"new "):
        folder = tmp_path / version.decode().strip()
        folder.mkdir()
        for name, size in SIZES.items():
            (folder / name).write_bytes(version * (size // 4))
    return tmp_path / "out", tmp_path / "old", tmp_path / "new"


@pytest.mark.parametrize("number", kill.SIGNALS, ids=lambda s: s.name)
def test_results_are_old_or_new_and_whole_whenever_their_writing_is_killed(number, places):
    for delay in (0.0, 0.003, 0.007, 0.013, 0.021, 0.05):
        trial = kill.writing_trial(*places, number, delay)
        assert trial.good, (delay, trial)


@pytest.mark.slow  # two processes that load the equations of motion
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core runs all rigs in one process")
def test_processes_of_a_validation_end_with_the_one_that_started_them():
    process = kill.start(["-m", "twin.cli", "validate", "lqi", "--rigs", "400"])
    deadline = time.monotonic() + 60
    while kill.session_size(process.pid, wait=0) < 3:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    process.stderr.close()
    assert (
        kill.session_size(process.pid, wait=30) == 0
    )  # those that are still loading begin to watch after that
