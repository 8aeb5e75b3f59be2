import errno
import json
import signal
import sqlite3
from contextlib import closing
from dataclasses import replace
from itertools import pairwise

import pytest
import toy_problem
from commands import invoke, refused
from wording import says

import nlp
from topo_search import compose
from topo_search.model import Assembly, Design, EndEffectorSheet, Infeasible
from topo_search.model.files import read_json
from topo_search.model.search import Search
from topo_search.model.task_file import examples, read_task
from topo_search.topologies import candidates, count, sample

TOY = """
name = "toy"
modules = 3
[[load_cases]]
com = { force = [0.0, 0.0, 1.0] }
[module]
torque_coefficient = 3.1e-9
"""


@pytest.fixture
def command(in_process, tmp_path, monkeypatch):
    """The command line on the toy problem, in this process, in an empty folder with a task file, without pages."""
    monkeypatch.setattr(compose.binding, "BACKENDS", toy_problem.BACKENDS)
    monkeypatch.setattr(compose.searching, "write_page", lambda folder: None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "toy.toml").write_text(TOY)
    return invoke


def files(path):
    return {file.name for file in path.rglob("*")}


def test_run_tells_the_best_and_where_everything_is(command, tmp_path):
    first = command("run", "toy.toml")
    (path,) = (tmp_path / "runs").iterdir()
    assert path.name.startswith("toy-")
    assert first.stdout.splitlines()[-1] == f"everything is in runs/{path.name}"
    assert f"best design: {read_json(Design, path / 'best.json').topology.key}, 3 modules" in first.stdout
    assert command("run", "toy.toml").stdout == first.stdout


ODD = "gravity: 1.62 m/s^2 is not that of the Earth's surface"


def test_what_check_warns_about_is_told_before_the_work(command):
    asked = ["toy.toml", "--set", "gravity=1.62"]
    warned = f"warning: {ODD}"
    assert command("run", *asked).stderr.splitlines()[0] == warned
    assert command("run", *asked).stderr.splitlines()[0] == warned  # the run has ended
    assert command("solve", *asked, "--topology", "a300").stderr.splitlines()[0] == warned
    told = command("run", *asked, "--json")
    assert [f"{one['path']}: {one['words']}" for one in json.loads(told.stdout)["warnings"]] == [ODD]
    plain = command("run", "toy.toml", "--json")
    assert json.loads(plain.stdout)["warnings"] == []
    assert "warning" not in plain.stderr


def test_solve_warns_about_the_size_that_it_solves(command, tmp_path):
    """Three modules cannot lift themselves here, four can: the largest of a range counts."""
    (tmp_path / "toy.toml").write_text(TOY.replace("3", "[2, 3]", 1).replace("[0.0, 0.0, 1.0]", "[0.0, 0.0, 6.1]"))
    (tmp_path / "toy.toml").write_text((tmp_path / "toy.toml").read_text().replace("com =", 'units = "SI"\ncom ='))
    for key, odd in (("a10", False), ("a300", True)):
        assert ("less than the weight" in command("solve", "toy.toml", "--topology", key).stderr) == odd


def test_the_answer_tells_what_its_audit_notes_about_the_rod(command, monkeypatch):
    def noted(design):
        note = "the rod is 20 m long"
        sheet = EndEffectorSheet(position_m=(0.0, 0.0, 20.0), from_com_m=(0.0, 0.0, 20.0), note=note)
        return toy_problem.audit(design).model_copy(update={"assembly": Assembly(end_effector=sheet)})

    assert "note on " not in command("run", "toy.toml").stdout
    monkeypatch.setattr(compose.binding, "BACKENDS", replace(toy_problem.BACKENDS, audit=noted))
    note, best, _ = command("run", "toy.toml", "--out", "noted").stdout.splitlines()[-3:]
    assert note.endswith(": the rod is 20 m long")
    assert best.startswith(f"best design: {note.removeprefix('note on ').partition(':')[0]}, ")
    assert (
        json.loads(command("run", "toy.toml", "--out", "noted", "--json").stdout)["note"] == "the rod is 20 m long"
    )


def test_run_as_json_holds_the_best_row_and_the_status(command, monkeypatch):
    answer = json.loads(command("run", "toy.toml", "--json").stdout)
    assert answer["exit_status"] == 0
    assert answer["best"]["audit"] == "clear"
    monkeypatch.setenv("TOY_NONE", "*")
    result = command("run", "toy.toml", "--json", "--seed", 1, status=3)
    assert json.loads(result.stdout)["exit_status"] == 3


def test_the_default_folder_is_one_of_task_options_and_seed(command, tmp_path):
    for words in ([], ["--seed", 1], ["--starts", 3], ["--symmetry", "none"], ["--set", "search.margin=1e-3"]):
        command("run", "toy.toml", *words)
    assert len(list((tmp_path / "runs").iterdir())) == 5
    for words in (["--workers", 1], ["--time-limit", 1000], ["--modules", 3]):
        command("run", "toy.toml", *words)
    assert len(list((tmp_path / "runs").iterdir())) == 5


@pytest.mark.parametrize(
    ("told", "status", "said"),
    [
        ({}, 0, "best design"),
        ({"TOY_VIOLATED": "*"}, 1, "none passed its audit"),
        ({"TOY_NONE": "*"}, 3, "smallest shortfall"),
        ({"TOY_IMPOSSIBLE": "3"}, 3, "three modules cannot lift what is asked"),
    ],
)
def test_the_exit_status_is_the_answer_and_comes_again(command, monkeypatch, told, status, said):
    for name, value in told.items():
        monkeypatch.setenv(name, value)
    for _ in range(2):
        assert said in command("run", "toy.toml", "--out", "out", status=status).stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "nowhere.toml"], "nowhere.toml: no such file, nor a shipped example"),
        (["run", "toy.toml", "--set", "module.mas=1"], "module.mas: unknown field; did you mean `mass`?"),
        (["run", "toy.toml", "--modules", "6-4"], "`fewest <= most` must hold, but got [6, 4]"),
        (["run", "toy.toml", "--modules", "many"], "must be N or LO-HI, but got 'many'"),
        (["run", "toy.toml", "--round", 8], "--round require --strategy optuna"),
        (["run", "toy.toml", "--modules", "12", "--workers", 2], "choose the strategy: `optuna` solves the most"),
        (["run", "toy.toml", "--out", "toy.toml"], "cannot be created: File exists"),
        (["solve", "toy.toml", "--topology", "b00"], "a topology key starts with `a`, `p` or `f`, but got 'b00'"),
        (["solve", "toy.toml"], "Missing option '--topology'"),
        (["topologies", "3", "--symmetry", "task"], "'task' is not one of"),
    ],
)
def test_bad_input_is_status_two_and_leaves_nothing(command, tmp_path, words, said):
    before = files(tmp_path)
    assert said in refused(*words)
    assert files(tmp_path) == before


def test_options_stand_for_fields_of_the_task(command, tmp_path):
    words = ["--modules", "2-3", "--root", "paper", "--connectors", "any", "--out", "out"]
    command("run", "toy.toml", *words)
    posed = read_task(tmp_path / "out" / "task.toml").search
    assert (posed.root, posed.connectors) == ("paper", "any")
    keys = {path.stem for path in (tmp_path / "out" / "designs").iterdir()}
    wanted = (candidates(n, symmetry="none", connectors="any", root="paper") for n in (2, 3))
    assert keys == {candidate.key for some in wanted for candidate in some}


@pytest.mark.parametrize(
    "words", [["run", "toy.toml"], ["solve", "toy.toml", "--topology", "a300"], ["check", "toy.toml"]]
)
def test_the_papers_literal_problem_is_one_switch(command, tmp_path, words):
    """Whatever the file says; of the root, the margin and body clearance nothing else."""
    (tmp_path / "toy.toml").write_text(f"{TOY}[search]\nmargin = 1e-3\nbody_clearance = 0.4\nconnectors = 'any'\n")
    told = {"run": ["--out", "out"], "solve": ["--out", "out.json"], "check": ["--json"]}[words[0]]
    done = command(*words, "--paper", *told)
    if words[0] == "run":
        posed = read_task(tmp_path / "out" / "task.toml").search
    elif words[0] == "solve":
        posed = read_json(Design, tmp_path / "out.json").task.search
    else:
        posed = Search.model_validate(json.loads(done.stdout)["task"]["search"])
    wanted = {"root": "paper", "margin": 0.0, "body_clearance": False, "connectors": "any"}
    assert {name: getattr(posed, name) for name in wanted} == wanted


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--root", "free"], ["--paper:", "search.root=free"]),
        (["--set", "search.margin=1e-3"], ["--paper:", "search.margin=1e-3"]),
        (["--set", "search={}"], ["--paper:", "search={}"]),
        (
            ["--set", "goals.clearance=[1e-4, 1e-3]"],
            ["goals.clearance: must be left out with --paper, whose margin is 0"],
        ),
    ],
)
def test_what_the_papers_problem_sets_is_set_by_nothing_else(command, tmp_path, words, said):
    assert says(refused("run", "toy.toml", "--paper", *words), *said)
    assert files(tmp_path) == {"toy.toml"}


def test_a_lossy_symmetry_says_so(command):
    for symmetry, lossy in (("none", False), ("c2", False), ("c4", True), ("d4", True)):
        assert ("is lossy" in command("run", "toy.toml", "--symmetry", symmetry).stdout) == lossy


def full_database():
    """Return what SQLite says when there is no room for another page."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("PRAGMA max_page_count = 1")
        with pytest.raises(sqlite3.OperationalError) as caught:
            database.execute("CREATE TABLE numbers (number)")
    return caught.value


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, "", "candidates.csv"), "No space left on device (candidates.csv)"),
        (full_database(), "database or disk is full"),
    ],
)
def test_a_full_disk_is_told_from_all_that_can_be_repaired_by_typing(command, monkeypatch, error, said):
    def full(*_, **__):
        raise error

    with monkeypatch.context() as patched:
        patched.setattr("topo_search.study.directory.write_atomically", full)
        result = command("run", "toy.toml", "--out", "out", status=74)
        assert said in result.stderr
        assert "the same command" in result.stderr
    command("run", "toy.toml", "--out", "out")


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_a_scheduler_s_signal_keep_what_was_found(command, tmp_path, monkeypatch, sent):
    solve, calls = toy_problem.solve, []

    def interrupted(job):
        calls.append(job.topology.key)
        if len(calls) == 3:
            signal.raise_signal(sent)
        return solve(job)

    with monkeypatch.context() as patched:
        patched.setattr(compose.binding, "BACKENDS", replace(toy_problem.BACKENDS, solve=interrupted))
        result = command("run", "toy.toml", "--out", "out", status=130)
    assert "all results are kept" in result.stderr
    assert len((tmp_path / "out" / "candidates.csv").read_text().splitlines()) == 1 + 2
    command("run", "toy.toml", "--out", "out")


def test_solve_writes_the_design_and_says_what_the_audit_says(command, tmp_path):
    result = command("solve", "toy.toml", "--topology", "a110", "--starts", 4, "--out", "design.json")
    design = read_json(Design, tmp_path / "design.json")
    assert design.topology.key == "a110"
    assert design.solver["starts"] == 4
    assert "a110: clear" in result.stdout
    printed = command("solve", "toy.toml", "--topology", "a110", "--starts", 4, "--json").stdout
    assert printed == (tmp_path / "design.json").read_text()


def test_solve_stops_when_more_starts_do_not_pay(command):
    design = json.loads(command("solve", "toy.toml", "--topology", "a110", "--json").stdout)
    starts, one = design["solver"]["starts"], nlp.default_starts(read_task("toy.toml"))
    assert starts % one == 0
    best = [min(toy_problem.value("a110", s, 0, 1e-4) for s in range(k * one)) for k in range(1, starts // one + 1)]
    idle = [before - after <= 1e-4 * before for before, after in pairwise(best)]
    assert idle[-3:] == [True, True, True]
    assert all(not all(idle[k : k + 3]) for k in range(len(idle) - 3))


def test_solve_has_the_statuses_of_run(command, monkeypatch):
    words = ["solve", "toy.toml", "--topology", "a110", "--starts", 1]
    monkeypatch.setenv("TOY_VIOLATED", "*")
    assert command(*words, status=1).stdout.count("is violated") == 4
    monkeypatch.setenv("TOY_MARGIN", "1e-3")
    assert json.loads(command(*words, "--json").stdout)["task"]["search"]["margin"] == 1e-3
    monkeypatch.setenv("TOY_NONE", "*")
    assert "the only start misses load case 0, torque by" in command(*words, status=3).stdout
    assert Infeasible.model_validate_json(command(*words, "--json", status=3).stdout).status == "infeasible"
    monkeypatch.setenv("TOY_IMPOSSIBLE", "3")
    assert command(*words, status=3).stdout.startswith("three modules cannot lift what is asked\n")


def test_topologies_prints_keys_and_their_number(command):
    keys = command("topologies", 4).stdout.split()
    assert keys == [candidate.key for candidate in candidates(4, symmetry="c2")]
    assert json.loads(command("topologies", 4, "--json").stdout) == keys
    for symmetry in ("none", "c2", "d2", "c4", "d4"):
        words = ["--symmetry", symmetry, "--count"]
        assert int(command("topologies", 6, *words).stdout) == count(6, symmetry=symmetry)
    assert int(command("topologies", 5, "--root", "paper", "--symmetry", "none", "--count").stdout) == 455
    assert int(command("topologies", 5, "--connectors", "any", "--count").stdout) == 742
    drawn = command("topologies", 9, "--sample", 4, "--seed", 7).stdout.split()
    assert drawn == [topology.key for topology in sample(9, 4, 7)]


def test_examples_are_listed(command):
    assert command("examples").stdout.split() == examples()
    assert json.loads(command("examples", "--json").stdout) == examples()


def test_counts_are_in_words_that_agree_and_the_quotient_is_explained(command, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    told = command("run", "toy.toml", "--modules", 1, status=3).stdout
    assert told.startswith("trees that differ only by turning modules by 180 deg")
    assert "\n1 module: 1 of 1 candidate (1 infeasible)\n" in told
    assert "no start of the only candidate led to a design" in told
    assert ", torque by" in told


def test_a_time_limit_that_lets_nothing_end_says_so(command):
    result = command("run", "toy.toml", "--time-limit", "1e-9", status=3)
    assert "time limit reached before the first candidate was solved" in result.stdout
    command("run", "toy.toml")


@pytest.mark.parametrize("words", [["solve", "toy.toml", "--topology", "a300"], ["export", "design.json"]])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(command, tmp_path, words):
    (tmp_path / "taken").write_text("a file, not a folder")
    result = command(*words, "--out", "taken/out.png", status=2)
    assert result.stderr == ("--out: must be writable, but got taken/out.png (taken: Not a directory)\n")
    assert "but got /proc/deep/out.png (/proc: " in command(*words, "--out", "/proc/deep/out.png", status=2).stderr
    command(*words, "--out", "new/" + "x" * 250 + ".png", status=2)
    assert files(tmp_path) == {"taken", "toy.toml"}


def test_a_disk_that_fills_up_while_solving_does_not_lose_the_design(command, tmp_path, monkeypatch):
    words = ["solve", "toy.toml", "--topology", "a300", "--starts", 1]
    printed = command(*words, "--json").stdout

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("topo_search.model.files.os.fsync", full)
    result = command(*words, "--out", "design.json", status=74)
    assert result.stderr.endswith("No space left on device (design.json)\n")
    assert result.stdout == printed
    assert files(tmp_path) == {"toy.toml"}
