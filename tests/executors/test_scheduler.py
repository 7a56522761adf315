"""A Dask scheduler and two workers on the loopback interface: the same answers, and a killed worker loses none."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial

import campaign_folder
import pytest
import resumable
from fleet_tasks import SlowToSend, case, itself, noted, refused, solved, solved_slowly
from paths import ROOT

from twin.errors import InputError
from twin.executors import lost_its_executor
from twin.executors import scheduler as module
from twin.executors.scheduler import scheduler
from twin.fleet import run
from twin.validation import fleet as validation_fleet

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="needs Dask: pip install -e '.[fleet]'"
)


def address_in(file):
    """The address in a scheduler's file; empty until the scheduler has written all of it."""
    try:
        return json.loads(file.read_text())["address"]
    except (FileNotFoundError, json.JSONDecodeError):
        return ""


class Cluster:
    """A scheduler and workers as processes of their own; `address` is that of the scheduler."""

    def __init__(self, folder):
        self._folder, self.processes = folder, []
        self.address = ""

    def start(self, workers):
        """Starts the scheduler and its workers, which find it by its file."""
        self._start("scheduler")
        deadline = time.monotonic() + 60
        while not self.address:
            assert time.monotonic() < deadline
            time.sleep(0.05)
            self.address = address_in(self._folder / "scheduler.json")
        for _ in range(workers):
            self.start_worker()

    def _start(self, what, *options):
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{what}",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
        ]
        path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
        with (self._folder / "log").open("a") as log:
            self.processes.append(
                subprocess.Popen(
                    [*command, "--scheduler-file", "scheduler.json", *options]
                    + (["--port", "0"] if what == "scheduler" else []),
                    cwd=self._folder,
                    env=os.environ | {"PYTHONPATH": path},
                    stdout=log,
                    stderr=log,
                )
            )

    def start_worker(self):
        self._start("worker", "--nthreads", "1", "--no-nanny", "--local-directory", str(self._folder))

    def stop(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        made.start(workers=2)
        yield made
    finally:
        made.stop()


@pytest.fixture
def campaigns(tmp_path):
    found = []
    for name in ("a", "b", "c", "d"):
        folder = tmp_path / "RIGS" / name
        folder.mkdir(parents=True)
        toml = campaign_folder.toml_text().replace('"small"', f'"{name}"')
        found.append(campaign_folder.write(folder, toml))
    return tuple(found)


def answers(fleet):
    """Verdict and effects of each rig, without what depends on the time."""
    return {
        r.rig: (r.answer.verdict, r.answer.effects, r.answer.calibrated, r.answer.provenance.inputs)
        for r in fleet.answers
    }


@needs_dask
def test_answers_are_those_of_processes_of_this_machine(cluster, campaigns, tmp_path):
    with ThreadPoolExecutor(1) as pool:
        here = run.diagnose_fleet(run.Asked(campaigns, tmp_path / "here"), pool, lambda r: None, solved)
    with scheduler(cluster.address) as workers:
        there = run.diagnose_fleet(run.Asked(campaigns, tmp_path / "there"), workers, lambda r: None, solved)
    assert len(answers(here)) == 4
    assert answers(here) == answers(there)


@needs_dask
def test_an_error_on_a_worker_is_that_of_its_rig(cluster, campaigns, tmp_path):
    with scheduler(cluster.address) as workers:
        fleet = run.diagnose_fleet(
            run.Asked(campaigns[:1], tmp_path / "out"), workers, lambda r: None, refused
        )
    assert [f.error for f in fleet.failures] == ["push.csv: nothing moves; expected a motion"]


@needs_dask
def test_a_killed_worker_loses_nothing(cluster, campaigns, tmp_path):
    log = tmp_path / "log"
    cluster.start_worker()  # in the place of the one that is killed

    def kill_the_first():
        while not noted(log):
            time.sleep(0.01)
        os.kill(noted(log)[0][1], getattr(signal, "SIGKILL", signal.SIGTERM))

    threading.Thread(target=kill_the_first).start()
    solve = partial(solved_slowly, log=log, seconds=0.5)
    with scheduler(cluster.address) as workers:
        fleet = run.diagnose_fleet(run.Asked(campaigns, tmp_path / "out"), workers, lambda r: None, solve)
    assert sorted(r.rig for r in fleet.answers) == ["a", "b", "c", "d"]
    assert len(noted(log)) > 4  # the rig of the killed worker was begun again


@needs_dask
@pytest.mark.slow  # a scheduler of its own, and Dask's patience with one that has gone
def test_a_scheduler_that_ends_leaves_the_answers_and_says_so(campaigns, tmp_path):
    folder = tmp_path / "cluster"
    folder.mkdir()
    cluster, log = Cluster(folder), tmp_path / "log"
    try:
        cluster.start(workers=1)
        with (
            scheduler(cluster.address) as workers,
            pytest.raises(InputError, match="has ended; rigs that have"),
        ):
            run.diagnose_fleet(
                run.Asked(campaigns, tmp_path / "out"),
                workers,
                lambda result: cluster.stop(),
                partial(solved_slowly, log=log, seconds=0.2),
            )
    finally:
        cluster.stop()
    assert list((tmp_path / "out").glob("*/diagnosis.json"))


@needs_dask
def test_a_result_on_its_way_from_a_scheduler_that_ends_is_lost(tmp_path):
    cluster = Cluster(tmp_path)
    try:
        cluster.start(workers=1)
        with scheduler(cluster.address) as workers:
            assert workers.submit(len, "ab").result(60) == 2
            sent = workers.submit(SlowToSend, tmp_path / "begun")
            deadline = time.monotonic() + 60
            while not (tmp_path / "begun").exists():
                assert time.monotonic() < deadline
                time.sleep(0.01)
            cluster.stop()
            assert lost_its_executor(sent.exception(60))
            while workers._client.status != "closed":
                assert time.monotonic() < deadline
                time.sleep(0.1)
            assert lost_its_executor(workers.submit(len, "ab").exception(0))
    finally:
        cluster.stop()


@needs_dask
def test_an_error_of_a_task_and_its_cancellation_pass(cluster):
    with scheduler(cluster.address) as workers:
        with pytest.raises(OSError, match="no such"):
            workers.submit(open, "/no such").result(60)
        waiting = [workers.submit(time.sleep, 0.3) for _ in range(8)]
        assert waiting[-1].cancel()
        assert wait(waiting, 60).not_done == set()


@needs_dask
def test_rigs_of_a_validation_run_on_the_workers(cluster, monkeypatch):
    # In the place of their outcomes: the order, and that all come, is what is tested.
    monkeypatch.setattr(validation_fleet, "_evaluate", itself)
    job = validation_fleet.Job("lqi", None, "lq-step-120")
    with scheduler(cluster.address) as workers:
        assert validation_fleet.run_fleet(job, range(23), lambda text: None, workers) == list(range(23))


@needs_dask
def test_cases_of_a_benchmark_run_on_the_workers_and_leave_no_campaign(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(case, "__module__", "__main__")  # as in the script of a benchmark
    options = resumable.parser("", 1).parse_args([str(tmp_path / "work"), "--scheduler", cluster.address])
    found = resumable.answers({"one": 1, "two": 2}, case, options)
    assert [a["number"] for a in found] == [1, 2]
    assert os.getpid() not in {a["process"] for a in found}
    assert os.listdir(tmp_path / "work") == [resumable.FILE]
    assert resumable.answers({"one": 1, "two": 2}, case, options) == found  # from the file


@needs_dask
def test_a_worker_of_another_version_is_refused(cluster, monkeypatch):
    monkeypatch.setattr(module, "version", lambda package: "99.0")
    with (
        pytest.raises(InputError, match=r"has flexlink-twin .*; expected 99.0, which is here"),
        scheduler(cluster.address),
    ):
        pass


@needs_dask
@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("foo bar", "'foo bar' is no address; expected the address that `dask scheduler` prints"),
        ("", "'' is no address"),
        ("tcp://127.0.0.1:1", r"'tcp://127.0.0.1:1' does not answer \(.*\); expected the address"),
    ],
)
def test_a_wrong_address_is_one_message(address, message, monkeypatch):
    monkeypatch.setattr(module, "_CONNECTING", 0.2)
    with pytest.raises(InputError, match=message), scheduler(address):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"pip install -e '\.\[fleet\]'"),
        scheduler("tcp://127.0.0.1:1"),
    ):
        pass
