import errno
import fcntl
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from processes import eventually, recorded
from toy_problem import toy_run

from topo_search.model import BadInput
from topo_search.study import RunFolder

HERE = Path(__file__).parent


def processes_with(mark):
    """Running processes that were started with a text in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                ended = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
                if not ended and mark.encode() in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except (FileNotFoundError, ProcessLookupError, PermissionError):
                continue
    return found


class Coordinator:
    """A run in a process of its own."""

    def __init__(self, tmp_path, *options, **environment):
        self.options = options or ("--modules", "4")
        self.folder, self.log = tmp_path / "run", tmp_path / "log"
        self.log.touch()
        self.environment = {**os.environ, "TOY_LOG": str(self.log), "PYTHONFAULTHANDLER": "0", **environment}
        paths = [str(HERE), os.environ.get("PYTHONPATH", "")]
        self.environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
        self.process = None

    def start(self):
        command = [sys.executable, str(HERE / "toy_problem.py"), str(self.folder), *self.options]
        self.process = subprocess.Popen(
            command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
        return self.process

    def wait_for(self, rows):
        """Wait until it has recorded so many rows; each has time of its own: other work may slow them."""
        for count in range(len(recorded(self.folder)) + 1, rows + 1):
            eventually(lambda at=count: len(recorded(self.folder)) >= at or self.process.poll() is not None)
        assert self.process.poll() is None, self.process.communicate()

    def finish(self):
        out, err = self.process.communicate(timeout=1800)
        return self.process.returncode, out, err


def test_a_disk_without_locks_is_refused_with_the_reason_and_what_to_do(tmp_path, monkeypatch):
    def none_left(handle, operation):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", none_left)
    with pytest.raises(BadInput, match="No locks available on its disk; choose another folder with --out"):
        toy_run(tmp_path / "run")


def test_a_ledger_that_is_damaged_where_it_is_looked_at_first_is_left_alone(tmp_path):
    toy_run(tmp_path / "run", modules=4)
    path = tmp_path / "run" / "ledger.sqlite"
    content = bytearray(path.read_bytes())
    content[4096 * 3 : 4096 * 3 + 200] = b"\xff" * 200
    path.write_bytes(content)
    with pytest.raises(BadInput, match="is damaged"):
        toy_run(tmp_path / "run", modules=4)
    assert path.read_bytes() == content


@pytest.mark.parametrize("column", ["result", "audit"])
@pytest.mark.parametrize(
    "harm", ["DELETE FROM texts", "UPDATE texts SET {0} = CAST(replace({0}, '1', '2') AS BLOB)"]
)
def test_a_text_that_is_not_what_was_written_is_named(tmp_path, column, harm):
    toy_run(tmp_path / "run")
    with RunFolder.load(tmp_path / "run") as folder:
        row = next(iter(folder.ledger.ranking(3)))
    database = sqlite3.connect(tmp_path / "run" / "ledger.sqlite")
    with database:
        database.execute(f"{harm.format(column)} WHERE key = ?", (row.key,))
    database.close()
    with RunFolder.load(tmp_path / "run") as folder:
        read = {"result": folder.ledger.result, "audit": folder.ledger.audit}[column]
        with pytest.raises(BadInput, match=rf"is damaged .its entry {row.key} has changed"):
            read(folder.request.contexts(3)[0], row.key)
    with pytest.raises(BadInput, match=row.key):
        toy_run(tmp_path / "run")


def test_the_ledger_of_another_program_is_left_alone(tmp_path):
    database = sqlite3.connect(tmp_path / "ledger.sqlite")
    database.execute("CREATE TABLE accounts (owner TEXT)")
    database.commit()
    database.close()
    before = (tmp_path / "ledger.sqlite").read_bytes()
    with pytest.raises(BadInput, match="is an SQLite file of another program"):
        toy_run(tmp_path)
    assert (tmp_path / "ledger.sqlite").read_bytes() == before
