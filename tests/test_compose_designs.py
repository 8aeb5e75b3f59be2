"""A single candidate is solved and audited in the calling process, unless that has to be safe from what is run."""

import subprocess
import sys
from multiprocessing.process import BaseProcess

import pytest
from click.testing import CliRunner
from own_code import fatal
from verify_cases import fan

from topo_search import OwnConstraint, audit, read_task, solve, to_json
from topo_search.cli import main

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
    words = ["solve", "push", "--modules", "3", "--topology", "a300", "--starts", "1", "--out", "a300.json"]
    for command in (words, ["audit", "a300.json"], ["audit", "a300.json", "--workers", "2"]):
        result = CliRunner().invoke(main, command, catch_exceptions=False)
        assert result.exit_code == 0, result.output


def test_several_designs_are_audited_in_workers(alone, tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.json").write_text(to_json(fan()))
    with pytest.raises(AssertionError):
        CliRunner().invoke(main, ["audit", str(tmp_path), "--workers", "1"], catch_exceptions=False)


@pytest.mark.parametrize("needs", [{"time_limit": 1.0}, {"constraints": [FATAL]}])
def test_what_may_have_to_be_ended_is_solved_in_a_worker(alone, needs):
    with pytest.raises(AssertionError):
        solve(read_task("push", ("modules=3",)), "a300", starts=1, **needs)


def test_a_constraint_that_ends_its_process_fails_the_audit_alone():
    with pytest.raises(RuntimeError, match="SIGKILL"):
        audit(fan(), constraints=[FATAL])
