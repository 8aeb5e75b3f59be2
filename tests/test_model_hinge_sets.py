"""Sets of hinge angles in a task: what they mean, what is refused, and that tasks without one stay as they are."""

import math

import numpy as np
import pytest

from nlp.numbers.geometry import fold_excess, nearest_angles, ranges, turns
from topo_search.model import BadInput, Topology
from topo_search.model.files import read_task, to_toml
from topo_search.model.task_warnings import task_warnings
from topo_search.study.relaxing import relaxable

TREE = Topology.from_key("a300")


def of(*settings: str):
    return read_task("push", ("modules=3", *(f"search.{each}" for each in settings)))


def test_a_step_means_its_multiples_and_a_list_is_turned_either_way():
    assert of("hinge_step_deg=30").search.hinge_set_deg == (-90, -60, -30, 0, 30, 60, 90)
    assert of("hinge_step_deg=35").search.hinge_set_deg == (-70, -35, 0, 35, 70)
    assert max(of("hinge_step_deg=0.9").search.hinge_set_deg or ()) == 90
    assert of("hinge_angles_deg=[45, 0, 30]").search.hinge_set_deg == (-45, -30, 0, 30, 45)
    assert of("hinge_angles_deg=[90]").search.hinge_set_deg == (-90, 90)
    assert to_toml(of("hinge_angles_deg=[-0.0]")) == to_toml(of("hinge_angles_deg=[0]"))


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("hinge_step_deg=0", "hinge_step_deg: must be at least 0.1"),
        ("hinge_step_deg=180", "hinge_step_deg: must be at most 90"),
        ("hinge_angles_deg=[0, 180]", r"hinge_angles_deg\[1\]: must be at most 90, but got 180"),
        ("hinge_angles_deg=[0, -30]", r"hinge_angles_deg\[1\]: must be at least 0, but got -30"),
        ("hinge_angles_deg=[30, 30]", "must differ by 0.1 deg or more"),
        (
            "hinge_angles_deg=[30, 0, 30.000000001]",
            r"must differ by 0.1 deg or more, but got \[30.0, 30.000000001\]",
        ),
        ("hinge_angles_deg=[]", "must have at least one entry"),
    ],
)
def test_a_set_that_no_drawer_holds_is_refused(setting, words):
    with pytest.raises(BadInput, match=words):
        of(setting)


def test_a_set_beside_a_step_or_outside_what_rotors_leave_is_refused():
    with pytest.raises(BadInput, match="must be left out where hinge_angles_deg is given, but got 15"):
        of("hinge_step_deg=15", "hinge_angles_deg=[0]")
    tall = "module.body.rotor_radius=0.075"
    assert math.degrees(read_task("push", (tall,)).folds(1e-4)[0][1]) < 85
    with pytest.raises(BadInput, match="must have an angle that keeps rotors clear of a neighbour, at most"):
        read_task("push", (tall, "search.hinge_angles_deg=[85, 90]"))
    task = read_task("push", (tall, "search.hinge_angles_deg=[20, 90]")).resolve(3)
    assert turns(task, 1e-4) == ((-math.radians(20),) * 2, (math.radians(20),) * 2)
    warned = {
        each.path: each.words for each in task_warnings(read_task("push", (tall, "search.hinge_step_deg=15")))
    }
    assert "6 of 13 angles, -90, -75, -60, 60, ... deg, are beyond" in warned["search.hinge_step_deg"]
    assert "search.hinge_step_deg" not in {each.path for each in task_warnings(of("hinge_step_deg=15"))}


def test_a_step_is_written_and_any_angle_is_a_task_without_it():
    assert "hinge_step_deg = 15" in to_toml(of("hinge_step_deg=15"))
    assert of("hinge_step_deg=15").search.any_angle == read_task("push").search


def test_a_task_without_a_design_is_told_to_leave_the_set_out():
    for setting in ("hinge_step_deg=15", "hinge_angles_deg=[0]"):
        limits = {each.limit: each for each in relaxable(of(setting), 3)}
        freed = limits["set of hinge angles"]
        assert freed.field == f"search.{setting.partition('=')[0]} left out"
        assert freed.relaxed(freed.most) == read_task("push", ("modules=3",))
    assert "set of hinge angles" not in {each.limit for each in relaxable(read_task("push"), 3)}


def test_the_solver_holds_hinges_to_the_nearest_angle_bit_by_bit():
    task = of("hinge_step_deg=10").resolve(3)
    near = nearest_angles(task, TREE, [0.52, -1.6])
    assert near.tolist() == [math.radians(30), -math.radians(90)]
    assert ranges(task, TREE, near) == (near.tolist(), near.tolist())
    assert fold_excess(task, TREE, near).tolist() == [0.0, 0.0]
    assert fold_excess(task, TREE, np.nextafter(near, 2.0)).max() > 0
