"""Whose files are whose: a run takes no folder of somebody else's, and in its own replaces only what it wrote."""

import json
import os
import re
import shutil
from dataclasses import replace

import pytest
import toy_problem
from commands import invoke
from ledger_edit import altered
from toy_problem import toy_run, toy_task

from topo_search import compose
from topo_search.model import BadInput, Design
from topo_search.model.files import to_toml
from topo_search.study import RunFolder


def put(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def texts(folder):
    """Every file but ledger and lock, with its content."""
    own = ("ledger.sqlite", ".lock")
    files = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(own)]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize("name", ["notes.txt", ".hidden", "designs/mine.json", "best.json"])
def test_a_folder_with_anything_in_it_is_refused_untouched(tmp_path, name):
    put(tmp_path, {name: "mine"})
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(BadInput, match=r"left unchanged; choose another folder with --out"):
        toy_run(tmp_path)
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / name).read_text() == "mine"


def test_a_folder_that_a_killed_run_had_only_begun_is_taken_up(tmp_path):
    put(tmp_path, {".lock": "123 on host\n", ".ledger.sqlite.0a1b2c3d": "half a ledg"})
    assert toy_run(tmp_path).exit_status == 0


def test_the_umask_decides_who_may_read_what_a_run_writes(tmp_path):
    before = os.umask(0o027)
    try:
        toy_run(tmp_path / "run")
    finally:
        os.umask(before)
    assert (tmp_path / "run" / "candidates.csv").stat().st_mode & 0o777 == 0o640


def test_notes_of_the_user_survive_in_a_run_s_folder(tmp_path):
    toy_run(tmp_path)
    notes = {"notes.txt": "mine", "designs/mine.json": "mine", "own/page.html": "x"}
    put(tmp_path, notes)
    toy_run(tmp_path, starts=5)
    for name, text in notes.items():
        assert (tmp_path / name).read_text() == text


@pytest.mark.parametrize("name", ["best.json", "task.toml", "best-n3.json"])
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
    (tmp_path / "candidates.csv").unlink()
    with pytest.raises(BadInput, match=rf"designs/{key}\.json: is not the file that this run wrote"):
        toy_run(tmp_path)
    assert (tmp_path / "candidates.csv").exists()
    assert (tmp_path / f"designs/{key}.json").read_text() == "changed by hand"
    assert (tmp_path / f"audits/{key}.json").exists()
    (tmp_path / f"designs/{key}.json").unlink()
    assert toy_run(tmp_path).best.key == key


def test_an_empty_file_that_a_power_cut_left_is_written_again(tmp_path):
    key = toy_run(tmp_path).best.key
    (tmp_path / f"designs/{key}.json").write_text("")
    toy_run(tmp_path)
    assert (tmp_path / f"designs/{key}.json").stat().st_size


def test_what_a_run_was_killed_before_writing_is_still_its_own(tmp_path, monkeypatch):
    """The ledger has the digest of the new content, the file the old content."""
    toy_run(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr("topo_search.study.directory.write_atomically", lambda *_, **__: None)
        toy_run(tmp_path, starts=5)
    with RunFolder.load(tmp_path) as folder:
        assert folder.changed_files() == []
    toy_run(tmp_path, starts=5)
    toy_run(tmp_path.with_name("whole"), starts=5)
    assert (tmp_path / "best.json").read_bytes() == (tmp_path.with_name("whole") / "best.json").read_bytes()


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
    "log": lambda folder: (folder / "ledger.sqlite-wal").unlink(),
    "replaced": lambda folder: (
        shutil.copy(folder / "ledger.sqlite", folder / "x") and (folder / "x").replace(folder / "ledger.sqlite")
    ),
}


@pytest.mark.parametrize("harm", VANISH)
@pytest.mark.parametrize(("at", "during", "options"), [(2, "solve", ()), (3, "audit", ("--json",))])
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
    assert re.search(r"ledger\.sqlite: was removed, moved or replaced", result.stderr)
    assert "everything is in" not in result.output
    assert "results are kept" not in result.output
    assert len(calls) == at
    found = json.loads(result.stdout[result.stdout.index("{\n") :])
    design = Design.model_validate(found["design"] if options else found)
    if options:
        assert found["exit_status"] == 74
        assert found["best"]["key"] == design.topology.key
    else:
        assert f"{at} of" in result.stdout  # the solve during which it vanished counts too
        assert "not audited" in result.stdout


def test_ctrl_c_before_anything_was_begun_promises_nothing(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(compose, "search", interrupted)
    assert invoke("run", "push", "--out", tmp_path / "run", status=130).stderr.splitlines()[-1] == "stopped"


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


def test_designs_that_are_no_more_are_removed_unless_the_user_changed_them(tmp_path):
    first, second = (row.key for row in toy_run(tmp_path).sizes[0].top[:2])
    put(tmp_path, {f"designs/{first}.json": "changed by hand"})
    for key in (first, second):
        altered(
            tmp_path,
            ("UPDATE candidates SET status = 'failed', objective = NULL, audit = NULL WHERE key = ?", (key,)),
        )
    toy_run(tmp_path)
    assert (tmp_path / f"designs/{first}.json").read_text() == "changed by hand"
    assert not (tmp_path / f"designs/{second}.json").exists()
