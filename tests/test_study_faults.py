"""Faults injected into a run: solves that crash or hang, coordinators that are killed, a disk that is full."""

import csv
import errno
import hashlib
import os
import platform
import random
import re
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from contextlib import closing, contextmanager
from pathlib import Path

import failing_disk
import pytest
from dask_cluster import Cluster
from processes import HERE, Coordinator, eventually, processes_with, ranking, recorded
from suites import few
from toy_problem import COMMAND, InProcess, solved_keys, toy_run, toy_task

from topo_search.model import BadInput
from topo_search.model.files import to_toml
from topo_search.study import COLUMNS, Request, RunFolder, answer_of
from topo_search.study.directory import RunFile

SHARE = 0.02
"""Of the candidates that crash, and of those that hang."""
WORKERS = 2


def keys_of(modules):
    """All candidates, in an order that has nothing to do with that of the search."""
    space = Request(toy_task(modules), "c2", 2, 0).space(modules)
    return sorted((c.key for c in space.candidates()), key=lambda key: hashlib.sha256(key.encode()).digest())


@contextmanager
def faulty(tmp_path, modules, *options):
    """A coordinator some of whose candidates crash, and some of which hang; with their keys."""
    keys = keys_of(modules)
    number = max(1, round(SHARE * len(keys)))
    crash, hang = keys[:number], keys[number : 2 * number]
    environment = {"TOY_SEGFAULT": ",".join(crash), "TOY_HANG": ",".join(hang), "TOY_SLEEP": "0.02"}
    coordinator = Coordinator(tmp_path, "--modules", str(modules), *options, **environment)
    try:
        yield coordinator, set(crash), set(hang)
    finally:
        for pid in processes_with(str(coordinator.log)):
            os.kill(pid, signal.SIGKILL)
        coordinator.process.communicate()


def kill_at(coordinator, rows, again):
    """Start the coordinator and kill it after so many rows; of those recorded, only `again` may be solved again."""
    known, logged = set(recorded(coordinator.folder)) - again, len(solved_keys(coordinator.log))
    coordinator.start()
    coordinator.wait_for(rows)
    os.kill(coordinator.process.pid, signal.SIGKILL)
    coordinator.finish()
    assert not known & set(solved_keys(coordinator.log)[logged:])


def check(coordinator, tmp_path, modules, crash, hang):
    """Every candidate ended once, those that failed once a call, with the reason, all others as if nothing was."""
    with closing(sqlite3.connect(coordinator.folder / "ledger.sqlite")) as database:
        ends = dict(database.execute("SELECT key, count(*) FROM solves GROUP BY key"))
        failed = dict(database.execute("SELECT key, worst_constraint FROM candidates WHERE status = 'failed'"))
    assert set(ends) == set(keys_of(modules))
    assert {key for key, count in ends.items() if count > 1} <= crash | hang
    assert set(failed) == crash | hang
    assert all("SIGSEGV" in failed[key] for key in crash)
    assert all("still running at its deadline" in failed[key] for key in hang)
    toy_run(tmp_path / "whole", modules=modules)
    assert found(coordinator.folder, failed) == found(tmp_path / "whole", failed)


def found(folder, failed):
    """The ranking without the candidates that failed, and without audits: others are audited in their stead."""
    with (folder / "candidates.csv").open(newline="") as stream:
        names = [name for name in COLUMNS if name not in ("seconds", "audit")]
        return [[row[name] for name in names] for row in csv.DictReader(stream) if row["key"] not in failed]


@pytest.mark.parametrize("modules", [5, pytest.param(7, marks=pytest.mark.slow)])
def test_every_candidate_ends_exactly_once(tmp_path, modules):
    with faulty(tmp_path, modules, "--deadline", "4") as (coordinator, crash, hang):
        count = len(keys_of(modules))
        for quarter in (1, 2, 3):
            kill_at(coordinator, quarter * count // 4, crash | hang)
            eventually(lambda: processes_with(str(coordinator.log)) == [])
        coordinator.start()
        assert coordinator.finish()[0] == 0
        begun = Counter(solved_keys(coordinator.log))
        again = sum(begun[key] - 1 for key in keys_of(modules) if key not in crash | hang)
        assert again <= 3 * WORKERS  # what was running when a coordinator was killed
        check(coordinator, tmp_path, modules, crash, hang)


@pytest.mark.slow
def test_every_candidate_ends_exactly_once_on_a_cluster_that_loses_workers_too(tmp_path):
    modules = 5
    with (
        faulty(tmp_path, modules) as (coordinator, crash, hang),
        Cluster(tmp_path, **coordinator.environment) as cluster,
    ):
        coordinator.options += ("--dask", cluster.address, "--deadline", "20")
        cluster.add_worker()
        count = len(keys_of(modules))
        for quarter in (1, 2, 3):
            kill_at(coordinator, quarter * count // 4, crash | hang)
            os.killpg(cluster.workers[-1].pid, signal.SIGKILL)
            cluster.add_worker()
        coordinator.start()
        assert coordinator.finish()[0] == 0
        check(coordinator, tmp_path, modules, crash, hang)


def test_a_disk_that_fills_up_ends_the_command_with_nothing_lost(tmp_path):
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(4)))
    log = tmp_path / "log"
    environment = {**os.environ, "PYTHONPATH": str(HERE), "TOY_LOG": str(log)}

    def run(room):
        """Run the command with a disk on which no file can get larger than this."""
        return subprocess.run(
            [sys.executable, "-c", COMMAND, "run", "toy.toml", "--symmetry", "c2", "--out", "run"],
            cwd=tmp_path,
            env=environment,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
            capture_output=True,
            text=True,
        )

    full = run(130_000)
    assert full.returncode == 74, full.stderr
    assert "cannot write the ledger: " in full.stderr
    assert "the same command" in full.stderr
    kept = recorded(tmp_path / "run")
    assert 0 < len(kept) < len(keys_of(4))
    log.write_text("")
    assert run(resource.RLIM_INFINITY).returncode == 0
    assert not set(kept) & set(solved_keys(log))
    assert set(recorded(tmp_path / "run")) == set(keys_of(4))


# ---- Campaigns of faults against a small run: whatever happens, nothing is lost, false, endless, or a traceback.
# The fast part of each is an ordinary test; the rest is marked `slow`, and prints its counts (`pytest -m slow
# -s`).

RAN, ENDED, ODD = 0, 3, 99
"""Exit statuses of a child: it came to its end, it said why not, or something happened that nobody reckons with."""


def in_child(use, *, seconds=60):
    """Return the exit status of a function in a child process, which must end in time."""
    pid = os.fork()
    if pid == 0:
        status = ODD
        try:
            use()
            status = RAN
        except (OSError, sqlite3.OperationalError):
            status = ENDED
        except BadInput as error:  # the folder cannot be made, nor written to
            status = ENDED if any(os.strerror(code) in str(error) for code in (errno.ENOSPC, errno.EIO)) else ODD
            sys.stderr.write(f"{error}\n")
        except BaseException as error:  # noqa: BLE001 (whatever it is, the parent must hear of it)
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
        finally:
            os._exit(status)
    end = time.monotonic() + seconds
    while (ended := os.waitpid(pid, os.WNOHANG))[0] == 0:
        if time.monotonic() > end:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            pytest.fail(f"it did not end within {seconds} s")
        time.sleep(0.001)
    return os.waitstatus_to_exitcode(ended[1])


def listing(folder):
    """All files but what SQLite keeps beside its own."""
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    return {name for name in found if not name.endswith(("-wal", "-shm"))}


def writes_of(folder, modules):
    """Return how many writes a run takes."""
    count = folder.with_name("count")

    def use():
        disk = failing_disk.Disk(0, failing_disk.full)
        toy_run(folder, modules=modules)
        count.write_text(str(disk.count))

    assert in_child(use) == RAN
    return int(count.read_text())


def check_every_write(tmp_path, monkeypatch, act, *, modules, once=False, step=1):
    """Fail at every write of a run in turn, take it up again, and return how the runs ended."""
    log = tmp_path / "log"
    monkeypatch.setenv("TOY_LOG", str(log))
    log.touch()
    writes, whole = writes_of(tmp_path / "whole", modules), tmp_path / "whole"
    keys = solved_keys(log)
    ends = Counter()
    for at in range(1, writes + 1, step):
        run = tmp_path / f"run{at}"
        log.write_text("")

        def use(at=at, run=run):
            failing_disk.Disk(at, act, once=once)
            toy_run(run, modules=modules)

        status = in_child(use)
        assert status in ((9,) if act is failing_disk.dies else (RAN, ENDED)), (at, status)
        ends["complete" if status == RAN else "ended with a reason" if status == ENDED else "killed"] += 1
        answer = toy_run(run, modules=modules)
        assert answer.complete, at
        assert len(solved_keys(log)) <= len(keys) + 1, at  # at most the solve whose result could not be written
        assert ranking(run) == ranking(whole), at
        assert (run / "best.json").read_bytes() == (whole / "best.json").read_bytes(), at
        assert listing(run) == listing(whole), at
        shutil.rmtree(run)
    return ends


ACTS = {
    "full": (failing_disk.full, False),
    "fails once": (failing_disk.broken, True),
    "dies": (failing_disk.dies, False),
}


@pytest.mark.parametrize("act", ACTS)
def test_a_fault_at_every_write_of_a_small_run(tmp_path, monkeypatch, act):
    what, once = ACTS[act]
    assert check_every_write(tmp_path, monkeypatch, what, modules=1, once=once, step=16).total() > 2


@pytest.mark.slow
@pytest.mark.parametrize("act", ACTS)
def test_a_fault_at_every_write_of_a_run(tmp_path, monkeypatch, act):
    what, once = ACTS[act]
    ends = check_every_write(tmp_path, monkeypatch, what, modules=3, once=once)
    print(f"\n{act}: {ends.total()} writes: {dict(ends)}")


def harmed(content, generator):
    """Return a file with one bit flipped, or cut off somewhere."""
    if generator.random() < 0.1:
        return content[: generator.randrange(len(content))]
    place, bit = generator.randrange(len(content)), generator.randrange(8)
    return content[:place] + bytes([content[place] ^ 1 << bit]) + content[place + 1 :]


def damage(tmp_path, number, seed):
    """Damage a finished run's ledger, and count the outcomes: the same answer, or named damage."""
    run = tmp_path / "run"
    expected = toy_run(run, engine=InProcess(1))
    ledger, files = run / "ledger.sqlite", listing(run)
    content, best = ledger.read_bytes(), (run / "best.json").read_bytes()
    generator, ends = random.Random(seed), Counter()
    for turn in range(number):
        ledger.write_bytes(harmed(content, generator))
        began = time.monotonic()
        use = "run" if turn % 4 == 0 else "read"
        try:
            if use == "run":
                answer = toy_run(run, engine=InProcess(1))
            else:
                with RunFolder.load(run) as folder:
                    answer = answer_of(folder)
        except BadInput as error:
            named, answer = str(error), expected
        else:
            named = ""
        assert ("ledger.sqlite" in named) == bool(named), (turn, named)
        assert answer == expected, turn
        ends[f"{use}: {'named' if named else 'same answer'}"] += 1
        assert time.monotonic() - began < 10, turn
        assert (run / "best.json").read_bytes() == best, turn
        assert listing(run) == files, turn
        for beside in run.glob("ledger.sqlite-*"):
            beside.unlink()
    return ends


def test_a_flipped_bit_or_a_lost_end_is_named_or_harmless(tmp_path):
    ends = damage(tmp_path, 30, seed=1)
    assert sum(number for end, number in ends.items() if "named" in end) > 6


@pytest.mark.slow
def test_ten_thousand_flipped_bits_and_lost_ends(tmp_path):
    print(f"\n{dict(damage(tmp_path, 10_000, seed=2))}")


def test_a_ledger_of_which_an_end_is_lost_at_every_page(tmp_path):
    toy_run(tmp_path / "run")
    ledger = tmp_path / "run" / "ledger.sqlite"
    content = ledger.read_bytes()
    for size in range(0, len(content), 4096):
        ledger.write_bytes(content[:size])
        with pytest.raises(BadInput, match=r"ledger\.sqlite: is damaged"):
            toy_run(tmp_path / "run")


REPORT = "from topo_search.compose import write_report\nimport sys\nwrite_report(sys.argv[1])"


def ended(coordinator):
    """True if a coordinator has ended."""
    return coordinator.process.poll() is not None


def is_worker(pid):
    """Neither the coordinator nor Python's own resource tracker, which prints a traceback where it was killed."""
    try:
        return b"--multiprocessing-fork" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return False


def kill_campaign(tmp_path, kills, seed):
    """Kill coordinators, workers and reports at random moments; return how many of each."""
    generator, counts = random.Random(seed), Counter()
    toy_run(tmp_path / "whole", modules=4)
    number = len(ranking(tmp_path / "whole"))
    coordinator = Coordinator(tmp_path, "--modules", "4", TOY_SLEEP="0.1")
    while counts.total() < kills:
        known, logged = set(recorded(coordinator.folder)), len(solved_keys(coordinator.log))
        if known and generator.random() < 0.2:
            report = subprocess.Popen(
                [sys.executable, "-c", REPORT, str(coordinator.folder)],
                env=coordinator.environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            time.sleep(generator.uniform(0.0, 4.0))
            report.kill()
            report.wait()
            counts["report"] += 1
            continue
        coordinator.start()
        if generator.random() < 0.3:  # while it starts
            time.sleep(generator.uniform(0.1, 3.0))
        else:  # while it solves, audits, and writes its files
            fresh = min(len(known) + 1, number)
            eventually(lambda fresh=fresh: len(recorded(coordinator.folder)) >= fresh or ended(coordinator))
            time.sleep(generator.choice([0.0, 0.1, 0.5, 2.0]) * generator.random())
        worker = generator.random() < 0.3
        alive = [pid for pid in processes_with(str(coordinator.log)) if is_worker(pid)]
        if worker and alive:
            with_pid = generator.choice(alive)
            try:
                os.kill(with_pid, signal.SIGKILL)
                counts["worker"] += 1
            except ProcessLookupError:
                pass
            time.sleep(generator.uniform(0.0, 0.5))
        coordinator.process.kill()
        _, err = coordinator.process.communicate(timeout=60)
        counts["run" if not known else "resume"] += 1
        assert b"Traceback" not in err, err.decode()
        eventually(lambda: not processes_with(str(coordinator.log)), 10)
        assert not known & set(solved_keys(coordinator.log)[logged:])  # nothing is lost
        assert known <= set(recorded(coordinator.folder))
        if len(known) == number and coordinator.process.returncode == 0:  # it was over: begin anew
            shutil.rmtree(coordinator.folder)
            coordinator.log.write_text("")
            counts["complete runs"] += 1
    coordinator.start()
    status, _, err = coordinator.finish()
    assert status == 0, err.decode()
    assert ranking(coordinator.folder) == ranking(tmp_path / "whole")
    assert not (coordinator.folder / RunFile.PARTIAL).exists()
    assert not [name for name in listing(coordinator.folder) - listing(tmp_path / "whole") if name != "report.html"]
    return counts


@pytest.mark.slow
def test_a_hundred_kills_at_random_moments(tmp_path):
    print(f"\n{dict(kill_campaign(tmp_path, 110, seed=3))}")


@pytest.mark.parametrize("seed", few(range(3), 1))
def test_clocks_that_jump_change_nothing(tmp_path, monkeypatch, seed):
    generator, real = random.Random(seed), time.time
    toy_run(tmp_path / "whole", modules=4)
    monkeypatch.setattr(time, "time", lambda: real() + generator.choice([-1e9, -3600, 0, 3600, 1e9]))
    first = toy_run(tmp_path / "run", modules=4, time_limit=1e6)
    assert ranking(tmp_path / "run") == ranking(tmp_path / "whole")
    with RunFolder.load(tmp_path / "run") as folder:
        assert answer_of(folder) == first
        logged = list(folder.ledger.solves(4))
    assert sorted({solve.key for solve in logged}) == sorted(row[0] for row in ranking(tmp_path / "run"))


@pytest.mark.parametrize("without", [False, True])
def test_of_two_coordinators_one_works(tmp_path, without):
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(4)))
    coordinator = Coordinator(tmp_path, "--modules", "4", "--workers", "1", TOY_SLEEP="0.1")
    coordinator.start()
    try:
        coordinator.wait_for(2)
        if without:
            (coordinator.folder / ".lock").unlink()
        holder = "" if without else f" (process {coordinator.process.pid} on {platform.node()})"
        for _ in range(2):
            with pytest.raises(BadInput, match=re.escape(f"another run is using this folder{holder}")):
                toy_run(coordinator.folder, modules=4)
        status, _, err = coordinator.finish()
        assert status == 0, err.decode()
    finally:
        coordinator.process.kill()
    toy_run(tmp_path / "whole", modules=4)
    assert ranking(coordinator.folder) == ranking(tmp_path / "whole")
