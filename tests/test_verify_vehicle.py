"""Capability of any vehicle, against published truths and the audit's figures of a design."""

import json
import math
import re
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from scipy.spatial import ConvexHull
from vehicle_cases import HEXACOPTERS, hexacopter, omnicopter, rotor, star

from topo_search.export.allocation import allocation
from topo_search.export.audits import forces_without_torque
from topo_search.model import Design
from topo_search.model.files import read_json
from topo_search.model.vehicle import Vehicle, read_vehicle
from topo_search.report.design_page import vehicle_page
from verify import audit
from verify.flight.vehicle import capability, rotor_map
from verify.kinematics import platform

SPOILT = ("x_m,y_m,z_m,ax,ay,az,spin,k_f,k_tau,u_max\n0,0,0,0,0,0,2,1,0,1\n", "spin")


@pytest.mark.parametrize("tilt_deg", [30.0, 54.735610317245346, 70.0])
def test_the_star_shaped_hexarotor_has_the_volume_of_its_formula(tilt_deg: float) -> None:
    """12 sqrt(3) c s^2 (arXiv 2408.12294): 4.5 at 30 and, the most, 8 at 54.74 degrees."""
    tilt = math.radians(tilt_deg)
    found = capability(star(tilt))
    volume = 12 * math.sqrt(3) * math.cos(tilt) * math.sin(tilt) ** 2
    assert (found.rank, found.zero_torque_volume_N3) == (6, pytest.approx(volume, rel=1e-9))
    assert found.zero_torque_ball_N == 0  # no rotor can pull down


@pytest.mark.parametrize(("drag", "ball"), [(0.0, 2 * math.sqrt(8 / 3)), (0.05, 2.9330)])
def test_the_omnicopter_exerts_any_force_without_torque(drag: float, ball: float) -> None:
    vehicle = omnicopter(drag)
    F = rotor_map(vehicle)[:3]
    np.testing.assert_allclose(F @ F.T, 8 / 3 * np.eye(3), atol=1e-12)
    assert capability(vehicle).zero_torque_ball_N == pytest.approx(ball, abs=1e-4 if drag else 2e-6)


@pytest.mark.parametrize("seed", range(4))
def test_forces_without_torque_are_those_of_all_vertices(seed: int) -> None:
    """Every vertex of {u : T u = 0} has three inputs within their limits: all of them, one by one."""
    rng = np.random.default_rng(seed)
    places, axes = rng.normal(size=(7, 3)), rng.normal(size=(7, 3)) + np.array([0.0, 0.0, 1.5])
    drawn = [rotor(r, a, k_tau=0.1) for r, a in zip(places, axes, strict=True)]
    vehicle = Vehicle(rotors=[one | {"u_min": -0.4, "spin": int(rng.choice([-1, 1]))} for one in drawn])
    found, A = capability(vehicle), rotor_map(vehicle)
    forces = []
    for free in combinations(range(7), 3):
        held = [j for j in range(7) if j not in free]
        for limits in product((-0.4, 1.0), repeat=4):
            u = np.zeros(7)
            u[held] = limits
            u[list(free)] = np.linalg.solve(A[3:, free], -A[3:, held] @ limits)
            if np.all(u >= -0.4 - 1e-9) and np.all(u <= 1 + 1e-9):
                forces.append(A[:3] @ u)
    hull = ConvexHull(forces)
    assert found.zero_torque_volume_N3 == pytest.approx(hull.volume, rel=1e-6)
    assert found.zero_torque_ball_N == pytest.approx(max(0.0, -hull.equations[:, 3].max()), abs=1e-5)


def test_a_flat_lattice_pulls_up_alone() -> None:
    vehicle = Vehicle(rotors=[rotor([x, y, 0], [0, 0, 1], k_tau=0.01) for x in (0, 1, 2) for y in (0, 1)])
    found = capability(vehicle.model_copy(update={"com": (1.0, 0.5, 0.0), "mass": 0.3}))
    # all spin the same way, so that the drag torque cannot be had apart from thrust
    assert (found.rank, found.zero_torque_volume_N3, found.zero_torque_ball_N) == (3, 0.0, 0.0)
    spins = [one.model_copy(update={"spin": (-1) ** (k // 2 + k % 2)}) for k, one in enumerate(vehicle.rotors)]
    other = capability(vehicle.model_copy(update={"com": (1.0, 0.5, 0.0), "mass": 0.3, "rotors": tuple(spins)}))
    assert (other.rank, other.zero_torque_volume_N3) == (4, 0.0)
    assert other.flight.hover.possible is True


def torque_left(vehicle: Vehicle, dead: int) -> float:
    """Distance of hover from the nearest facet of the torques at its thrust; at each vertex one input is free."""
    T, vertices = np.delete(rotor_map(vehicle), dead, axis=1)[2:], []
    for free, *limits in product(range(5), *[(0.0, 1.0)] * 4):
        v = np.insert(limits, free, 0.0)
        v[free] = (1 - T[0] @ v) / T[0, free]
        if -1e-12 <= v[free] <= 1 + 1e-12:
            vertices.append(T[1:] @ v)
    return -float(ConvexHull(vertices).equations[:, 3].max()) if vertices else -math.inf


@pytest.mark.parametrize("seed", [None, *range(6)])
@pytest.mark.parametrize("spins", [*HEXACOPTERS, "pppnnn", "ppnpnn"])
def test_a_hexacopter_survives_failures_that_leave_torque_in_every_direction(spins: str, seed: int | None) -> None:
    vehicle = hexacopter(spins, seed)
    out = capability(vehicle).flight.rotors_out_hover
    places = np.array([(one.x_m, one.y_m, one.z_m) for one in vehicle.rotors]) - vehicle.com
    left = np.array([torque_left(vehicle, dead) for dead in range(6)]) / np.linalg.norm(places, axis=1).max()
    assert (out.survive, out.hover_only) == (sum(left >= 0.01), sum((left > -1e-9) & (left < 0.01)))
    assert [rotor for _, rotor in out.lost] == np.flatnonzero(left <= -1e-9).tolist()
    if seed is None and spins in HEXACOPTERS:
        assert (out.survive, out.hover_only) == HEXACOPTERS[spins]


def test_a_kit_can_do_what_the_audit_says(tmp_path: Path) -> None:
    design = read_json(Design, Path(__file__).parent / "designs/push-a70010.json")
    assert design.task.min_input == 0
    (tmp_path / "rotors.csv").write_text(allocation(design).rotor_csv())
    told, p_E = f"mass = {design.task.total_mass(5)!r}", platform(design).p_e.tolist()
    (tmp_path / "kit.toml").write_text(f'{told}\nend_effector = {p_E}\nrotors = "rotors.csv"\n')
    found, expected = capability(read_vehicle(tmp_path / "kit.toml")), audit(design).flight
    fields = "force_reserve_N", "horizontal_reserve_N", "force_reserve_com_N", "torque_reserve_Nm", "load_factor"
    for field in (*fields, "tilt_deg"):
        assert getattr(found.flight.hover, field) == pytest.approx(getattr(expected.hover, field), abs=2e-6), field
    able = [out.survive + out.hover_only for out in (found.flight.rotors_out_hover, expected.rotors_out_hover)]
    assert able[0] == able[1]
    assert [4 * m + q for m, q in expected.rotors_out_hover.lost] == [
        q for _, q in found.flight.rotors_out_hover.lost
    ]
    assert found.flight.hover_power_ratio == pytest.approx(expected.hover_power_ratio, rel=1e-6)


def test_the_page_rounds_what_is_proven_down() -> None:
    vehicle = Vehicle(rotors=[rotor([x, y, 0], [0, 0, 1], k_tau=0.01) for x in (0, 1, 2) for y in (0, 1)])
    found = capability(vehicle.model_copy(update={"com": (1.0, 0.5, 0.0), "mass": 0.3}))
    page = vehicle_page(
        "v", 6, found.model_copy(update={"zero_torque_ball_N": 7.45115999, "zero_torque_volume_N3": 1.0})
    )
    assert "any of 7.4511 N" in page


@pytest.mark.parametrize(("ball", "volume", "told"), [(0, 0, []), (0, 2, ["2"]), (1.5, 2, ["1.5", "2"])])
def test_forces_without_torque_are_left_out_where_there_are_none(
    ball: float, volume: float, told: list[str]
) -> None:
    found = capability(Vehicle(rotors=[rotor([x, 0, 0], [0, 0, 1], k_tau=0.01) for x in (-1, 1)]))
    sizes = {"zero_torque_ball_N": ball, "zero_torque_volume_N3": volume}
    lines = forces_without_torque(found.model_copy(update=sizes))
    assert [re.findall(r"[\d.]+(?= N)", line) for line in lines] == [told] * bool(told)


HEAD = "x_m,y_m,z_m,ax,ay,az,spin,k_f,k_tau,u_max\n"
KIT_HEAD = "x_m,y_m,z_m,axis_x,axis_y,axis_z,spin,thrust_coefficient_Ns2,torque_coefficient_Nms2,largest_thrust_N\n"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            '{\n "format": "topo-search/design",\n "hinge_angles_rad": [0.1, 0.2]\n}\n',
            "rotors: must be a CSV table",
        ),
        ("", "rotors: must be a CSV table"),
        (f"x_m, {HEAD}1,0,0,0,0,0,1,1,1,0,1\n", 'rotors: must have one column per quantity, but has "x_m, x_m"'),
        (
            f"axis_x,{HEAD}1,0,0,0,0,0,1,1,1,0,1\n",
            'rotors: must have one column per quantity, but has "axis_x, ax"',
        ),
        (f"{HEAD}0,275,0,0,0,0,1,1,1,0,1\n", "rotors[0]: must have at most 10 cells"),
        (f"{HEAD}0,0,0,0,0,1,1,1,0,1,5\n", "rotors[0]: must have at most 10 cells"),
        (f"{HEAD}0,0,0,0,0,1,1,1,0,x\n", "rotors[0].u_max: "),
        (f"{KIT_HEAD}0,0,0,0,0,1,1,0,0,3\n", "rotors[0].k_f: "),
        (f"{KIT_HEAD}0,0,0,0,0,1,1,1,0,x\n", "rotors[0].u_max: "),
        (
            f"{HEAD}0.275,0,0,0,0,1,1,1,0,".replace(",", ";") + "612,500\n",
            'rotors[0].u_max: must be a number, but got "612,500"',
        ),
        (
            f"{HEAD}0,0,0,0,0,1,1,1,0,".replace(",", "\t") + "612,500.0\n",
            'rotors[0].u_max: must be a number, but got "612,500.0"',
        ),
        (f"{HEAD}0,0,0,0,0,1,1,1,0,".replace(",", ";") + "1,612,500\n", "rotors[0].u_max: "),
        (f'{HEAD}0,0,0,0,0,1,1,1,0,"612,500"\n', "rotors[0].u_max: "),
    ],
)
def test_faults_of_a_table_of_rotors_name_file_field_and_rule(text: str, fault: str, tmp_path: Path) -> None:
    (tmp_path / "vehicle").write_text(text, newline="")
    assert f"vehicle: {fault}" in invoke("capability", str(tmp_path / "vehicle"), status=2).output


@pytest.mark.parametrize(
    "text",
    [
        f",{HEAD}0,1.5,0,0,0,0,1,-1,1,0,2\n1,0,0,0,0,0,1,1,1,0,2\n",
        f"Unnamed: 0,{HEAD}0,1.5,0,0,0,0,1,-1,1,0,2\n1,0,0,0,0,0,1,1,1,0,2\n",
        f"\ufeff{HEAD}1.5,0,0,0,0,1,-1,1,0,2\n0,0,0,0,0,1,1.0,1,0,2\n,,,,,,,,,\n\n".replace("\n", "\r\n"),
        f"{HEAD}1.5,0,0,0,0,1,-1,1,0,2,\n 0, 0, 0, 0, 0, 1, 1, 1e0, 0, 2\n".replace(",k_f", ", k_f "),
        f"{HEAD}1,5,0,0,0,0,1,-1,1,0,2\n0,0,0,0,0,1,1,1,0,2\n".replace(",", ";").replace("1;5", "1,5"),
        f"{HEAD}1.5,0,0,0,0,1,-1,1,0,2\n0,0,0,0,0,1,1,1,0,2\n".replace(",", "\t"),
        f"{HEAD}1.5,0,0,0,0,1,-1,1,0,2\n0,0,0,0,0,1,1,1,0,2\n".replace(",", ";"),
    ],
)
def test_tables_of_rotors_are_read_as_spreadsheets_write_them(tmp_path: Path, text: str) -> None:
    (tmp_path / "rotors.csv").write_text(text, newline="", encoding="utf-8")
    first, second = read_vehicle(tmp_path / "rotors.csv").rotors
    assert (first.x_m, first.spin, first.k_f, first.u_max) == (1.5, -1, 1.0, 2.0)
    assert (second.x_m, second.spin, second.k_f, second.u_max) == (0.0, 1, 1.0, 2.0)


def test_the_command_judges_a_vehicle_by_a_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    design = read_json(Design, Path(__file__).parent / "designs/wall-push.json")
    Path("rotors.csv").write_text(allocation(design).rotor_csv())
    p_E = platform(design).p_e.tolist()
    Path("strong.toml").write_text(
        f'mass = {design.task.total_mass(3)!r}\nend_effector = {p_E}\nrotors = "rotors.csv"\n'
    )
    Path("heavy.toml").write_text('mass = 10.0\nrotors = "rotors.csv"\n')
    Path("wrong.csv").write_text(SPOILT[0])

    strong = invoke("capability", "strong.toml", "--task", "wall-push", "--out", "page.html")
    assert "strong.toml: 12 rotors, rank 6 of 6" in strong.output
    assert "load case 0 (push): possible" in strong.output
    text = Path("page.html").read_text()
    assert "12 rotors, rank 6 of 6. The vehicle meets every load case of the task." in text
    assert "load case 0 (push)" in text
    told = json.loads(invoke("capability", "heavy.toml", "--task", "wall-push", "--json", status=1).output)
    assert told["met"] is False
    assert told["flight"]["cases"][0] == {**told["flight"]["cases"][0], "name": "hover", "possible": False}
    assert SPOILT[1] in invoke("capability", "wrong.csv", status=2).output
