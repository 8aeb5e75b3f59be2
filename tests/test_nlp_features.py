"""Everything that a task can ask for, solved on five modules and audited."""

import math

import numpy as np
import pytest
from nlp_cases import DISTINCT, FEATURES, best_design, hover, push
from suites import few

from nlp import lower_bound
from nlp.numbers.geometry import largest_turn
from topo_search.model import Design, Status, Topology
from topo_search.model.files import to_json
from topo_search.model.task_file import examples, read_task
from verify import audit

SHIPPED = [name for name in examples() if name.startswith(("push", "ten-wrenches"))]


def assert_audited(design, task, topology):
    """The audit is clear, the wrenches are met with room to spare, and what the design says of itself is true."""
    found = audit(design)
    assert [row for row in found.residuals if row.status is not Status.CLEAR] == []
    told = {"rod-airflow", "rod-region", *(["airflow"] * (task.search.interference != "airflow"))}
    counting = [pair for pair in found.pairs if pair.kind not in told]
    assert [pair for pair in counting if pair.status is not Status.CLEAR] == []
    assert found.verdict is Status.CLEAR
    wrenches = [row for row in found.residuals if row.name.startswith("load case") and row.unit in ("N", "N m")]
    assert len(wrenches) == 3 * len(task.load_cases)  # force, torque about the COM and about the end-effector
    assert max(row.scaled for row in wrenches) < 1e-7  # a tenth of what the audit allows

    u_max = task.module.max_input(task.gravity)
    assert 0.0 <= design.inputs.min() <= design.inputs.max() <= u_max
    assert np.abs(design.hinge_angles_rad).max() <= math.pi / 2
    psi, alpha_0, alpha_1 = design.root_orientation_rad
    assert abs(psi) <= (0.0 if task.search.root == "paper" else math.pi)
    assert abs(alpha_0) <= math.pi / 2
    assert abs(alpha_1) <= (math.pi / 2 if task.search.root == "paper" else math.pi)

    weights = np.array([case.weight for case in task.load_cases])
    assert design.objective == pytest.approx(weights @ np.sum(design.inputs**2, axis=(1, 2)), rel=1e-12)
    assert design.lower_bound == lower_bound(task) <= design.objective
    assert design.gap == pytest.approx(1 - design.lower_bound / design.objective, abs=1e-15)
    assert (design.task, design.topology, design.topology_key) == (task, topology, topology.key)
    assert Design.model_validate_json(to_json(design)) == design


@pytest.mark.parametrize("name", few(SHIPPED, ["push-two-paths", "push-exterior-60", "ten-wrenches-local"]))
@pytest.mark.parametrize("key", few(["a11210", "a11410"], 1))
def test_a_shipped_example_is_solved_and_audited(name, key):
    task, topology = read_task(name).resolve(5), Topology.from_key(key)
    assert_audited(best_design(task, topology, 6), task, topology)


@pytest.mark.parametrize("name", few(FEATURES, DISTINCT[::3]))
def test_a_feature_is_solved_and_audited(name):
    topology = Topology.from_key("p11290" if name == "any port" else "a11210")
    task = push(5, **FEATURES[name])
    assert_audited(best_design(task, topology, 6), task, topology)


@pytest.mark.parametrize(
    ("key", "module"),
    [
        ("a11210", {"body": {"rotor_height": 0.1}}),
        pytest.param("a62020", {"arm_length": 0.135}, marks=pytest.mark.slow),
        pytest.param("a62020", {"body": {"rotor_radius": 0.075}}, marks=pytest.mark.slow),
    ],
)
def test_modules_whose_rotors_could_touch_are_kept_from_it(key, module):
    """The angle at which rotors of bolted neighbours meet stands in the way of the optimum."""
    task, topology = push(5, module=module), Topology.from_key(key)
    design = best_design(task, topology, 2)
    assert_audited(design, task, topology)
    assert np.abs(design.hinge_angles_rad).max() == pytest.approx(largest_turn(task), abs=1e-6)
    parts = [pair for pair in audit(design).pairs if pair.kind == "body"]
    assert min(pair.analytic_m for pair in parts) == pytest.approx(2e-4, rel=0.5)


def test_the_ablation_lets_envelopes_overlap_and_says_so():
    """Hovering in one plane needs the least effort, and neighbours then blow into each other at the far end."""
    task = hover(3, search={"interference": "separation"})
    found = audit(best_design(task, Topology.from_key("a110"), 2))
    assert [pair.status for pair in found.pairs if pair.kind == "separation"] == [Status.CLEAR] * 3
    overlaps = {(pair.a, pair.b): pair.analytic_m for pair in found.pairs if pair.status is Status.VIOLATED}
    air, l_c = task.module.envelope, task.module.connector_distance
    assert overlaps == pytest.approx(
        {(0, 1): 2 * (l_c - air.end_radius), (1, 2): 2 * (l_c - air.end_radius)}, abs=1e-3
    )
    assert found.verdict is Status.CLEAR
