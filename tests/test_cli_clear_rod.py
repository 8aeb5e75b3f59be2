"""A design without a straight rod that is clear says so in the last line about it; the line after is of files."""

from dataclasses import replace

import pytest
import toy_problem
from toy_problem import toy_run
from verify_cases import design

from topo_search.cli.tables import answer_lines, solved_lines
from topo_search.model import Design, Topology
from topo_search.report.design_part import findings
from topo_search.study import Solved
from verify import audit

ONE = Topology(((-1, -1, -1),))
WALLS = {"hub": [0.28, 0.28, 0.5], "rotor_radius": 0.005, "rotor_height": 0.001}
BLOCKED = {"module": {"body": WALLS}, "end_effector": {"exclusion": False}}
CASES = {
    "clear": (design(ONE, {}, hinges=(), end_effector=(0.0, 0.0, 0.36)), True),
    "in airflow": (design(ONE, {}, hinges=(), end_effector=(0.0, 0.0, -0.6)), False),
    "blocked": (design(ONE, BLOCKED, hinges=(), end_effector=(0.0, 0.0, 0.1)), False),
}
WORDS = "without a straight rod that is clear of all parts and airflow"


@pytest.mark.parametrize("case", CASES)
def test_the_last_line_about_a_solved_design_says_so(case, tmp_path, capsys):
    given, clear = CASES[case]
    print(*solved_lines(Solved(given, audit(given), ()), tmp_path / "design.json"), sep="\n")
    *told, files = capsys.readouterr().out.splitlines()
    assert files.startswith("the design is in ")
    assert told[-1].endswith(WORDS) == (not clear)
    assert sum(WORDS in line for line in told) == (not clear)


@pytest.mark.parametrize("verdict", ["clear", "violated"])
def test_what_a_shorter_rod_costs_is_said_of_clear_designs_alone(verdict, capsys):
    given = CASES["clear"][0].model_copy(update={"solver": {"shorter_rod": {"length_m": 0.26, "cost": 0.01}}})
    judged = audit(given).model_copy(update={"verdict": verdict})
    print(*solved_lines(Solved(given, judged, ()), None), sep="\n")
    words = "rod of at most 0.26 m adds 1 % control effort"
    assert (words in capsys.readouterr().out) == (verdict == "clear")
    assert any(words in line for line in findings(given, judged)) == (verdict == "clear")


@pytest.mark.parametrize("case", CASES)
def test_the_last_line_about_the_best_design_of_a_run_says_so(case, tmp_path, capsys):
    """The toy problem's designs, with the assembly sheet of a real audit."""
    given, clear = CASES[case]
    sheet = audit(given).assembly

    def judged(found: Design):
        return toy_problem.audit(found).model_copy(update={"assembly": sheet})

    answer = toy_run(tmp_path / "run", backends=replace(toy_problem.BACKENDS, audit=judged))
    print(*answer_lines(answer), sep="\n")
    *told, best, files = capsys.readouterr().out.splitlines()
    assert files == f"everything is in {answer.folder}"
    assert best.startswith(f"best design: {answer.best.key}, ")
    assert best.endswith(WORDS) == (not clear)
    assert answer.clear_rod == clear
    assert any(line == f"note on {answer.best.key}: {answer.note}" for line in told) == (answer.note is not None)
