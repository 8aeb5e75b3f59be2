"""Whose files are whose: a run takes no folder of somebody else's, and in its own replaces only what it wrote."""

import json
import os
import re
import shutil
import threading
from dataclasses import replace

import pytest
import toy_problem
from commands import invoke
from ledger_edit import forged
from suites import few
from toy_problem import toy_run, toy_task

from topo_search import compose
from topo_search.model import BadInput, Design
from topo_search.model.files import to_json, to_toml, write_atomically
from topo_search.study import LedgerLost, RunFolder, answer_of
from topo_search.study.directory import Directory, RunFile

MINE = {"designs/mine.json": "mine", "audits/x.json": "x", "report.html": "page"}


def put(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def texts(folder):
    """Every regular file but ledger and lock, with its content."""
    files = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    own = ("ledger.sqlite", ".lock")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files if not path.name.startswith(own)}


@pytest.mark.parametrize("name", [*MINE, "notes.txt", "task.toml", ".hidden", "designs/deep/er.txt", "best.json"])
def test_a_folder_with_anything_in_it_is_refused_untouched(tmp_path, name):
    put(tmp_path, {name: "mine"})
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(BadInput, match=r"left unchanged; choose another folder with --out"):
        toy_run(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / name).read_text() == "mine"


def test_a_folder_that_a_killed_run_had_only_begun_is_taken_up(tmp_path):
    put(tmp_path, {".lock": "123 on host\n", RunFile.PARTIAL: "half a ledg"})
    assert toy_run(tmp_path).exit_status == 0
    assert not (tmp_path / RunFile.PARTIAL).exists()


def test_the_lock_of_another_program_is_left_alone(tmp_path):
    put(tmp_path, {".lock": "my precious"})
    with pytest.raises(BadInput, match="is not the lock file of a run, and is left unchanged"):
        toy_run(tmp_path)
    assert (tmp_path / ".lock").read_text() == "my precious"


@pytest.mark.parametrize("name", [".lock", "ledger.sqlite-wal", "ledger.sqlite-shm"])
def test_a_file_with_a_second_name_elsewhere_is_not_written_through(tmp_path, name):
    toy_run(tmp_path / "run")
    text = "123 on host\n" if name == ".lock" else "mine"
    put(tmp_path, {"elsewhere": text})
    (tmp_path / "run" / name).unlink(missing_ok=True)
    os.link(tmp_path / "elsewhere", tmp_path / "run" / name)
    with pytest.raises(BadInput):
        toy_run(tmp_path / "run", starts=5)
    assert (tmp_path / "elsewhere").read_text() == text


@pytest.mark.parametrize("mask", [0o077, 0o022, 0o002])
def test_the_umask_decides_who_may_read_what_a_run_writes(tmp_path, mask):
    before = os.umask(mask)
    try:
        toy_run(tmp_path / "run")
        write_atomically(tmp_path / "page.html", "page")
    finally:
        os.umask(before)
    for path in (tmp_path / "run" / "candidates.csv", tmp_path / "page.html"):
        assert path.stat().st_mode & 0o777 == 0o666 & ~mask


def test_notes_of_the_user_survive_in_a_run_s_folder(tmp_path):
    toy_run(tmp_path)
    notes = {"notes.txt": "mine", "designs/mine.json": "mine", "audits/mine.json": "mine", "own/page.html": "x"}
    put(tmp_path, notes)
    toy_run(tmp_path, starts=5)
    for name, text in notes.items():
        assert (tmp_path / name).read_text() == text


@pytest.mark.parametrize("name", ["best.json", "candidates.csv", "task.toml", "report.html", "best-n3.json"])
def test_what_the_user_changed_is_in_the_way_and_left_as_it_is(tmp_path, name):
    toy_run(tmp_path)
    put(tmp_path, {name: "changed by hand"})
    before = texts(tmp_path)
    with pytest.raises(BadInput, match=rf"{name}: is not the file that this run wrote, .*move it away"):
        toy_run(tmp_path, starts=5)
    assert texts(tmp_path) == before
    (tmp_path / name).unlink()
    assert toy_run(tmp_path, starts=5).exit_status == 0


def test_a_design_that_the_user_changed_is_named_and_all_others_are_written(tmp_path):
    key = toy_run(tmp_path).best.key
    put(tmp_path, {f"designs/{key}.json": "changed by hand"})
    shutil.rmtree(tmp_path / "audits")
    with pytest.raises(BadInput, match=rf"designs/{key}\.json: is not the file that this run wrote"):
        toy_run(tmp_path)
    assert (tmp_path / f"designs/{key}.json").read_text() == "changed by hand"
    (tmp_path / f"designs/{key}.json").unlink()
    assert toy_run(tmp_path).best.key == key


def test_designs_that_are_no_more_are_removed_unless_the_user_changed_them(tmp_path, monkeypatch):
    answer = toy_run(tmp_path)
    first, second = (row.key for row in answer.sizes[0].top[:2])
    put(tmp_path, {f"designs/{first}.json": "changed by hand"})
    for key in (first, second):
        forged(
            tmp_path,
            ("UPDATE candidates SET status = 'failed', objective = NULL, audit = NULL WHERE key = ?", (key,)),
        )
    toy_run(tmp_path)
    assert (tmp_path / f"designs/{first}.json").read_text() == "changed by hand"
    assert not (tmp_path / f"designs/{second}.json").exists()


def test_an_empty_file_that_a_power_cut_left_is_written_again(tmp_path):
    key = toy_run(tmp_path).best.key
    (tmp_path / f"designs/{key}.json").write_text("")
    toy_run(tmp_path)
    assert (tmp_path / f"designs/{key}.json").stat().st_size


def test_what_a_killed_run_left_half_written_is_removed_and_nothing_else(tmp_path):
    toy_run(tmp_path)
    put(tmp_path, {RunFile.PARTIAL: "half", ".best.json.mine": "mine"})
    toy_run(tmp_path)
    assert not (tmp_path / RunFile.PARTIAL).exists()
    assert (tmp_path / ".best.json.mine").read_text() == "mine"


@pytest.mark.parametrize("harm", ["emptied", "gone"])
def test_results_without_their_ledger_are_damage_and_left_alone(tmp_path, harm):
    toy_run(tmp_path)
    before = texts(tmp_path)
    if harm == "gone":
        (tmp_path / "ledger.sqlite").unlink()
    else:
        (tmp_path / "ledger.sqlite").write_bytes(b"")
    for use in (toy_run, lambda path: RunFolder.load(path).__enter__()):
        with pytest.raises(BadInput, match=r"no ledger\.sqlite|is damaged \(it is empty\)"):
            use(tmp_path)
    assert texts(tmp_path) == before


VANISH = {
    "folder": shutil.rmtree,
    "moved": lambda folder: folder.rename(folder.with_name("moved")),
    "ledger": lambda folder: (folder / "ledger.sqlite").unlink(),
    "all of the ledger": lambda folder: [path.unlink() for path in folder.glob("ledger.sqlite*")],
    "log": lambda folder: (folder / "ledger.sqlite-wal").unlink(),
    "replaced": lambda folder: (
        shutil.copy(folder / "ledger.sqlite", folder / "x") and (folder / "x").replace(folder / "ledger.sqlite")
    ),
}


@pytest.mark.parametrize("harm", VANISH)
@pytest.mark.parametrize(("at", "during"), few([(2, "solve"), (3, "audit"), (9, "solve")], 2))
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_folder_that_vanishes_ends_the_run_with_what_it_had_found(
    tmp_path, monkeypatch, harm, at, during, options
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "toy.toml").write_text(to_toml(toy_task(4)))
    calls, folder = [], tmp_path / "run"

    def vanishing(function):
        def call(*args, **options):
            calls.append(args)
            if len(calls) == at:
                VANISH[harm](folder)
            return function(*args, **options)

        return call

    backends = replace(toy_problem.BACKENDS, **{during: vanishing(getattr(toy_problem, during))})
    monkeypatch.setattr(compose.binding, "BACKENDS", backends)
    monkeypatch.setattr(compose.binding, "Workers", toy_problem.InProcess)
    result = invoke("run", "toy.toml", "--symmetry", "c2", "--out", "run", *options, status=74)
    assert re.search(r"ledger\.sqlite: was removed, moved, replaced or emptied", result.stderr)
    assert "everything is in" not in result.output
    assert "results are kept" not in result.output
    assert len(calls) == at
    printed = result.stdout[result.stdout.index("{\n") :]
    found = json.loads(printed)
    design = Design.model_validate(found["design"] if options else found)
    if options:
        assert found["exit_status"] == 74
        assert (found["best"] or found["sizes"][0]["top"][0])["key"] == design.topology.key
    elif during == "solve":
        assert f"{at} of" in result.stdout  # the solve during which it vanished counts too
        assert "not audited" in result.stdout
    else:
        assert f"best design: {design.topology.key}" in result.stdout


def test_a_folder_that_vanishes_during_audits_ends_with_the_best_design(tmp_path):
    audited = []

    def audit(design):
        audited.append(design.topology.key)
        if len(audited) == 3:
            shutil.rmtree(tmp_path / "run")
        return toy_problem.audit(design)

    backends = toy_problem.Backends(toy_problem.solve, audit, *list(vars(toy_problem.BACKENDS).values())[2:])
    with pytest.raises(LedgerLost) as caught:
        toy_run(tmp_path / "run", backends=backends)
    assert caught.value.answer.best.key == toy_run(tmp_path / "whole").best.key
    assert to_json(caught.value.design) == (tmp_path / "whole/best.json").read_text()


def test_ctrl_c_before_anything_was_begun_promises_nothing(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(compose, "search", interrupted)
    assert invoke("run", "push", "--out", tmp_path / "run", status=130).stderr.splitlines()[-1] == "stopped"


@pytest.mark.parametrize(
    "name",
    ["designs", "audits", "task.toml", "best.json", "candidates.csv", "ledger.sqlite", ".lock", RunFile.PARTIAL],
)
def test_no_symbolic_link_is_followed(tmp_path, name):
    run, outside = tmp_path / "run", tmp_path / "outside"
    toy_run(run)
    outside.mkdir()
    (outside / "file").write_text("theirs")
    path = run / name
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    target = outside if name in ("designs", "audits") else outside / "file"
    if name == "ledger.sqlite":
        toy_run(outside / "other")
        target = outside / "other" / name
    path.symlink_to(target)
    before = {each: each.read_bytes() for each in outside.rglob("*") if each.is_file()}
    if name == RunFile.PARTIAL:  # ours to remove, the link itself
        assert toy_run(run, starts=5).exit_status == 0
        assert not path.is_symlink()
    else:
        with pytest.raises(BadInput, match=r"symbolic link|not the lock file"):
            toy_run(run, starts=5)
        assert path.is_symlink()
    assert {each: each.read_bytes() for each in outside.rglob("*") if each.is_file()} == before


@pytest.mark.parametrize("name", ["task.toml", "best.json", "ledger.sqlite", "ledger.sqlite-wal", ".lock"])
def test_a_pipe_in_a_file_s_place_is_refused_at_once(tmp_path, name):
    toy_run(tmp_path)
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    refused = []

    def use():
        try:
            toy_run(tmp_path)
        except BadInput as error:
            refused.append(error)

    thread = threading.Thread(target=use, daemon=True)
    thread.start()
    thread.join(10)
    assert refused


def test_a_journal_of_sqlite_s_own_is_not_played_back(tmp_path):
    toy_run(tmp_path)
    put(tmp_path, {"ledger.sqlite-journal": "\xd9\xd5\x05\xf9"})
    with pytest.raises(BadInput, match=r"ledger\.sqlite-journal: is not from this program"):
        toy_run(tmp_path)


@pytest.mark.parametrize("key", ["../../evil", "a/../../b", "/etc/x", "a12\n", "b500", "a500.", ""])
def test_the_key_of_a_crafted_ledger_names_no_file(tmp_path, key):
    run = tmp_path / "deep" / "run"
    best = toy_run(run).best.key
    for table in ("candidates", "texts", "solves"):
        forged(run, (f"UPDATE {table} SET key = ? WHERE key = ?", (key, best)))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(BadInput, match=r"is damaged .its table candidates has the key"):
        toy_run(run)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", ["../evil", "designs/../../evil", "/evil", ""])
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    (tmp_path / "run").mkdir()
    with Directory.open(tmp_path / "run") as directory:
        for use in (directory.read, directory.remove, lambda name: directory.write(name, b"x")):
            with pytest.raises(ValueError, match="within the folder"):
                use(name)


def test_names_of_files_in_a_crafted_ledger_remove_nothing_outside(tmp_path):
    run = tmp_path / "run"
    toy_run(run)
    (tmp_path / "theirs.json").write_text("")
    row = ("designs/../../theirs.json", None, None, 1)
    from topo_search.study.ledger_file import checksum

    forged(run, ("INSERT INTO files VALUES (?, ?, ?, ?, ?)", (*row, checksum(row))))
    with pytest.raises(BadInput, match="is damaged"):
        toy_run(run)
    assert (tmp_path / "theirs.json").exists()


@pytest.mark.parametrize(
    "made", ["TRIGGER t AFTER UPDATE ON run BEGIN DELETE FROM solves; END", "VIEW v AS SELECT 1"]
)
def test_what_runs_within_a_crafted_ledger_is_refused(tmp_path, made):
    toy_run(tmp_path)
    forged(tmp_path, f"CREATE {made}")
    with pytest.raises(BadInput, match="is not as this program creates it"):
        toy_run(tmp_path)


def test_a_task_in_a_run_s_folder_opens_no_other_file(tmp_path):
    toy_run(tmp_path)
    (tmp_path / "cube.stl").write_text("solid")
    text = (tmp_path / "task.toml").read_text()
    (tmp_path / "task.toml").write_text(text.replace("[module.body]", '[module.body]\nmesh = "cube.stl"'))
    with pytest.raises(BadInput, match=r"task\.toml: module\.body\.mesh: "), RunFolder.load(tmp_path):
        pass


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        (b"[" * 60_000, "must have at most 50,000 lists, but has 60,000"),
        (b"#" * 1_100_000, "must have at most 1,048,576 bytes, but has 1,100,000"),
        (b"name = '\xff'", "must be UTF-8 text, but got the byte 0xff at offset 8"),
    ],
)
def test_a_task_in_a_run_s_folder_is_within_the_limits_of_tasks(tmp_path, text, rule):
    toy_run(tmp_path)
    (tmp_path / "task.toml").write_bytes(text)
    with pytest.raises(BadInput, match=rf"task\.toml: {rule}"), RunFolder.load(tmp_path):
        pass
    assert (tmp_path / "task.toml").read_bytes() == text


FALSE = {
    "under its bound": ("objective = 0.87 * lower_bound", "under the bound of"),
    "another objective": ("objective = objective * (1 + 1e-9)", "objective is not that of its design"),
    "another gap": ("gap = gap / 2", "gap is not that of its design"),
    "another margin": ("margin = 1.0", "margin is not"),
    "another orbit": ("orbit = orbit + 1", "symmetric cop"),
    "no design": ("result_checksum = NULL", "its design is missing"),
    "another verdict": ("audit = 'violated'", "audit is not that of its design"),
    "no audit": ("audit_checksum = NULL", "audit is not that of its design"),
    "another status": ("status = 'proven'", "is 'proven'"),
    "infinite": ("objective = 9e999", r"under the bound|is not that of its design"),
}


@pytest.mark.parametrize("lie", FALSE)
def test_an_answer_that_contradicts_itself_is_not_given(tmp_path, lie):
    key = toy_run(tmp_path).best.key
    change, named = FALSE[lie]
    forged(tmp_path, (f"UPDATE candidates SET {change} WHERE key = ?", (key,)))
    with pytest.raises(BadInput, match=named), RunFolder.load(tmp_path) as folder:
        answer_of(folder)


def test_candidates_that_do_not_stand_for_all_trees_are_damage(tmp_path):
    toy_run(tmp_path, modules=4, symmetry="d4")
    forged(tmp_path, "UPDATE candidates SET orbit = 1 WHERE orbit = 2")
    with pytest.raises(BadInput, match="represent 11 trees, but there are 14"), RunFolder.load(tmp_path) as folder:
        answer_of(folder)


def test_a_page_is_not_put_in_the_place_of_the_user_s(tmp_path, monkeypatch):
    toy_run(tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    invoke("report", "run")
    invoke("report", "run")
    put(tmp_path / "run", {"report.html": "mine"})
    assert "report.html: is not the file that this run wrote" in invoke("report", "run", status=2).stderr
    assert (tmp_path / "run/report.html").read_text() == "mine"
    invoke("report", "run", "--out", "run/page.html")
    (tmp_path / "run/report.html").unlink()
    toy_run(tmp_path / "run", starts=3)
    assert (tmp_path / "run/page.html").exists()
