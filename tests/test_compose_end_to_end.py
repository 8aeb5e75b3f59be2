"""The whole way with the real solver and the real audit, on platforms small enough for seconds."""

import json
import os
import signal
import subprocess
import sys
from multiprocessing.process import BaseProcess
from unittest.mock import patch

import pytest
from commands import invoke
from own_code import fatal
from processes import eventually, gone, ranking, recorded
from toy_problem import InProcess
from verify_cases import fan

import topo_search
from topo_search import OwnConstraint, audit, solve, to_json
from topo_search.model import Design
from topo_search.model.files import read_json
from topo_search.model.task_file import read_task
from topo_search.study import COLUMNS


def platform(path):
    """All of a design but how long it took."""
    return read_json(Design, path).model_copy(update={"solver": None})


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The four-module push task, searched in this process."""
    path = tmp_path_factory.mktemp("push")
    task = read_task("push", ("modules=4",))
    with patch("topo_search.compose.binding.Workers", InProcess):
        return task, topo_search.search(task, out=path, starts=2)


@pytest.mark.usefixtures("in_process")
def test_the_best_of_four_modules_is_audited_and_its_file_stands_alone(found):
    _, answer = found
    assert answer.exit_status == 0
    assert read_json(Design, answer.folder / "best.json").objective == answer.best.objective
    assert 0 < answer.best.gap < 0.1
    assert json.loads(invoke("audit", answer.folder / "best.json", "--json").stdout)["verdict"] == "clear"


def children_of(pid):
    with open(f"/proc/{pid}/task/{pid}/children") as listing:
        return [int(child) for child in listing.read().split()]


def tree_of(pid):
    family = [pid]
    for process in family:
        family += children_of(process)
    return family


def test_two_workers_find_the_same_though_all_are_killed_and_then_one(found, tmp_path):
    """Nothing stays behind, and the resumed run ends as if nothing was."""
    _, whole = found
    killed = tmp_path / "killed"

    def start():
        command = [sys.executable, "-m", "topo_search", "run", "push", "--modules", "4", "--starts", "2"]
        return subprocess.Popen(
            [*command, "--workers", "2", "--out", str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    process = start()
    eventually(lambda: len(recorded(killed)) >= 2 and len(tree_of(process.pid)) > 1)
    family = tree_of(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    eventually(lambda: all(map(gone, family)))
    acknowledged = len(recorded(killed))
    assert 2 <= acknowledged < len(ranking(whole.folder))

    resumed = start()
    eventually(lambda: len(recorded(killed)) > acknowledged)
    workers = [pid for pid in tree_of(resumed.pid)[1:] if not children_of(pid)]
    os.kill(workers[-1], signal.SIGKILL)
    family = tree_of(resumed.pid)
    assert resumed.wait(timeout=300) == 0
    eventually(lambda: all(map(gone, family)))
    assert ranking(killed) == ranking(whole.folder)
    assert platform(killed / "best.json") == platform(whole.folder / "best.json")


@pytest.mark.usefixtures("in_process")
def test_the_mirror_image_need_not_be_solved_because_it_costs_the_same(found, tmp_path):
    """Push is unchanged by exchanging x and y: every tree of the half-turn quotient costs what its mirror does."""
    task, merged = found
    whole = topo_search.search(task, out=tmp_path / "c2", starts=2, symmetry="c2")
    assert whole.sizes[0].candidates == 14
    assert merged.sizes[0].candidates == 10
    assert merged.best.objective == pytest.approx(whole.best.objective, rel=1e-6)


def test_one_topology_is_solved_as_in_the_search(found):
    task, answer = found
    design = read_json(Design, answer.folder / "best.json")
    alone = topo_search.solve(task, design.topology, starts=2)
    assert alone.exit_status == 0
    assert alone.outcome.model_copy(update={"solver": None}) == design.model_copy(update={"solver": None})


@pytest.mark.usefixtures("in_process")
def test_what_no_platform_can_lift_is_said_in_words(tmp_path):
    task = read_task("push", ("modules=3", "module.max_thrust_to_weight=0.5"))
    answer = topo_search.search(task, out=tmp_path / "heavy")
    assert answer.exit_status == 3
    assert "can lift" in answer.sizes[0].reason
    assert {row[COLUMNS.index("status")] for row in ranking(answer.folder)} == {"impossible"}


def test_a_time_limit_still_ends_with_an_audited_design():
    task = read_task("push", ("modules=3",))
    solved = topo_search.solve(task, topo_search.Topology.from_key("a300"), starts=4, time_limit=30.0)
    assert solved.exit_status == 0


# ---- A single candidate is solved and audited in the calling process, unless that has to be safe from what is
# run.

PLAIN = """
from topo_search import audit, read_task, solve
solved = solve(read_task("push", ("modules=3",)), "a300", starts=1)
print(solved.audit.verdict, audit(solved.design).verdict)
"""
FATAL = OwnConstraint("fatal", fatal, upper=10.0, unit="m")


@pytest.fixture
def alone(monkeypatch):
    """No process can be started."""

    def refuse(process):
        raise AssertionError(process)

    monkeypatch.setattr(BaseProcess, "start", refuse)


def test_a_script_without_a_guard_solves_and_audits(tmp_path):
    (tmp_path / "plain.py").write_text(PLAIN)
    done = subprocess.run([sys.executable, tmp_path / "plain.py"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "clear clear\n")
    assert "Traceback" not in done.stderr


def test_commands_on_one_candidate_start_no_process(alone, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["solve", "push", "--topology", "a300", "--starts", "1", "--out", "a300.json"]
    for command in (words, ["audit", "a300.json"], ["audit", "a300.json", "--workers", "2"]):
        invoke(*command)


def test_several_designs_are_audited_in_workers(alone, tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.json").write_text(to_json(fan()))
    with pytest.raises(AssertionError):
        invoke("audit", tmp_path, "--workers", "1")


@pytest.mark.parametrize("needs", [{"time_limit": 1.0}, {"constraints": [FATAL]}])
def test_what_may_have_to_be_ended_is_solved_in_a_worker(alone, needs):
    with pytest.raises(AssertionError):
        solve(read_task("push", ("modules=3",)), "a300", starts=1, **needs)


def test_a_constraint_that_ends_its_process_fails_the_audit_alone():
    with pytest.raises(RuntimeError, match="SIGKILL"):
        audit(fan(), constraints=[FATAL])
