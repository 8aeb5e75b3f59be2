"""What is said of a design's place at its target: a rod that pulls, rotors near a solid half-space."""

import math
from typing import Any

import pytest
from verify_cases import HOVER, design

from topo_search.model import Audit, Topology
from verify import audit

ONE = Topology.from_key("a0")
ROD = {"rod": "straight", "largest_reach": False}


def judged(height: float, force: tuple[float, float, float], **fields: Any) -> Audit:
    """The audit of a level module whose rod leads up from a connector to a tip above its centre."""
    case = {"name": "touch", "carries_weight": True, "end_effector": {"force": force}, **fields}
    task = {"load_cases": [case, HOVER], "end_effector": ROD}
    return audit(design(ONE, task, hinges=(), end_effector=(0.0, 0.0, height)))


def test_a_rod_that_pulls_where_the_task_pushes_is_said_with_its_angle() -> None:
    place = judged(0.6, (0.0, 0.0, -0.1)).placement
    assert place is not None
    (case,) = place.pulling
    assert case.name == "load case 0 (touch)"
    assert case.angle_deg == pytest.approx(180 - math.degrees(math.atan2(0.15, 0.6)))
    (sentence,) = place.sentences()
    assert "the rod pulls" in sentence
    assert "165 deg in load case 0 (touch)" in sentence
    assert judged(0.6, (0.0, 0.0, 0.1)).placement is None


def test_a_pull_that_the_task_asks_for_is_not_said() -> None:
    assert judged(0.6, (0.0, 0.0, -0.1), contact="pull").placement is None
    pushed = judged(0.6, (0.0, 0.0, -0.1), contact="push").placement
    assert pushed is not None
    assert pushed.pulling


def test_rotors_within_three_radii_of_a_solid_half_space_are_said() -> None:
    place = judged(0.149, (0.0, 0.0, 0.1), contact="push").placement
    assert place is not None
    (wall,) = place.near
    assert wall.rotors == 4
    assert wall.distance_m == pytest.approx(0.149)
    assert wall.radii == pytest.approx(2.98)
    assert "object of load case 0" in wall.name
    assert "2.98 radii" in next(place.sentences())
    assert judged(0.151, (0.0, 0.0, 0.1), contact="push").placement is None
