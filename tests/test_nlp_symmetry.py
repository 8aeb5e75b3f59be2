"""What must not change the best design of a tree, and what may: turns, mirrors, labels, units, stronger rotors.

The trees are chosen so that about two in five starts reach the best design; STARTS of them miss it once in 500.
"""

import copy
import itertools
import math

import numpy as np
import pytest
from nlp_cases import FEATURES, GENTLE_PUSH, PATH, best_design, push
from older import older_task
from suites import few

from nlp import lower_bound
from nlp.bounds.branch.arrays import reroot
from topo_search.model import Topology

STARTS = 12
SAME = 1e-6
"""Relative difference of two optima that are one."""
TREE = Topology.from_key("a71000")


def best(task, topology=TREE, seed=0):
    """The least effort found, over the bound that holds for all topologies."""
    design = best_design(task, topology, STARTS, seed)
    return design.objective / lower_bound(task)


def relabelled(topology, port_of):
    """The tree with every port renamed; `port_of(module, port)` gives the new name."""
    joints = [(h, port_of(h, a), port_of(i, b)) for h, i, a, b in topology.edges()]
    return Topology(((-1, -1, -1), *joints))


def mirrored(topology):
    """The tree seen in a mirror across the x axis: the ports +y and -y change places."""
    return relabelled(topology, lambda _, port: (0, 3, 2, 1)[port])


def turned(task, angle):
    """The task turned about the vertical: wrenches, paths and axes."""
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    data = copy.deepcopy(task.model_dump(mode="json"))

    def turn(table, name):
        table[name] = (R @ table[name]).tolist()

    for case in data["load_cases"]:
        for where in ("end_effector", "com"):
            for name in ("force", "torque"):
                if case[where] is not None:
                    turn(case[where], name)
    for requirement in data["exposure"]:
        if requirement.get("segments"):
            requirement["segments"] = [(R @ segment).tolist() for segment in requirement["segments"]]
        if isinstance(requirement.get("axis"), list):
            turn(requirement, "axis")
    if isinstance(data["end_effector"]["position"], list):
        turn(data["end_effector"], "position")
    return older_task(data).resolve(task.n)


@pytest.mark.parametrize(
    "fields",
    [
        FEATURES["one path"],
        pytest.param(FEATURES["half-space with a fixed axis"], marks=pytest.mark.slow),
        {"end_effector": {"position": [0.0, 0.2, 0.4]}, "load_cases": GENTLE_PUSH},
    ],
    ids=["one path", "half-space with a fixed axis", "fixed end-effector"],
)
def test_turning_the_whole_task_about_the_vertical_changes_nothing(fields):
    task = push(5, **fields)
    other = turned(task, math.radians(37.0))
    assert lower_bound(other) == pytest.approx(lower_bound(task), rel=1e-12)
    assert best(other) == pytest.approx(best(task), rel=SAME)


@pytest.mark.parametrize("key", few(["a71000", "a11420"], 1))
def test_the_root_of_a_tree_is_arbitrary(key):
    topology, task = Topology.from_key(key), push(5)
    efforts = [best(task, reroot(topology, root)) for root in range(5)]
    assert efforts == pytest.approx([efforts[0]] * 5, rel=SAME)


def test_a_half_turn_of_the_port_labels_changes_nothing():
    """Of all modules, of the root alone, of a leaf alone."""
    task = push(5, search={"connectors": "any"})
    efforts = [
        best(task, relabelled(TREE, lambda i, port, which=which: (port + 2) % 4 if i in which else port))
        for which in ((), range(5), (0,), (4,))
    ]
    assert efforts == pytest.approx([efforts[0]] * 4, rel=SAME)


def test_a_mirror_pair_has_one_optimum_on_push_and_two_on_a_path():
    """Exchanging x and y maps the push task onto itself, but not a path along x."""
    other = mirrored(TREE)
    assert other.key not in {reroot(TREE, root).key for root in range(5)}
    assert best(push(5), other) == pytest.approx(best(push(5)), rel=SAME)
    along_x, along_y = (
        push(5, exposure=[{**PATH, "segments": [segment]}]) for segment in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    )
    assert abs(best(along_x, other) / best(along_x) - 1) > 1e-3
    # and what tells the two apart is the path: exchanged too, it maps one onto the other
    assert best(along_y, other) == pytest.approx(best(along_x), rel=SAME)


@pytest.mark.parametrize("scale", few([0.3, 4.0], 1))
def test_scaling_all_lengths_changes_nothing(scale):
    """Drag torque over lift torque, k_tau / (k_f l_arm), is kept too."""
    task = push(5, exposure=[PATH])
    data = task.model_dump(mode="json")
    module, search = data["module"], data["search"]
    for name in ("arm_length", "connector_distance", "torque_coefficient"):
        module[name] *= scale
    for name in ("start_radius", "reach"):
        module["airflow"][name] *= scale
    body = module["body"]
    for name in ("rotor_radius", "rotor_height", "arm_width"):
        body[name] *= scale
    body["hub"] = [scale * x for x in body["hub"]]
    for name in ("margin", "separation", "body_clearance"):
        search[name] *= scale
    for case in data["load_cases"]:
        for where in ("end_effector", "com"):
            if case[where] is not None:
                case[where]["torque"] = [scale * x for x in case[where]["torque"]]
    (path,) = data["exposure"]
    path["radius"] *= scale
    path["segments"] = [[scale * x for x in segment] for segment in path["segments"]]
    assert best(older_task(data).resolve(5)) == pytest.approx(best(task), rel=SAME)


@pytest.mark.parametrize("scale", few([0.02, 30.0], 1))
def test_scaling_all_forces_changes_nothing(scale):
    """Heavier platforms, gravity on another planet, stronger rotors: efforts keep their ratio to the bound."""
    task = push(5)
    module, mass = task.module, task.end_effector.mass
    heavy = push(5, module={"mass": scale * module.mass}, end_effector={"mass": scale * mass})
    planet = push(5, gravity=scale * task.gravity)
    rotors = {name: scale * getattr(module, name) for name in ("thrust_coefficient", "torque_coefficient")}
    assert [best(heavy), best(planet), best(push(5, module=rotors))] == pytest.approx([best(task)] * 3, rel=SAME)


def test_stronger_rotors_never_hurt():
    """A larger u_max only adds designs; where no input is at its limit it changes nothing."""
    efforts = [best(push(5, module={"max_thrust_to_weight": ratio})) for ratio in (2.1, 2.5, 3.0, 50.0)]
    for weaker, stronger in itertools.pairwise(efforts[:3]):
        assert stronger < weaker * (1 - 1e-3)
    assert efforts[3] == pytest.approx(efforts[2], rel=SAME)
