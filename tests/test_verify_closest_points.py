"""Where an audit says that two sides come closest: on both, and as far apart as they are, by other formulas."""

import math
from typing import Any

import numpy as np
import pytest
from verify_cases import FREE_ABOVE, Array, fan

from topo_search.model import Audit, Clearance, Design, Status
from verify import audit, poses

WALL = {"kind": "local", "box": [1.2, 1.2, 0.1], "solid": True}
CONE = {"kind": "exterior", "half_angle_deg": 80.0, "solid": True}
EXPOSED = ("local", "directional", "exterior")
NO_GAP = ("separation", "exclusion")
"""Their clearances are what is left of a distance."""


def outside(given: Design, i: int, x: Array) -> float:
    """How far x is from the envelope of module i [m]; negative inside: the least over many balls."""
    R, p = poses(given.topology, given.root_orientation_rad, given.hinge_angles_rad, 0.15)
    envelope = given.task.module.envelope
    eta = np.linspace(0.0, 1.0, 20001)
    balls = p[i] - eta[:, None] * envelope.length * R[i][:, 2]
    radii = envelope.start_radius + eta * envelope.growth
    return float(np.min(np.linalg.norm(x - balls, axis=1) - radii))


def rows(found: Audit, *kinds: str) -> list[Clearance]:
    return [pair for pair in found.pairs if pair.kind in kinds]


@pytest.fixture(scope="module")
def audited() -> list[tuple[Design, Audit]]:
    """Platforms that lean outwards, which are clear, and inwards, whose airflow overlaps."""
    asked: dict[str, Any] = {"exposure": [*FREE_ABOVE, WALL, CONE], "module": {"bracket": {}}}
    given = [fan(asked, hinges=hinges, root=(0.3, 0.1, -0.2)) for hinges in ((-0.6, 0.6), (0.5, -0.5))]
    return [(one, audit(one)) for one in given]


def test_they_are_as_far_apart_as_the_clearance(audited: list[tuple[Design, Audit]]) -> None:
    seen = set()
    for _, found in audited:
        for pair in found.pairs:
            assert pair.closest_m is not None
            apart = math.dist(*pair.closest_m)
            if pair.kind in NO_GAP:
                assert apart > pair.analytic_m
            elif pair.analytic_m > 0:
                assert apart == pytest.approx(pair.analytic_m, abs=1e-8)
                assert apart == pytest.approx(pair.upper_m, abs=1e-8)
                seen.add(pair.kind)
            elif pair.kind not in (*EXPOSED, "part-region", "rod-region"):
                assert apart == pytest.approx(0.0, abs=1e-12)
    assert seen >= {*EXPOSED, "airflow", "body", "rod", "rotor-airflow", "bracket-airflow", "bracket-rotor"}
    assert seen >= {"part-region", "rod-airflow"}


def test_they_lie_on_the_airflow_or_inside_of_two(audited: list[tuple[Design, Audit]]) -> None:
    statuses = set()
    for given, found in audited:
        for pair in rows(found, "airflow"):
            for i, x in zip((pair.a, pair.b), pair.closest_m or (), strict=True):
                depth = -outside(given, i, np.array(x))
                assert depth > 0 if pair.analytic_m < 0 else depth == pytest.approx(0.0, abs=1e-6)
            statuses.add(pair.status)
        for pair in rows(found, "rotor-airflow", "rod-airflow"):
            _, x = pair.closest_m or ()
            if pair.analytic_m > 0:
                assert outside(given, pair.b, np.array(x)) == pytest.approx(0.0, abs=1e-6)
            else:
                assert outside(given, pair.b, np.array(x)) < 0
        for pair in rows(found, *EXPOSED):
            x, _ = pair.closest_m or ()
            assert outside(given, pair.a, np.array(x)) < 1e-6
    assert statuses == {Status.CLEAR, Status.VIOLATED}


def test_a_distance_is_marked_by_its_places(audited: list[tuple[Design, Audit]]) -> None:
    for given, found in audited:
        p = poses(given.topology, given.root_orientation_rad, given.hinge_angles_rad, 0.15).p
        for pair in rows(found, *NO_GAP):
            b = given.end_effector_m if pair.b < 0 else p[pair.b]
            np.testing.assert_allclose(pair.closest_m, [p[pair.a], b], rtol=0, atol=1e-14)
        assert rows(found, *NO_GAP)


def test_where_digits_are_lost_nothing_is_told() -> None:
    lost = audit(fan({"exposure": FREE_ABOVE}, end_effector=(1e9, 0.0, 0.0)))
    told = [pair for pair in lost.pairs if pair.status is Status.UNDECIDED and pair.kind not in NO_GAP]
    assert told
    assert {pair.closest_m for pair in told} == {None}
