"""The axis of the rod: the tool comes from where the task says, in search and audit, and no tree is lost to it."""

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from nlp_cases import GENTLE_PUSH, best_design, push
from verify_cases import Array, design, fan, unit

from nlp import lower_bound
from nlp.numbers.geometry import poses, root_rotation
from topo_search import OwnConstraint, SymbolicPlatform, audit, solve
from topo_search.export.poses import axis_words
from topo_search.export.task_picture import task_figure
from topo_search.model import Design, Mount, ResolvedTask, Status, Task, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.report.task_facts import facts
from topo_search.report.task_warnings import task_warnings
from topo_search.study.relaxable_limits import relaxable
from topo_search.topologies import candidates, improper_isometry
from verify import audit as verified

BULB: dict[str, Any] = {
    "name": "bulb",
    "modules": 3,
    "module": {"max_thrust": 3.2, "joint_mass": 0.0},
    "flight": {"defaults": False},
    "load_cases": [
        {
            "name": name,
            "units": "SI",
            "carries_weight": True,
            "end_effector": {"force": [0.0, 0.0, 1.0], "torque": [0.0, 0.0, torque]},
        }
        for name, torque in (("in", 0.2), ("out", -0.2))
    ],
    "exposure": [{"kind": "allowed", "planes": [{"normal": [0.0, 0.0, 1.0]}], "solid": True}],
}
UP = [0.0, 0.0, 1.0]
TREE = Topology.from_key("a600")


def rod_of(found: Design) -> Array:
    """The vector from the mount to the end-effector, by the solver's kinematics instead of the audit's."""
    l_c, mount = found.task.module.connector_distance, found.mount
    R, p = poses(
        found.topology, root_rotation(np.array(found.root_orientation_rad)), np.array(found.hinge_angles_rad), l_c
    )
    return np.array(found.end_effector_m) - p[mount.module] - l_c * R[mount.module] @ PORT_DIRECTIONS[mount.port]


def angle(rod: Array, axis: Any) -> float:
    """The angle of two directions [deg]."""
    return math.degrees(math.acos(rod @ np.array(axis) / np.linalg.norm(rod) / np.linalg.norm(axis)))


def bulb(rod: dict[str, Any] | None = None, **changes: Any) -> Task:
    return Task.model_validate({**BULB, "end_effector": {"rod_mass": "ignored", **(rod or {})}, **changes})


def found(task: Task, **given: Any) -> Design:
    answer = solve(task, TREE, starts=3, **given)
    assert answer.found
    return answer.design


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("rod", "largest"),
    [
        ({"axis": UP}, 20.0),
        ({"axis": "force", "axis_case": "out", "within_deg": 8.0, "rod_mass": "included"}, 8.0),
        pytest.param({"axis": UP, "within_deg": 10.0}, 10.0, marks=pytest.mark.slow),
    ],
    ids=["axis", "force", "hinge set"],
)
def test_a_bulb_is_screwed_in_from_below_if_the_task_says_so(rod: dict[str, Any], largest: float) -> None:
    search = {"hinge_step_deg": 15.0} if largest == 10.0 else {}
    bent, straight = found(bulb(search=search)), found(bulb(rod, search=search))
    assert angle(rod_of(bent), UP) > 30.0
    assert angle(rod_of(straight), UP) == pytest.approx(largest, abs=0.1)  # no more upright than needed
    assert angle(rod_of(straight), UP) <= largest
    (row,) = (row for row in audit(straight).residuals if row.name == "rod-axis")
    assert (row.value, row.unit, row.status, row.stated) == (0.0, "deg", Status.CLEAR, largest)
    assert row.derived == pytest.approx(angle(rod_of(straight), UP), abs=1e-9)
    tilt = axis_words(straight.task, rod_of(straight) / np.linalg.norm(rod_of(straight)))
    assert tilt.startswith(f"{row.derived:.1f} deg from [0, 0, 1]")
    assert straight.objective > bent.objective > lower_bound(straight.task)


def test_the_audit_measures_the_angle_of_any_rod() -> None:
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(8):
        axis, within, tip = unit(rng), float(rng.uniform(1.0, 90.0)), tuple((0.6 * unit(rng)).tolist())
        rod = {"rod": "straight", "axis": axis.tolist(), "within_deg": within}
        given = fan({"end_effector": rod}, root=tuple(rng.uniform(-1.5, 1.5, 3).tolist()), end_effector=tip)
        i, port = given.topology.free_connectors[rng.integers(len(given.topology.free_connectors))]
        given = given.model_copy(update={"mount": Mount(module=i, port=port)})
        (row,) = (row for row in verified(given).residuals if row.name == "rod-axis")
        assert row.derived == pytest.approx(angle(rod_of(given), axis), abs=1e-6)
        assert row.value == pytest.approx(max(0.0, angle(rod_of(given), axis) - within), abs=1e-6)
        assert row.status == (Status.CLEAR if row.value == 0.0 else Status.VIOLATED)
        seen.add(row.status)
    assert len(seen) == 2


def test_a_longer_rod_along_the_axis_is_mounted_before_a_shorter_one() -> None:
    """Of a module whose tip is above its port +x, the rod from +x is upright and those from +y and -y are not."""
    one, tip = Topology(((-1, -1, -1),)), (-0.02, 0.0, 0.3)
    plain = design(one, {"end_effector": {"rod": "straight"}}, hinges=(), end_effector=tip)
    assert verified(plain).assembly.end_effector.mount == Mount(module=0, port=2)
    axis = [-0.17, 0.0, 0.3]
    aimed = design(one, {"end_effector": {"rod": "straight", "axis": axis}}, hinges=(), end_effector=tip)
    result = verified(aimed)
    assert result.assembly.end_effector.mount == Mount(module=0, port=0)
    (row,) = (row for row in result.residuals if row.name == "rod-axis")
    assert (row.derived, row.status) == (pytest.approx(0.0, abs=1e-6), Status.CLEAR)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("rod_mass", ["included", "ignored"])
def test_where_the_rod_along_the_axis_is_in_the_way_another_one_is_solved_for(rod_mass: str) -> None:
    """A flower is touched from the side: the nearest rod that points there passes through airflow at first."""
    blossom = {
        "module": {"max_thrust": 3.2, "min_input": 0.03, "joint_mass": 0.109},
        "end_effector": {"mass": 0.03, "rod_deflection": 0.02, "axis": [1.0, 0.0, 0.0], "rod_mass": rod_mass},
        "load_cases": [{"carries_weight": True, "units": "SI", "end_effector": {"force": [0.0, 0.0, -0.2]}}],
        "exposure": [{"kind": "local", "radius": 0.1}],
    }
    answer = solve(bulb(**blossom), Topology.from_key("a300"), starts=3)
    assert answer.found
    assert angle(rod_of(answer.design), [1.0, 0.0, 0.0]) <= 20.0
    assert answer.design.task.end_effector.rod_mass == rod_mass


def aimed(axis: list[float]) -> ResolvedTask:
    rod = {"rod": "straight", "rod_mass": "ignored", "axis": axis, "largest_reach": 0.3, "within_deg": 8.0}
    return push(3, load_cases=GENTLE_PUSH, module={"joint_mass": 0.0}, end_effector=rod)


@pytest.mark.parametrize(("axis", "merged"), [([1.0, 1.0, -1.0], True), ([1.0, 0.3, -1.0], False)])
def test_trees_are_merged_if_they_cost_the_same_when_solved_apart(axis: list[float], merged: bool) -> None:
    """The push task is symmetric in x and y, and the trees a300 and a600 are mirror images."""
    task = aimed(axis)
    one, other = (best_design(task, Topology.from_key(key), 24).objective for key in ("a300", "a600"))
    assert (abs(other / one - 1) < 1e-6) == merged
    keys = {candidate.key for candidate in candidates(3, symmetry="task", task=task)}
    assert ({"a300", "a600"} <= keys) != merged


def test_an_axis_along_a_force_breaks_the_symmetry_that_exchanges_it() -> None:
    assert improper_isometry(push(5)) is not None
    assert improper_isometry(push(5, end_effector={"rod": "straight", "axis": "force"})) is None
    assert improper_isometry(push(5, end_effector={"rod": "straight", "axis": UP})) is not None


def test_a_task_without_an_axis_is_as_before() -> None:
    plain = bulb().resolve(3)
    assert plain.rod_axis is None
    assert not {"axis", "axis_case", "within_deg"} & set(plain.model_dump(mode="json")["end_effector"])
    task = bulb({"axis": [0.0, 3.0, 4.0]}).resolve(3)
    assert task.rod_axis == pytest.approx((0.0, 0.6, 0.8))
    assert lower_bound(task) == lower_bound(plain)


def test_the_angle_is_told_doubted_and_relaxed() -> None:
    task = bulb({"axis": "force"})
    told = dict(row for _, rows in facts(task.resolve(3)) for row in rows)
    assert told["rod, from its connector"] == "within 20° of [0, 0, 1], along the force"
    (legend,) = task_figure(task.resolve(3)).legends
    assert "rod, within 20 deg" in [text.get_text() for text in legend.texts]
    assert not [each for each in task_warnings(task) if each.path == "end_effector.within_deg"]
    radians = bulb({"axis": UP, "within_deg": 0.35})
    assert "is it in degrees?" in next(
        each.words for each in task_warnings(radians) if each.path == "end_effector.within_deg"
    )
    (limit,) = (each for each in relaxable(task, 3) if each.field == "end_effector.within_deg")
    assert (limit.value(task), limit.value(limit.relax(0.5)), limit.unit) == (20.0, 30.0, "deg")
    wide = bulb({"axis": UP, "within_deg": 60.0})
    (limit,) = (each for each in relaxable(wide, 3) if each.field == "end_effector.within_deg")
    assert max(limit.shares) == 0.5  # no angle above 90 degrees
    assert not [each for each in relaxable(bulb(), 3) if each.field == "end_effector.within_deg"]


def uprightness(platform: SymbolicPlatform) -> ca.SX:
    """Sine of the rod's slope."""
    return platform.rod[2] / ca.norm_2(platform.rod)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("rod_mass", ["included", "ignored"])
def test_own_constraints_see_the_rod(rod_mass: str) -> None:
    task, least = bulb({"rod_mass": rod_mass}), math.cos(math.radians(20.0))
    stated = found(task, constraints=[OwnConstraint("upright rod", uprightness, lower=least)])
    assert angle(rod_of(stated), UP) <= 20.0 + 1e-3
    asked = found(bulb({"rod_mass": rod_mass, "axis": UP}))
    assert asked.objective * (1 - 1e-6) <= stated.objective == pytest.approx(asked.objective, rel=0.03)
    if rod_mass == "ignored":  # any mount goes with a rod without mass
        i, port = stated.topology.free_connectors[-1]
        stated = stated.model_copy(update={"mount": Mount(module=i, port=port)})
    checks = audit(stated, constraints=[OwnConstraint("rod", uprightness, 0.0)]).stated
    (check,) = (each for each in checks if each.name == "rod")
    assert check.value == pytest.approx(math.cos(math.radians(angle(rod_of(stated), UP))), abs=1e-9)
