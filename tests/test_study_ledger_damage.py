"""Ledgers that something else has changed: each is named with what is wrong and what to do, and left as it is."""

import errno
import fcntl
import os
from contextlib import contextmanager

import pytest
from ledger_edit import damaged, forged
from toy_problem import toy_run

from topo_search.model import BadInput
from topo_search.study import RunFolder

LEFT = "; it is left unchanged: choose another folder with --out, or move it away"


@pytest.fixture
def run(tmp_path):
    """The folder of a run that has ended."""
    toy_run(tmp_path / "run")
    return tmp_path / "run"


@contextmanager
def named(run, what):
    """Expect an error that names the file and the damage, and the file as it was."""
    path = run / "ledger.sqlite"
    before = path.read_bytes()
    with pytest.raises(BadInput) as caught:
        yield
    assert str(caught.value) == f"{path}: is damaged ({what}){LEFT}"
    assert path.read_bytes() == before


def read(run):
    with RunFolder.load(run):
        pass


@pytest.mark.parametrize("use", [toy_run, read])
@pytest.mark.parametrize("table", ["run", "contexts", "candidates", "texts", "solves"])
def test_a_table_that_was_dropped(run, use, table):
    damaged(run, f"DROP TABLE {table}")
    with named(run, f"its table {table} is not as this program creates it"):
        use(run)


@pytest.mark.parametrize("use", [toy_run, read])
def test_a_column_that_has_another_name(run, use):
    damaged(run, "ALTER TABLE candidates RENAME COLUMN standing TO stands")
    with named(run, "its table candidates is not as this program creates it"):
        use(run)


@pytest.mark.parametrize("use", [toy_run, read])
@pytest.mark.parametrize(
    ("harm", "what"),
    [
        ("DELETE FROM run", "its table run has 0 rows instead of one"),
        ("INSERT INTO run SELECT * FROM run", "its table run has 2 rows instead of one"),
        ("UPDATE run SET identity = json_remove(identity, '$.seed')", "seed: is required, but missing"),
        (
            "UPDATE run SET identity = json_set(identity, '$.seed', 'soon')",
            'seed: must be a whole number, but got "soon"',
        ),
        (
            "UPDATE run SET identity = json_set(identity, '$.strategy', 'guess')",
            'strategy: must be "exhaustive" or "optuna", but got "guess"',
        ),
        ("UPDATE run SET identity = '[]'", "must be a table of named fields, but got []"),
    ],
)
def test_an_identity_that_is_none(run, use, harm, what):
    forged(run, harm)
    with named(run, what if what.startswith("its") else f"its table run: {what}"):
        use(run)


@pytest.mark.parametrize("use", [toy_run, read])
@pytest.mark.parametrize("text", ["", '{"task": "x" seed', "\x00"])
def test_an_identity_that_is_no_json(run, use, text):
    forged(run, ("UPDATE run SET identity = ?", (text,)))
    with pytest.raises(BadInput, match=r"is damaged \(its table run: Invalid JSON: .*; it is left unchanged"):
        use(run)


@pytest.mark.parametrize("use", [toy_run, read])
def test_an_identity_that_is_no_text(run, use):
    damaged(run, "UPDATE run SET identity = CAST(x'ff00' AS TEXT)")
    with pytest.raises(BadInput, match=r"ledger\.sqlite: is damaged .*identity.* choose another folder with --out"):
        use(run)


def test_what_was_asked_for_last_is_no_number(run):
    forged(run, "UPDATE run SET starts = 'many'")
    for use in (toy_run, read):
        with named(run, "a row of its table run has a value of the wrong type"):
            use(run)


@pytest.mark.parametrize("harm", ["''", "'{'", "'[]'", "'{\"x\": NaN}'", "replace(fixed_by, 'numpy', 'numpi')"])
def test_a_context_that_is_not_what_was_written(run, harm):
    forged(run, f"UPDATE contexts SET fixed_by = {harm}")
    with pytest.raises(BadInput, match=r"is damaged \(its entry for context [0-9a-f]{16} has changed"):
        read(run)


def test_a_proof_that_is_none(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    toy_run(tmp_path)
    forged(tmp_path, "UPDATE contexts SET proof = json_remove(proof, '$.status')")
    with pytest.raises(BadInput, match=r"is damaged \(its table contexts: status: is required, but missing"):
        toy_run(tmp_path)


@pytest.mark.parametrize(
    "begun", ["PRAGMA application_id = 1", "PRAGMA user_version = 1", "CREATE TABLE accounts (owner TEXT)"]
)
def test_a_file_that_another_program_has_begun(tmp_path, begun):
    damaged(tmp_path, begun)
    path = tmp_path / "ledger.sqlite"
    before = path.read_bytes()
    with pytest.raises(BadInput) as caught:
        toy_run(tmp_path)
    assert str(caught.value) == f"{path}: is an SQLite file of another program{LEFT}"
    assert path.read_bytes() == before


def test_a_file_that_is_no_database(tmp_path):
    (tmp_path / "ledger.sqlite").write_text("a ledger is a list of accounts\n" * 100)
    with pytest.raises(
        BadInput, match=r"is damaged or not a ledger .file is not a database.; choose another folder"
    ):
        toy_run(tmp_path)


def test_a_folder_in_place_of_the_file(tmp_path):
    (tmp_path / "ledger.sqlite").mkdir()
    with pytest.raises(BadInput, match=r"ledger\.sqlite: is not a regular file; it is left unchanged"):
        toy_run(tmp_path)


def told(run):
    """What a run says of its ledger, if it refuses it."""
    try:
        toy_run(run)
    except BadInput as error:
        return str(error)
    return None


def test_a_torn_page_is_named_unless_nothing_was_there(run):
    """Every quarter of every page in turn was never written, though its neighbours were."""
    path, others = run / "ledger.sqlite", [run / "candidates.csv", run / "best.json"]
    whole, files = path.read_bytes(), [other.read_text() for other in others]
    texts = []
    for place in range(0, len(whole), 1024):
        path.write_bytes(whole[:place] + bytes(1024) + whole[place + 1024 :])
        texts.append(told(run))
        assert [other.read_text() for other in others] == files
        for log in run.glob("ledger.sqlite-*"):
            log.unlink()
    faults = [text for text in texts if text is not None]
    assert all(text.startswith(f"{path}: is damaged ") for text in faults)
    assert len(faults) >= len(whole) / 4096


@pytest.mark.parametrize("use", [toy_run, read])
@pytest.mark.parametrize("name", ["best.json", "candidates.csv", "designs/"])
def test_the_name_of_a_file_of_the_run_that_changed(run, use, name):
    """A flipped bit that leaves the names in order: the file itself must not be taken for somebody else's."""
    ledger = run / "ledger.sqlite"
    content = ledger.read_bytes()
    place = content.rfind(name.encode()) + len(name) - 2
    ledger.write_bytes(content[:place] + bytes([content[place] ^ 2]) + content[place + 1 :])
    with named(run, "a row of its table files is not what was written"):
        use(run)


# ---- disks without locks, pages, texts


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
    damaged(tmp_path / "run", (f"{harm.format(column)} WHERE key = ?", (row.key,)))
    with RunFolder.load(tmp_path / "run") as folder:
        read = {"result": folder.ledger.result, "audit": folder.ledger.audit}[column]
        with pytest.raises(BadInput, match=rf"is damaged .its entry {row.key} has changed"):
            read(folder.request.contexts(3)[0], row.key)
    with pytest.raises(BadInput, match=row.key):
        toy_run(tmp_path / "run")
