"""The assembly sheet: joints in bolting order, the rod, and the table that goes to the workshop."""

import csv
import io
import math

import pytest
from verify_cases import design, fan

from topo_search.model import Topology
from verify import audit

BRANCHED = Topology(((-1, -1, -1), (0, 1, 3), (1, 0, 2), (0, 2, 1), (2, 1, 3)))


def test_every_module_is_bolted_to_one_that_is_already_there():
    sheet = audit(design(BRANCHED, {}, hinges=(0.1, -0.2, 0.3, -0.4))).assembly
    there = {0}
    for joint in sheet.joints:
        assert joint.module in there
        assert joint.child not in there
        there.add(joint.child)
    assert there == set(range(5))
    found = [(joint.module, joint.port, joint.child, joint.child_port) for joint in sheet.joints]
    assert found == [(h, a, i, b) for h, i, a, b in BRANCHED.edges()]
    assert [joint.angle_deg for joint in sheet.joints] == pytest.approx(
        [math.degrees(alpha) for alpha in (0.1, -0.2, 0.3, -0.4)]
    )


def test_the_table_holds_the_same_joints_and_the_rod_as_its_last_step():
    result = audit(fan())
    rows = list(csv.DictReader(io.StringIO(result.assembly.csv())))
    assert [row["step"] for row in rows] == ["1", "2", "3"]
    for row, joint in zip(rows, result.assembly.joints, strict=False):
        assert (int(row["module"]), int(row["port"])) == (joint.module, joint.port)
        assert (int(row["child"]), int(row["child_port"])) == (joint.child, joint.child_port)
        assert float(row["angle_deg"]) == joint.angle_deg
    tip = result.assembly.end_effector
    last = rows[-1]
    assert (int(last["module"]), int(last["port"]), last["child"]) == (
        tip.mount.module,
        tip.mount.port,
        "end-effector",
    )
    assert float(last["rod_length_m"]) == tip.rod.length_m
    assert tuple(float(last[f"rod_{axis}"]) for axis in "xyz") == tip.rod.direction_in_module


def test_positions_beyond_all_digits_leave_the_mount_open():
    result = audit(fan(end_effector=(1e100, 0.0, 0.0)))
    tip = result.assembly.end_effector
    assert (tip.mount, tip.rod, tip.connectors) == (None, None, ())
    assert "too large" in tip.note


@pytest.mark.parametrize(("away", "told"), [(0.6, False), (20.0, True)])
def test_a_rod_far_longer_than_the_platform_is_wide_is_told(away, told):
    tip = audit(fan(end_effector=(0.0, 0.0, away))).assembly.end_effector
    assert (tip.note is not None) == told
    if told:
        assert tip.note.startswith(f"the rod is {tip.rod.length_m:.3g} m long, ")


def test_a_rod_of_five_percent_of_the_mass_is_told_with_what_it_weighs():
    given = fan({"end_effector": {"rod_linear_density": 0.5}}, end_effector=(0.3, 0.4, 0.3))
    found = audit(given)
    rod, p_E = found.assembly.end_effector.rod, found.assembly.end_effector.from_com_m
    share = rod.mass_kg / (3 * 0.24 + 0.048)
    assert found.flight.rod_mass_share == share > 0.05
    middle = [x - rod.length_m / 2 * d for x, d in zip(p_E, rod.direction, strict=True)]
    weight = 9.81 * rod.mass_kg
    told = f"the rod, {100 * share:.3g} % of the platform's mass, is left out of the model: {weight:.3g} N"
    assert f"{told}, and {weight * math.hypot(*middle[:2]):.3g} N m about the centre of mass" in (
        found.assembly.end_effector.note
    )
    light = fan({"end_effector": {"rod_linear_density": 0.01}}, end_effector=(0.3, 0.4, 0.3))
    assert audit(light).assembly.end_effector.note is None
