"""What is said when there is no design: the reason in the user's words, with its amount and unit."""

import numpy as np
import pytest
from nlp_cases import HOVER, as_design, as_point, hover, push

from nlp import lower_bound, prove_impossible, solve
from nlp.evaluate import violations
from nlp.finish import finish
from nlp.graph import GraphProgram
from nlp.ipopt import Answer
from nlp.starts import draw, generator
from topo_search.model import Design, Infeasible, Topology
from topo_search.model.files import to_json
from verify import audit

PAIR, FIVE = Topology.from_key("a10"), Topology.from_key("a11210")


def failed(task, topology, starts=3, seed=0):
    result = solve(task, topology, starts=range(starts), seed=seed)
    assert isinstance(result, Infeasible)
    return result


@pytest.mark.parametrize(
    ("fields", "word", "unit"),
    [
        ({"load_cases": [{"com": {"force": [0, 0, 1], "torque": [0, 0, 9.0]}}]}, "torque", "N m"),
        ({"load_cases": [{"com": {"force": [0, 0, 2.3]}}], "search": {"body_clearance": 0.59}}, "", ""),
        ({"end_effector": {"position": [0.0, 0.0, 0.01]}, "exposure": [{"kind": "local", "radius": 2.0}]}, "", ""),
    ],
)
def test_the_reason_is_the_worst_violation_of_the_closest_start(fields, word, unit):
    """Everything that is said can be found again from the starts alone."""
    task, key = push(5, **fields), FIVE.key
    result = failed(task, FIVE)
    assert word in result.worst_constraint
    assert result.unit == unit or not unit
    assert result.violation > 0
    assert (result.status, result.topology, result.topology_key) == ("infeasible", FIVE, key)
    assert result.message == (
        f"the closest of 3 starts misses `{result.worst_constraint}` by {result.violation:.3g} {result.unit}"
    )
    program, reasons = GraphProgram(task, FIVE), []
    for s in range(3):
        point = finish(program.solve(draw(task, FIVE, generator(task, FIVE, s, seed=0))).point)
        reasons.append(max(violations(point), key=lambda check: check.scaled - check.tolerance))
    closest = min(reasons, key=lambda check: check.scaled)
    assert (result.worst_constraint, result.unit) == (closest.name, closest.unit)
    assert result.violation == pytest.approx(closest.amount, rel=1e-9)
    assert result.solver is not None
    assert reasons[result.solver.start] is closest
    assert (result.solver.starts, result.solver.starts_feasible, result.solver.seed) == (3, 0, 0)


def test_a_reason_survives_a_file():
    result = failed(push(5, search={"body_clearance": 0.59}), FIVE, starts=1)
    assert Infeasible.model_validate_json(to_json(result)) == result
    assert result.message.startswith("the only start misses `")


def test_two_modules_cannot_push_two_ways():
    """Two thrust axes span a plane; the three load cases of push do not lie in one."""
    result = failed(push(2), PAIR)
    assert result.worst_constraint.startswith("load case ")
    assert result.unit in ("N", "N m")


def test_a_torque_beyond_the_drag_of_all_rotors_is_missed_by_the_rest():
    """One module yaws with 2 k_tau u_max at most while it hovers with the other two rotors' share."""
    task = hover(1)
    module, weight = task.module, task.force_unit(1)
    # rotors 2 and 4 at u_max, 1 and 3 carry the rest of the weight: the largest yaw torque of a hover
    u_max = module.max_input(task.gravity)
    rest = weight / module.thrust_coefficient - 2 * u_max
    most = module.torque_coefficient * (2 * u_max - max(rest, 0.0))
    if rest < 0:
        most = module.torque_coefficient * weight / module.thrust_coefficient
    asked = {"com": {"force": [0, 0, 1], "torque": [0, 0, 1.05 * most / task.torque_unit(1)]}}
    within = {"com": {"force": [0, 0, 1], "torque": [0, 0, 0.95 * most / task.torque_unit(1)]}}
    alone = Topology.from_key("a0")
    assert isinstance(solve(hover(1, load_cases=[within]), alone, starts=range(2), seed=0), Design)
    assert failed(hover(1, load_cases=[asked]), alone).worst_constraint.startswith("load case 0")


@pytest.mark.parametrize(("n", "modules"), [(1, "one module"), (5, "5 modules")])
def test_an_impossible_task_is_proven_before_anything_is_solved(n, modules):
    """u_max is 2.5 times hovering, of the modules' weight without the end-effector's."""
    probe = hover(n)
    most = 2.5 * n * probe.module.mass * probe.gravity
    asked = 3.1 * most
    result = prove_impossible(hover(n, load_cases=[HOVER, {"com": {"force": [0, 0, asked / probe.force_unit(n)]}}]))
    assert result is not None
    assert (result.status, result.topology, result.topology_key, result.solver) == ("impossible", None, None, None)
    assert (result.worst_constraint, result.unit) == ("load case 1, force", "N")
    assert result.violation == pytest.approx(asked - most)
    assert result.message.startswith(f"{modules} can lift 3.1 times less than load case 1 asks")
    assert f"{most:.4g} N" in result.message
    assert f"{asked:.4g} N" in result.message


@pytest.mark.parametrize("over", [0.999, 1.001])
def test_the_proof_is_sharp(over):
    """One module can pull with just all its rotors, and no more; the force counts in whatever direction."""
    probe = hover(1)
    size = over * 2.5 * probe.module.mass / probe.total_mass(1)
    direction = np.array([0.6, 0.0, 0.8]) * size
    halves = {"com": {"force": (direction / 2).tolist()}, "end_effector": {"force": (direction / 2).tolist()}}
    task = push(1, load_cases=[halves])
    assert (prove_impossible(task) is None) == (over < 1)
    result = solve(task, Topology.from_key("a0"), starts=range(3), seed=0)
    assert isinstance(result, Design) == (over < 1)


def test_a_shipped_task_is_not_proven_impossible():
    assert prove_impossible(push(5)) is None


def test_a_task_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"`task\.n == topology\.n` must hold, but got 5 != 2"):
        solve(push(5), PAIR, starts=range(1), seed=0)


def test_no_starts_are_refused():
    with pytest.raises(ValueError, match=r"`starts` must have at least one index, but got range\(3, 3\)"):
        solve(push(5), FIVE, starts=range(3, 3), seed=0)


def test_a_success_word_alone_is_not_believed(monkeypatch):
    """The start itself, handed back as solved, is judged by its violations."""
    monkeypatch.setattr(GraphProgram, "solve", lambda _self, start: Answer(start, "Solve_Succeeded", 0))
    assert isinstance(solve(push(5), FIVE, starts=range(2), seed=0), Infeasible)


def test_a_failure_word_alone_is_not_believed(monkeypatch):
    """A feasible point counts, whatever Ipopt says of it."""
    program_solve = GraphProgram.solve

    def pessimist(self, start):
        answer = program_solve(self, start)
        return Answer(answer.point, "Maximum_Iterations_Exceeded", answer.iterations)

    monkeypatch.setattr(GraphProgram, "solve", pessimist)
    result = solve(hover(1), Topology.from_key("a0"), starts=range(1), seed=0)
    assert isinstance(result, Design)
    assert result.solver is not None
    assert result.solver["status"] == "Maximum_Iterations_Exceeded"
    assert result.objective == pytest.approx(lower_bound(hover(1)), rel=1e-8)


def test_the_audit_finds_the_violation_that_was_reported():
    """The closest point of an infeasible task, written as a design, is violated by as much."""
    task = hover(1, end_effector={"position": "com"})
    alone = Topology.from_key("a0")
    result = failed(task, alone, starts=1)
    start = draw(task, alone, generator(task, alone, 0, seed=0))
    design = as_design(finish(GraphProgram(task, alone).solve(start).point))
    (pair,) = [pair for pair in audit(design).pairs if pair.kind == "exclusion"]
    assert pair.analytic_m == pytest.approx(-result.violation)
    np.testing.assert_allclose(as_point(design).p_COM, as_point(design).poses[1][0], atol=1e-12)
