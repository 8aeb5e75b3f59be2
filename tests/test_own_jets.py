"""Modules whose rotors lean so far that each has an airflow envelope of its own."""

import math
from typing import Any

import numpy as np
import pytest
from nlp_cases import FEATURES, as_design, push, random_point
from test_rotors import SMALL, X, star

from nlp import solve
from topo_search.export.solids import airflow
from topo_search.model import BadInput, Design, Topology
from topo_search.model.airflow import AirflowEnvelope
from topo_search.report.task_facts import facts
from verify import audit

Array = np.ndarray[Any, Any]
RADIUS, SPREAD, REACH = 0.03, 10.0, 1.2
MODULE = {"rotors": star(45.0), "airflow": {"reach": REACH}, **SMALL}
ABLATION = {"interference": "separation"}


def jets(design: Design, R: Array, p: Array) -> list[tuple[int, int, Array, Array, Array]]:
    """Module, rotor, and balls of every rotor's envelope, from the fields of the task file alone."""
    found = []
    growth = math.tan(math.radians(SPREAD) / 2)
    length, eta = (REACH - RADIUS) / (1 + growth), np.linspace(0.0, 1.0, 4001)
    for i, (R_i, p_i) in enumerate(zip(R, p, strict=True)):
        for q, rotor in enumerate(design.task.module.rotors or ()):
            axis = R_i @ (np.array(rotor.axis) / np.linalg.norm(rotor.axis))
            centres = p_i + R_i @ np.array(rotor.position) - (eta * length)[:, None] * axis
            found.append((i, q, centres, RADIUS + eta * length * growth, axis))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_the_audit_s_envelopes_are_those_of_each_rotor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    region = {"kind": "local", "radius": 0.1}
    task = push(3, module=MODULE, search=ABLATION, exposure=[region], end_effector={"rod": "straight"})
    point = random_point(task, Topology.from_key("a300"), rng)
    design, (R, p) = as_design(point), point.poses
    found = audit(design)
    expected = {(i, q): (centres, radii) for i, q, centres, radii, _ in jets(design, R, p)}
    checked = [pair for pair in found.pairs if pair.kind == "local"]
    assert {(pair.a, pair.rotor) for pair in checked} == set(expected)
    for pair in checked:
        centres, radii = expected[pair.a, pair.rotor]
        exact = float((np.linalg.norm(centres - point.tip, axis=1) - radii - 0.1).min())
        assert pair.analytic_m == pytest.approx(exact, abs=1e-4)
        # no random point of the envelope or ray along its flow comes nearer than what is proven
        numbers = rng.integers(0, len(radii), 2000)
        inside = centres[numbers] + radii[numbers, None] * random_directions(rng, 2000)
        nearest = float(np.linalg.norm(inside - point.tip, axis=1).min()) - 0.1
        assert pair.lower_m is None or nearest >= pair.lower_m - 1e-9
    rods = [pair for pair in found.pairs if pair.kind == "rod-airflow"]
    assert {(pair.b, pair.rotor) for pair in rods} == set(expected)
    l_c, differences = task.module.connector_distance, []
    for port in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]):  # one of them has the rod
        start = p[rods[0].a] + l_c * R[rods[0].a] @ port
        along = start + np.linspace(0.0, 1.0, 201)[:, None] * (point.tip - start)
        gaps = []
        for pair in rods:
            centres, radii = expected[pair.b, pair.rotor]
            apart = np.linalg.norm(centres[::10, None] - along, axis=2) - radii[::10, None]
            gaps.append(abs(float(apart.min()) - task.end_effector.rod_radius - pair.analytic_m))
        differences.append(max(gaps))
    assert min(differences) <= 3e-3


def random_directions(rng: np.random.Generator, count: int) -> Array:
    v = rng.normal(size=(count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def test_a_search_keeps_every_rotor_s_jet_off_a_region() -> None:
    region = {"kind": "local", "radius": 0.12}
    loads = [
        {"com": {"force": [0.0, 0.0, 1.0]}},
        {"end_effector": {"force": [0.1, 0.0, 0.0]}, "carries_weight": True},
    ]
    module = {**MODULE, "max_thrust_to_weight": 5.0}
    task = push(2, module=module, search=ABLATION, exposure=[region], load_cases=loads)
    designs = [solve(task, Topology.from_key("a10"), starts=range(12), seed=seed) for seed in range(2)]
    made = [one for one in designs if isinstance(one, Design)]
    assert made
    found = audit(made[0])
    assert found.verdict == "clear"
    assert len([pair for pair in found.pairs if pair.kind == "local"]) == 2 * len(module["rotors"])


def test_envelopes_start_at_each_rotor_and_spread_as_the_module_s() -> None:
    task = push(1, module=MODULE, search=ABLATION)
    envelopes = task.module.envelopes
    assert len(envelopes) == 6
    assert {(one.start_radius, one.growth) for one in envelopes} == {
        (RADIUS, AirflowEnvelope.of(RADIUS, SPREAD, REACH).growth)
    }
    assert len(push(1, module={**MODULE, "rotors": star(20.0)}).module.envelopes) == 1
    low = airflow(task.module).vertices[:, 2].min()
    lowest = min(one.origin[2] - one.length * one.upstream[2] - one.end_radius for one in envelopes)
    assert low == pytest.approx(lowest, rel=1e-3)  # a polyhedron


@pytest.mark.parametrize(("tilt", "words"), [(45.0, "each rotor has its own"), (10.0, "one for all")])
def test_check_says_how_far_axes_part_and_which_envelope_holds(tilt: float, words: str) -> None:
    task = push(1, module={**MODULE, "rotors": star(tilt)}, search=ABLATION)
    told = dict(row for _, rows in facts(task) for row in rows)["envelopes of a module"]
    assert f"up to {tilt:g}°" in told
    assert words in told


def test_modules_without_tilt_say_nothing_of_it() -> None:
    told = dict(row for _, rows in facts(push(1, module={"rotors": X})) for row in rows)
    assert "envelopes of a module" not in told


def test_jets_that_must_stay_off_neighbours_are_refused() -> None:
    for search, field in (
        ({"interference": "airflow"}, "tilt"),
        ({**ABLATION, "body_clearance": 0.3}, "must be false"),
    ):
        with pytest.raises((BadInput, ValueError), match="45 deg" if field == "tilt" else field):
            push(2, module=MODULE, search=search)


def test_a_feature_has_such_rotors() -> None:
    assert push(2, **FEATURES["jets of their own"]).module.rotor_table.has_own_jets
