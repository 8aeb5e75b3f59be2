"""Flat lattices: polyominoes as candidates, and platforms with cycles in solver, audit and exports."""

import json
import math
from collections import Counter
from itertools import pairwise
from random import Random
from typing import Any
from xml.etree import ElementTree

import mujoco
import networkx as nx
import numpy as np
import pytest
from nlp_cases import HOVER
from verify_cases import failing

from nlp import lower_bound, prove_impossible
from nlp.numbers.point import Point
from topo_search.compose.binding import BACKENDS
from topo_search.engine import Job
from topo_search.export.audits import flight_lines
from topo_search.export.brackets import printed_parts
from topo_search.export.mjcf import mjcf
from topo_search.export.tree_drawing import tree_svg
from topo_search.export.urdf import urdf
from topo_search.model import BadInput, Design, Geometry, Task, Topology
from topo_search.model.files import to_json, validate
from topo_search.model.task_file import read_task
from topo_search.report import design_part, view
from topo_search.study.proving import refuse_unprovable
from topo_search.study.request import Request
from topo_search.topologies import candidates
from topo_search.topologies.lattices import Lattices, lattices
from topo_search.topologies.own_topologies import own_candidates
from verify import audit
from verify.flight.joints import children_in_cycles
from verify.kinematics import platform

FIXED = [1, 2, 6, 19, 63, 216, 760, 2725]
"""OEIS A001168."""
ONE_SIDED = [1, 1, 2, 7, 18, 60, 196, 704]
"""OEIS A000988."""
FREE = [1, 1, 2, 5, 12, 35, 108, 369]
"""OEIS A000105."""
SQUARE, FLAG = "f3400", "f70400"
"""Four modules around a point; the same with a fifth beside it."""
JOINT = 0.03
"""Mass of a joint [kg]."""


def hovering(n: int, **search: Any) -> Task:
    """A task that a flat lattice can do."""
    return Task(
        name="flat",
        modules=n,
        module={"joint_mass": JOINT, "torque_coefficient": 1.06e-8},
        load_cases=[HOVER, {"end_effector": {"force": [0.0, 0.0, 0.2]}, "com": {"force": [0.0, 0.0, 0.9]}}],
        search={"lattice": "flat", "interference": "parts", **search},
        flight={"defaults": False},
        end_effector={"rod": "none", "largest_reach": False},
    )


@pytest.fixture(scope="module")
def flag() -> Design:
    """A design of five modules, four of them in a cycle."""
    task = hovering(5).resolve(5)
    design = BACKENDS.solve(Job(task, Topology.from_key(FLAG), range(4), 0))
    assert isinstance(design, Design)
    return design


@pytest.mark.parametrize(("symmetry", "expected"), [("none", FIXED), ("c4", ONE_SIDED), ("d4", FREE)])
def test_there_are_as_many_lattices_as_polyominoes(symmetry, expected) -> None:
    for n, count in enumerate(expected, start=1):
        family = Lattices(n, symmetry=symmetry)
        listed = list(family.candidates())
        assert len(listed) == family.count() == count
        assert sum(candidate.orbit for candidate in listed) == FIXED[n - 1]
        assert [candidate.key for candidate in listed] == sorted({candidate.key for candidate in listed})


def test_lattices_are_the_flat_trees_without_overlaps() -> None:
    """Brute force: every fixed polyomino is the flat placement of some tree, and all its neighbours are bolted."""
    for n in range(1, 6):
        placed = Counter[frozenset[tuple[int, int]]]()
        for rooted in candidates(n, symmetry="none", root="paper"):
            try:
                cells = rooted.topology.cells
            except ValueError:
                continue
            left, low = (min(cell[axis] for cell in cells) for axis in (0, 1))
            placed[frozenset((x - left, y - low) for x, y in cells)] += 1
        listed = [candidate.topology for candidate in lattices(n, "c1")]
        assert len(listed) == len(placed) == FIXED[n - 1]
        for lattice in listed:
            beside = [abs(x - u) + abs(y - v) == 1 for x, y in lattice.cells for u, v in lattice.cells]
            assert len(lattice.bolted) == sum(beside) // 2
    cycles = {n: sum(bool(c.topology.closures) for c in lattices(n, "c1")) for n in (3, 4, 5, 6)}
    assert cycles == {3: 0, 4: 1, 5: 8, 6: 42}


def test_a_key_alone_builds_the_lattice_and_any_spanning_tree_names_it() -> None:
    random = Random(3)
    for candidate in lattices(6, "c2"):
        lattice = Topology.from_key(candidate.key)
        assert lattice.key == candidate.key
        assert candidate.key.startswith("f") == bool(lattice.closures)
        graph = nx.Graph()
        for h, a, i, b in random.sample(lattice.bolts, len(lattice.bolts)):
            graph.add_edge(h, i, ports={h: a, i: b}, weight=random.random())
        tree = nx.minimum_spanning_tree(graph)
        other = Topology.from_graph(tree).closed
        assert len(other.bolts) == len(lattice.bolts)
        assert Lattices(6, symmetry="c2").candidate_of(other) == candidate


@pytest.mark.parametrize(
    ("key", "rule"),
    [
        ("f1220", "not canonical: the same tree has the key 'a1220'"),
        ("f11110", "must be apart"),
        ("fp00", "hexadecimal"),
    ],
)
def test_keys_of_no_lattice_are_refused(key, rule) -> None:
    with pytest.raises(ValueError, match=rule):
        Topology.from_key(key)


@pytest.mark.parametrize(
    ("settings", "path"),
    [
        (("search.hinge_step_deg=15",), "search.hinge_step_deg"),
        (("search.hinge_angles_deg=[0,30]",), "search.hinge_angles_deg"),
        (("search.connectors=any",), "search.connectors"),
        (("search.interference=airflow",), "search.interference"),
        (("flight.joint_moment=3.0",), "flight.joint_moment"),
        (("module.bracket={}",), "module.bracket"),
        (("modules=[2,11]",), "modules"),
        (("module.arm_length=0.145",), "search.lattice"),
    ],
)
def test_what_flat_lattices_cannot_have_is_refused(settings, path) -> None:
    flat = ("search.lattice=flat", "search.interference=parts")
    with pytest.raises(BadInput) as refused:
        read_task("push", (*flat, *settings))
    assert path in [fault.path for fault in refused.value.faults]


def test_candidates_follow_the_symmetry_of_module_and_task() -> None:
    """A half turn of all leaves a free platform as it is, but not one of a given attitude."""

    def request(**search: Any) -> Request:
        return Request(hovering(4, **search), "task", starts=1, seed=0)

    assert request().space(4).count() == Lattices(4, symmetry="d2").count() == 9
    level = request(root_orientation_deg=[0.0, 0.0, 0.0])
    assert level.space(4).count() == 19
    assert level.quotient(4).exact
    assert level.covers(4)
    with pytest.raises(ValueError, match=r"search\.lattice"):
        Request(hovering(4), "task", starts=1, seed=0, strategy="optuna")
    with pytest.raises(BadInput, match=r"search\.lattice"):
        refuse_unprovable(request(), "flat")


def test_listed_lattices_must_be_closed_and_trees_must_not() -> None:
    flat, trees = hovering(4), hovering(4).replace(search={"interference": "parts"})
    assert own_candidates([SQUARE, "a7000"], flat) == ("a7000", SQUARE)
    with pytest.raises(BadInput, match="must have all neighbours bolted together"):
        own_candidates([Topology(Topology.from_key(SQUARE).joints)], flat)
    with pytest.raises(BadInput, match=r"needs search\.lattice"):
        own_candidates([SQUARE], trees)


def test_joints_that_close_cycles_have_mass(flag) -> None:
    """Centre of mass and inertia of modules and five joints, by hand."""
    task, module = flag.task, flag.task.module
    assert flag.closures == flag.topology.closures
    assert len(flag.topology.bolts) == 5
    assert task.total_mass(5) == pytest.approx(5 * module.mass + 5 * JOINT + task.end_effector.mass)
    assert task.lightest.total_mass(5) == pytest.approx(task.total_mass(5) - JOINT)
    assert task.load_cases[0].at_com.force[2] == pytest.approx(task.force_unit(5))
    placed, l_c = platform(flag), module.connector_distance
    flat = 2 * l_c * np.array([(*cell, 0.0) for cell in flag.topology.cells]) @ placed.R[0].T
    assert placed.p == pytest.approx(flat, abs=1e-12)
    ends = [(flat[h] + flat[i]) / 2 for h, _, i, _ in flag.topology.bolts]
    moment = module.mass * flat.sum(axis=0) + JOINT * np.sum(ends, axis=0)
    moment += task.end_effector.mass * np.array(flag.end_effector_m)
    assert placed.p_com == pytest.approx(moment / task.total_mass(5), abs=1e-12)
    assert Point.of(flag).p_COM == pytest.approx(placed.p_com, abs=1e-12)


def test_a_lattice_is_audited_with_its_cycle(flag) -> None:
    result = audit(flag)
    assert result.verdict == "clear"
    bolted = {(contact.a, contact.b) for contact in result.allowed_contacts}
    assert {(h, i) for h, _, i, _ in flag.topology.bolts} <= bolted
    assert len(result.assembly.joints) == 5
    turned = flag.model_copy(update={"hinge_angles_rad": (1e-3, *flag.hinge_angles_rad[1:])})
    assert "hinge angle of module 1 against the task's set" in failing(audit(turned))
    heavier = flag.model_copy(update={"task": flag.task.with_closures(0)})
    assert audit(heavier).verdict == "violated"


def test_loads_of_joints_in_cycles_are_left_out_and_said_to_be(flag) -> None:
    """The load of the only joint outside of the cycle is that of its module alone, a free body."""
    result = audit(flag)
    assert result.flight is not None
    cases = [case.name for case in result.flight.cases]
    (outside,) = set(range(1, 5)) - children_in_cycles(flag.topology)
    assert [(load.case, load.child) for load in result.flight.joints] == [(name, outside) for name in cases]
    assert result.flight.joints_in_cycles == 4
    assert any("4 joints of cycles" in line for line in flight_lines(result.flight))
    h, degrees = flag.topology.parents[outside], Counter(j for pair in flag.topology.bolted for j in pair)
    assert degrees[outside] == 1
    load = next(load for load in result.flight.joints if load.case == flag.task.case_labels[0])
    thrust = flag.task.module.thrust_coefficient * flag.inputs[0, outside].sum()
    weight, tip = (mass * flag.task.gravity for mass in (flag.task.module.mass, flag.task.end_effector.mass))
    holder = None if result.assembly.mount is None else result.assembly.mount.module
    sides = [weight] * (holder != outside) + [weight + tip] * (holder in (None, outside))
    assert load.module == h
    assert load.force_N == pytest.approx(max(abs(thrust - side) for side in sides), abs=1e-6)


def test_design_files_list_closures_which_other_programs_may_leave_out(flag) -> None:
    content = json.loads(to_json(flag))
    assert content["closures"] == [list(bolt) for bolt in flag.topology.closures]
    assert validate(Design, content, "design") == flag
    bare = {name: value for name, value in content.items() if name != "closures"}
    assert validate(Design, bare, "design") == flag
    for change in (
        {"closures": [[0, 0, 4, 2]]},
        {"topology": [[-1, -1, -1], [0, 0, 2], [1, 0, 2], [2, 0, 2], [3, 0, 2]], "closures": []},
        {"task": {**content["task"], "search": {**content["task"]["search"], "closures": 3}}},
    ):
        with pytest.raises(BadInput, match="closures"):
            validate(Geometry, {**content, **change}, "design")


def test_exports_weld_the_modules_without_a_loop(flag) -> None:
    total = flag.task.total_mass(5)
    model = mujoco.MjModel.from_xml_string(mjcf(flag))
    assert model.body_subtreemass[1] == pytest.approx(total, rel=1e-6)
    assert (model.njnt, model.neq) == (1, 0)
    robot = ElementTree.fromstring(urdf(flag))
    assert sum(float(mass.attrib["value"]) for mass in robot.iter("mass")) == pytest.approx(total)
    links, joints = robot.findall("link"), robot.findall("joint")
    assert len(links) == len(joints) + 1
    with pytest.raises(BadInput, match="tree"):
        printed_parts(flag)


def test_pages_and_pictures_show_all_joints(flag) -> None:
    drawn = ElementTree.fromstring(tree_svg(flag))
    assert sum(shape.tag.endswith("line") for shape in drawn) == 5
    assert len(design_part.joints(flag).rows) == 5
    steps = view._steps(flag, None)
    i, _, j, _ = flag.topology.closures[0]
    assert len(steps) == 6
    assert steps[j].count("port") == 4
    assert f"of module {i}" in steps[j]


def test_a_lattice_is_a_start_for_another(flag) -> None:
    task = hovering(5).resolve(5)
    other = BACKENDS.solve(Job(task, Topology.from_key("f74000"), range(0), 0, (flag,)))
    same = BACKENDS.solve(Job(task, Topology.from_key(FLAG), range(0), 0, (flag,)))
    assert isinstance(other, Design)
    assert isinstance(same, Design)
    assert same.objective == pytest.approx(flag.objective, rel=1e-5)


def test_what_hangs_flat_has_an_angle_of_plain_zero(flag) -> None:
    assert [math.copysign(1.0, angle) for angle in flag.hinge_angles_rad] == [1.0] * 4


def test_positions_on_the_grid() -> None:
    for candidate in lattices(5, "c1"):
        cells = candidate.topology.cells
        joined = nx.Graph(list(candidate.topology.bolted))
        assert nx.is_connected(joined)
        assert len(set(cells)) == 5
        for (h, i), (j, k) in pairwise(sorted(candidate.topology.bolted)):
            assert abs(np.subtract(cells[h], cells[i])).sum() == abs(np.subtract(cells[j], cells[k])).sum() == 1


def test_a_flat_lattice_of_parallel_rotors_is_known_to_thrust_one_way() -> None:
    sideways = [HOVER, {"com": {"force": [0.3, 0.0, 1.0]}}]
    task = hovering(4).replace(load_cases=sideways)
    proof = prove_impossible(task.resolve(4))
    assert proof is not None
    assert proof.message.startswith("a flat lattice thrusts along one axis")
    assert prove_impossible(task.replace(search={"interference": "parts"}).resolve(4)) is None


def test_bounds_hold_for_lattices_whose_joints_are_heavy(flag) -> None:
    """Loads grow with the closures, so a bound for the lightest lattice need not hold for the others."""
    task = flag.task.lightest
    most = max(len(candidate.topology.closures) for candidate in lattices(5, "c1"))
    assert task.heaviest_closures == pytest.approx(most * JOINT)
    for n in range(1, 9):
        closures = max(len(candidate.topology.closures) for candidate in lattices(n, "c1"))
        assert hovering(n).resolve(n).heaviest_closures == pytest.approx(closures * JOINT)
    pulled_down = (
        hovering(5)
        .replace(load_cases=[{"carries_weight": True, "units": "SI", "com": {"force": [0.0, 0.0, -20.0]}}])
        .resolve(5)
    )
    heavier = pulled_down.with_closures(most)
    forces = [abs(one.load_cases[0].at_com.force[2]) for one in (pulled_down, heavier)]
    assert forces[1] < forces[0]
    assert lower_bound(pulled_down) <= lower_bound(heavier) * (1 + 1e-9)
