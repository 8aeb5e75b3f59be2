"""Faults injected into a run: solves that crash or hang, coordinators that are killed, a disk that is full."""

import csv
import errno
import fcntl
import hashlib
import os
import platform
import re
import resource
import signal
import sqlite3
import subprocess
import sys
from collections import Counter
from contextlib import closing, contextmanager, nullcontext

import pytest
from ledger_edit import altered
from processes import HERE, Coordinator, eventually, processes_with, ranking, recorded
from toy_problem import COMMAND, solved_keys, toy_run, toy_task

from topo_search.model import BadInput
from topo_search.model.files import to_toml
from topo_search.study import COLUMNS, Request, RunFolder

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


def test_every_candidate_ends_exactly_once(tmp_path):
    modules = 5
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


def test_a_disk_without_shared_memory_maps_keeps_a_journal(tmp_path):
    """As many network disks, where SQLite cannot share the index of its log."""
    run = tmp_path / "run"
    toy_run(run, modules=3, time_limit=0.0)
    (run / "ledger.sqlite-shm").symlink_to("/dev/full")  # which SQLite does not open
    assert toy_run(run, modules=3).complete
    assert (run / "ledger.sqlite-journal").read_bytes() == b""
    toy_run(tmp_path / "whole", modules=3)
    assert ranking(run) == ranking(tmp_path / "whole")


def test_a_disk_that_fills_up_ends_the_command_with_nothing_lost(tmp_path):
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(4)))
    log = tmp_path / "log"
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, "TOY_LOG": str(log)}
    command = f"import nlp; nlp.prepare = lambda *_: None\n{COMMAND}"  # nothing to compile in a toy problem

    def run(room):
        """Run the command with a disk on which no file can get larger than this."""
        return subprocess.run(
            [sys.executable, "-c", command, "run", "toy.toml", "--symmetry", "c2", "--out", "run"],
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


def test_of_two_coordinators_one_works(tmp_path):
    coordinator = Coordinator(tmp_path, "--modules", "4", "--workers", "1", TOY_SLEEP="0.1")
    coordinator.start()
    try:
        coordinator.wait_for(2)
        holder = f" (process {coordinator.process.pid} on {platform.node()})"
        for _ in range(2):
            with pytest.raises(BadInput, match=re.escape(f"another run is using this folder{holder}")):
                toy_run(coordinator.folder, modules=4)
        status, _, err = coordinator.finish()
        assert status == 0, err.decode()
    finally:
        coordinator.process.kill()
    toy_run(tmp_path / "whole", modules=4)
    assert ranking(coordinator.folder) == ranking(tmp_path / "whole")


def test_a_disk_without_locks_is_refused_with_the_reason_and_what_to_do(tmp_path, monkeypatch):
    def none_left(handle, operation):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", none_left)
    with pytest.raises(BadInput, match="No locks available on its disk; choose another folder with --out"):
        toy_run(tmp_path / "run")


# ---- files that are not a ledger, or a damaged one: each is named and left as it is


def test_a_ledger_of_which_an_end_is_lost_at_every_page(tmp_path):
    toy_run(tmp_path / "run")
    ledger = tmp_path / "run" / "ledger.sqlite"
    content = ledger.read_bytes()
    for size in range(0, len(content), 4096):
        ledger.write_bytes(content[:size])
        with pytest.raises(
            BadInput, match=r"ledger\.sqlite: is damaged .* it is left unchanged: choose another folder"
        ):
            toy_run(tmp_path / "run")
        assert ledger.read_bytes() == content[:size]


def of_another_program(path):
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE accounts (owner TEXT)")


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (of_another_program, "is an SQLite file of another program"),
        (lambda path: path.write_text("a ledger is a list of accounts\n" * 100), "file is not a database"),
    ],
)
def test_a_file_that_is_no_ledger(tmp_path, make, what):
    make(path := tmp_path / "ledger.sqlite")
    before = path.read_bytes()
    with pytest.raises(BadInput, match=rf"ledger\.sqlite: .*{what}.*it is left unchanged: choose another folder"):
        toy_run(tmp_path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("column", ["result", "audit"])
@pytest.mark.parametrize(
    "harm", ["DELETE FROM texts", "UPDATE texts SET {0} = CAST(replace({0}, '1', '2') AS BLOB)"]
)
def test_a_text_that_is_not_what_was_written_is_named(tmp_path, column, harm):
    key = toy_run(tmp_path / "run").best.key
    altered(tmp_path / "run", (f"{harm.format(column)} WHERE key = ?", (key,)))
    with RunFolder.load(tmp_path / "run") as folder:
        read = {"result": folder.ledger.result, "audit": folder.ledger.audit}[column]
        with pytest.raises(BadInput, match=rf"is damaged .its entry {key} has changed"):
            read(folder.request.contexts(3)[0], key)
    with pytest.raises(BadInput, match=key):
        toy_run(tmp_path / "run")


def test_versions_that_are_not_what_was_written_are_named(tmp_path):
    toy_run(tmp_path / "run")
    altered(tmp_path / "run", "UPDATE contexts SET fixed_by = replace(fixed_by, 'numpy', 'numpi')")
    with pytest.raises(BadInput, match=r"is damaged \(its entry for context [0-9a-f]{16} has changed"):
        RunFolder.load(tmp_path / "run").__enter__()


def test_an_objective_under_the_bound_is_not_given_as_an_answer(tmp_path):
    key = toy_run(tmp_path / "run").best.key
    for share in (1e-6, 1e-5, 0.1):  # the first is rounding
        change = "UPDATE candidates SET objective = (1 - ?) * lower_bound WHERE key = ?"
        altered(tmp_path / "run", (change, (share, key)))
        with nullcontext() if share == 1e-6 else pytest.raises(BadInput, match="beyond the bound"):
            toy_run(tmp_path / "run")
