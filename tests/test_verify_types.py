"""The audit of platforms whose modules differ, against plain computations and against platforms of one type."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from older import older_task
from scipy.spatial.distance import cdist
from verify_cases import changed, failing

from topo_search.model import Design, Geometry, Module, Mount, Status, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.files import read_json
from topo_search.model.task import ResolvedTask
from topo_search.topologies import sample
from verify import audit, complete
from verify.air.bound import bound_beyond, bound_speed, case_jets
from verify.air.jets import jets, speeds
from verify.bodies import ball
from verify.brackets import bracket_hulls
from verify.certificate import RoundBody
from verify.contacts import certify
from verify.features import CLEARANCES
from verify.flight.joints import inertia
from verify.kinematics import objective, platform, required_wrench, wrench_map
from verify.requirements import Scene
from verify.sensitivity import clearance_of, deviate
from verify.tolerance import Errors, Levers, Tolerance

Array = NDArray[np.float64]
EXAMPLES = Path(__file__).parent.parent / "topo_search/examples/best"
QUAD = {"name": "quad", "count": 2}
BATTERY = {
    "name": "battery", "count": 1, "rotors": [], "mass": 0.5, "connector_distance": 0.09,
    "body": {"hub": [0.09, 0.07, 0.05]},
}  # fmt: skip
TRI = {
    "name": "tri", "count": 2, "mass": 0.3, "connector_distance": 0.2, "arm_length": 0.12, "max_thrust": 2.0,
    "thrust_coefficient": 5e-7, "torque_coefficient": 6e-9, "airflow": {"spread_angle_deg": 10.0},
    "rotors": [
        {"position": [0.12 * math.cos(a), 0.12 * math.sin(a), 0.01], "spin": spin, "radius": 0.04,
         "axis": [0.1 * math.cos(a), 0.1 * math.sin(a), 1.0]}
        for a, spin in ((0.0, 1), (2 * math.pi / 3, -1), (4 * math.pi / 3, 1))
    ],
}  # fmt: skip
TYPES = [QUAD, BATTERY, TRI]
"""A default quadrotor, a battery, and three tilted rotors of another kind on a larger module."""
CORNERS = 0.1 / math.sqrt(2) * np.array([[1.0, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]])
ROTORS: dict[str, list[tuple[Any, Any, int, float]]] = {
    "quad": [(x, [0, 0, 1], spin, 0.05) for x, spin in zip(CORNERS, (1, -1, 1, -1), strict=True)],
    "battery": [],
    "tri": [(rotor["position"], rotor["axis"], rotor["spin"], 0.04) for rotor in TRI["rotors"]],
}
"""Position, axis, spin and radius of the rotors of each type [m]."""


def typed_task(types: list[dict[str, Any]], **fields: Any) -> ResolvedTask:
    """The task of some types; fields that are left out ask for nothing."""
    stated = {"name": "mixed", "modules": sum(kind["count"] for kind in types), "module_types": types}
    stated |= {
        "load_cases": [{"com": {"force": [0.0, 0.0, 1.0]}}, {"end_effector": {"force": [0.2, 0, 0]}}],
        **fields,
    }
    task = older_task(stated)
    return task.resolve(task.n)


def mixed_design(
    seed: int, types: list[dict[str, Any]] = TYPES, *, any_port: bool = False, **fields: Any
) -> Design:
    """A design of several types whose numbers are drawn; it need not do anything useful."""
    rng, task = np.random.default_rng(seed), typed_task(types, **fields)
    (tree,) = sample(task.n, 1, seed, connectors="any" if any_port else "aligned")
    of_nodes = rng.permutation([k for k, kind in enumerate(types) for _ in range(kind["count"])]).tolist()
    design = Design(
        task=task,
        topology=replace(tree, types=tuple(of_nodes)),
        root_orientation_rad=tuple(rng.uniform([-3, -1.5, -3], [3, 1.5, 3]).tolist()),
        hinge_angles_rad=tuple(rng.uniform(-1.5, 1.5, task.n - 1).tolist()),
        end_effector_m=tuple(rng.uniform(-1, 1, 3).tolist()),
        rotor_speeds_squared=((0.0,) * task.rotor_count,) * len(task.load_cases),
        objective=0.0,
    )
    limits = design.task.input_limits.ravel()
    u = [tuple((rng.uniform(0.1, 0.9, limits.size) * limits).tolist()) for _ in task.load_cases]
    design = design.model_copy(update={"rotor_speeds_squared": tuple(u)})
    return design.model_copy(update={"objective": objective(design)})


def by_hand(design: Design) -> dict[str, Array]:
    """Centres and orientations, COM, inertia and wrenches of a design, rotor by rotor in plain numbers [SI]."""
    task, modules = design.task, design.task.modules_of_nodes

    def turn(axis: str, angle: float) -> Array:
        c, s = math.cos(angle), math.sin(angle)
        return np.array({"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
                         "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis])  # fmt: skip

    psi, alpha_0, alpha_1 = design.root_orientation_rad
    R, p = [turn("z", psi) @ turn("x", alpha_0) @ turn("y", alpha_1)], [np.zeros(3)]
    points, masses = list[Array](), list[float]()
    for (h, i, a, b), angle in zip(design.topology.edges(), design.hinge_angles_rad, strict=True):
        hinge = p[h] + modules[h].connector_distance * R[h] @ PORT_DIRECTIONS[a]
        folded = R[h] @ turn("yx"[a % 2], angle)
        p.append(hinge + modules[i].connector_distance * folded @ PORT_DIRECTIONS[a])
        R.append(folded @ turn("z", math.pi / 2 * (a + 2 - b)))
        points.append(hinge)
        masses.append(task.module.joint_mass)
    points += [*p, np.array(design.end_effector_m)]
    masses += [*(module.mass for module in modules), task.end_effector.mass]
    com = np.average(points, axis=0, weights=masses)
    J = sum(R_i @ np.diag(module.inertia) @ R_i.T for R_i, module in zip(R, modules, strict=True))
    for x, m in zip(points - com, masses, strict=True):
        J = J + m * (x @ x * np.eye(3) - np.outer(x, x))
    wrenches = np.zeros((len(design.inputs), 6))
    for k, u in enumerate(design.inputs):
        for i, module in enumerate(modules):
            for q, (position, axis, spin, _) in enumerate(ROTORS[design.types[i]]):
                z = R[i] @ axis / np.linalg.norm(axis)
                force = module.thrust_coefficient * u[i, q] * z
                torque = np.cross(p[i] + R[i] @ position - com, force)
                wrenches[k] += [*force, *(torque - spin * module.torque_coefficient * u[i, q] * z)]
    return {"R": np.array(R), "p": np.array(p), "com": com, "J": np.asarray(J), "wrenches": wrenches}


@pytest.mark.parametrize("seed", range(4))
def test_geometry_masses_and_wrenches_are_those_of_each_modules_type(seed: int) -> None:
    design = mixed_design(seed, any_port=seed % 2 == 1, module={"joint_mass": 0.03}, end_effector={"mass": 0.1})
    expected, found, task = by_hand(design), platform(design), design.task
    np.testing.assert_allclose(found.poses.p, expected["p"], atol=1e-12)
    np.testing.assert_allclose(found.poses.R, expected["R"], atol=1e-12)
    np.testing.assert_allclose(found.p_com, expected["com"], atol=1e-12)
    np.testing.assert_allclose(inertia(design, found), expected["J"], rtol=1e-9)
    wrenches = design.inputs.reshape(2, -1) @ wrench_map(found, task.modules_of_nodes).T
    np.testing.assert_allclose(wrenches, expected["wrenches"], rtol=0, atol=1e-12 * np.abs(wrenches).max())
    assert task.total_mass(5) == pytest.approx(2 * 0.24 + 0.5 + 2 * 0.3 + 4 * 0.03 + 0.1)
    missing = task.input_limits == 0
    assert missing.sum() == 4 + 2  # of the battery, and the fourth of each module with three
    assert not wrench_map(found, task.modules_of_nodes)[:, missing.ravel()].any()


def surface(module: Module, kind: str) -> list[Array]:
    """Points of the rotors of a module, then of its hub and arms, in its frame [m]."""

    def box(centre: Array, axes: Array) -> Array:
        sides = np.linspace(-0.5, 0.5, 9)
        cube = np.array(
            [x for x in np.stack(np.meshgrid(*[sides] * 3), -1).reshape(-1, 3) if np.abs(x).max() == 0.5]
        )
        return np.asarray(centre + cube @ axes)

    discs, frame = list[Array](), [box(np.zeros(3), np.diag(module.body.hub))]
    for position, axis, _, radius in ROTORS[kind]:
        x, z = np.array(position), np.array(axis) / np.linalg.norm(axis)
        across = np.linalg.svd(z[None])[2][1:]
        angles = np.linspace(0, 2 * np.pi, 64)
        rim = radius * np.column_stack([np.cos(angles), np.sin(angles)]) @ across
        heights = np.linspace(-0.5, 0.5, 5) * module.body.rotor_height
        discs.append(np.concatenate([x + share * rim + h * z for h in heights for share in (0, 0.5, 1)]))
        along = x / np.linalg.norm(x)
        side = np.cross([0, 0, 1], along)
        side, w = side / np.linalg.norm(side), module.body.arm_width
        frame.append(box(x / 2, np.array([x, w * side, w * np.cross(along, side)])))
    return [*discs, np.concatenate(frame)]


@pytest.mark.parametrize("seed", range(3))
def test_no_sampled_distance_is_less_than_a_certified_clearance(seed: int) -> None:
    """And none is much more: parts and airflow have the sizes of each module's type."""
    design = mixed_design(seed)
    at, modules = by_hand(design), design.task.modules_of_nodes
    parts = [
        [x @ R.T + p for x in surface(module, kind)]
        for module, kind, R, p in zip(modules, design.types, at["R"], at["p"], strict=True)
    ]
    share = np.linspace(0, 1, 400)[:, None]
    airs = {}
    for i, (module, R, p) in enumerate(zip(modules, at["R"], at["p"], strict=True)):
        for air in module.envelopes:
            airs[i] = p - share * air.length * R[:, 2], (air.start_radius + share * air.growth).ravel()
    count = {"airflow": 0, "rotor-airflow": 0, "body": 0}
    for pair in audit(design).pairs:
        if pair.kind == "airflow":
            (P, r), (Q, s) = airs[pair.a], airs[pair.b]
            sampled = cdist(P, Q) - r[:, None] - s
        elif pair.kind == "rotor-airflow":
            P, r = airs[pair.b]
            sampled = cdist(parts[pair.a][-1 if pair.segment is None else pair.segment], P) - r
        elif pair.kind == "body" and (pair.a, pair.b) not in design.topology.bolted:
            sampled = cdist(*(np.concatenate(parts[i]) for i in (pair.a, pair.b)))
        else:
            continue
        if pair.status == Status.CLEAR:
            count[pair.kind] += 1
            assert pair.lower_m - 1e-9 <= sampled.min() <= pair.analytic_m + 0.008
        else:
            assert sampled.min() < 0.03
    assert min(count.values()) > 0
    assert len(airs) == 4


def under(hub: list[float], **fields: Any) -> Design:
    """A battery that hangs, folded by 80 degrees, from a level quadrotor."""
    types = [{**QUAD, "count": 1}, {**BATTERY, "body": {"hub": hub}}]
    tree = Topology(((-1, -1, -1), (0, 0, 2)), types=(0, 1))
    task = typed_task(types, load_cases=[{"com": {"force": [0.0, 0.0, 1.0]}}], **fields)
    rows = {"rotor_speeds_squared": ((1e6,) * 4 + (0.0,) * 4,), "objective": 4e12}
    place = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (math.radians(80),)}
    return Design(task=task, topology=tree, end_effector_m=(0.0, 0.0, 0.5), **place, **rows)


def test_a_battery_in_the_airflow_of_a_quadrotor_is_violated_and_blows_at_nothing() -> None:
    def hub(design: Design) -> tuple[Status, int]:
        pairs = [pair for pair in audit(design).pairs if pair.kind == "rotor-airflow"]
        return pairs[0].status, len(pairs)

    assert hub(under([0.06, 0.06, 0.04])) == (Status.CLEAR, 1)  # only the battery's hub in the quadrotor's air
    assert hub(under([0.06, 0.06, 0.20])) == (Status.VIOLATED, 1)
    with_brackets = under([0.06, 0.06, 0.04], module={"bracket": {}})
    kinds = [(pair.kind, pair.b) for pair in audit(with_brackets).pairs]
    assert ("bracket-rotor", 0) in kinds
    assert ("bracket-rotor", 1) not in kinds
    assert ("bracket-airflow", 1) not in kinds
    scene, sizes = Scene(with_brackets), with_brackets.task.module.bracket_sizes
    corners = bracket_hulls(scene)[1].mesh.vertices - scene.centres[0] - [1.5, 0, 0]  # from the hinge [l_arm]
    assert 0.1 * np.linalg.norm(corners, axis=1) == pytest.approx(
        np.hypot(sizes.set_back, math.sqrt(2) * sizes.half_width), rel=0.2
    )


@pytest.mark.parametrize(("fold_deg", "status"), [(40.0, Status.CLEAR), (70.0, Status.VIOLATED)])
def test_bolted_frames_touch_within_a_share_of_their_own_connectors_distance(
    fold_deg: float, status: Status
) -> None:
    """Boxes, 50 mm high, that end at their connectors, 180 and 90 mm from their centres: 36 and 18 mm may touch.

    Folded, a corner of either reaches 25 mm times the sine into the other.
    """
    boxes = [
        {**BATTERY, "name": name, "connector_distance": l_c, "body": {"hub": [2 * l_c, 0.05, 0.05]}}
        for name, l_c in (("long", 0.18), ("short", 0.09))
    ]
    task = typed_task([*boxes, {**QUAD, "count": 1}])
    for order in ((0, 1, 2), (1, 0, 2)):
        tree = Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0)), types=order)
        place = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (math.radians(fold_deg), 0.0)}
        rows = {"rotor_speeds_squared": ((0.0,) * 12,) * 2, "objective": 0.0}
        result = audit(Design(task=task, topology=tree, end_effector_m=(0.0, 0.0, 0.5), **place, **rows))
        (pair,) = (pair for pair in result.pairs if (pair.kind, pair.a, pair.b) == ("body", 0, 1))
        assert pair.status == status
        (allowed,) = (contact for contact in result.allowed_contacts if contact.b == 1)
        assert {"from 36 mm", "from 18 mm"} <= set(re.findall("from .. mm", allowed.parts))


@pytest.mark.parametrize("seed", range(3))
def test_a_rod_that_meets_a_module_is_blocked_by_it(seed: int) -> None:
    design = mixed_design(seed)
    design = design.model_copy(update={"end_effector_m": tuple(0.3 * x for x in design.end_effector_m)})
    at, modules = by_hand(design), design.task.modules_of_nodes
    found, met, share = audit(design).assembly.end_effector.connectors, 0, np.linspace(0, 1, 200)[:, None]
    assert len(found) == 4 * 5 - 2 * 4
    for connector in found:
        i = connector.module
        start = at["p"][i] + modules[i].connector_distance * at["R"][i] @ PORT_DIRECTIONS[connector.port]
        path = np.array(design.end_effector_m) - start
        assert connector.length_m == pytest.approx(float(np.linalg.norm(path)))
        for j in {*range(5)} - {i}:
            points = np.concatenate(surface(modules[j], design.types[j])) @ at["R"][j].T + at["p"][j]
            if cdist(start + share * path, points).min() < design.task.end_effector.rod_radius:
                met += 1
                assert j in {obstacle.module for obstacle in connector.blocked_by}
    assert met


def test_an_input_of_a_rotor_that_a_type_lacks_is_violated() -> None:
    design = under([0.06, 0.06, 0.04])
    assert not any("rotor input" in name for name in failing(audit(design)))
    for u, name in ((99.0, "load case 0, largest rotor input"), (-99.0, "load case 0, smallest rotor input")):
        moved = design.model_copy(update={"rotor_speeds_squared": ((1e6,) * 4 + (0.0, u, 0.0, 0.0),)})
        assert name in failing(audit(moved))
    limit = float(design.task.input_limits.max())
    faster = design.model_copy(update={"rotor_speeds_squared": ((1e6, 1.01 * limit, 1e6, 1e6) + (0.0,) * 4,)})
    assert "load case 0, largest rotor input" in failing(audit(faster))


SHIPPED = ["wall-push-3", "push-5", "h-modquad-3", "survives-a-rotor-3", "hexarotor-3"]


def as_types(design: Design) -> Design:
    """The design of a task that calls its modules by two names."""
    data, n = design.model_dump(mode="json"), design.topology.n
    names = ["one" if i % 2 else "other" for i in range(n)]
    tables = [{"name": name, "count": names.count(name)} for name in ("one", "other")]
    return Design.model_validate({**data, "types": names, "task": {**data["task"], "module_types": tables}})


def assert_alike(found: Any, expected: Any, path: str = "") -> None:
    """Both have the same words, and numbers within 1e-9."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), path
        for name in expected:
            assert_alike(found[name], expected[name], f"{path}.{name}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), path
        for k, (x, y) in enumerate(zip(found, expected, strict=True)):
            assert_alike(x, y, f"{path}[{k}]")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9), path
    else:
        assert found == expected, path


@pytest.mark.parametrize("name", SHIPPED)
def test_equal_types_have_the_audit_of_one_type(name: str) -> None:
    design = read_json(Design, EXAMPLES / f"{name}.json")
    typed = as_types(design)
    assert len(set(typed.types)) == 2
    left_out = {"seconds", "versions"}
    expected, found = (audit(x).model_dump(mode="json", exclude=left_out) for x in (design, typed))
    assert_alike(found, expected)
    assert Design.model_validate_json(typed.model_dump_json()) == typed


@pytest.mark.parametrize("seed", range(2))
def test_every_module_blows_with_the_jets_of_its_type(seed: int) -> None:
    design = mixed_design(seed)
    scene, task, rng = Scene(design), design.task, np.random.default_rng(seed)
    x = rng.normal(0, 5, (3000, 3))
    for k, (_, air) in enumerate(case_jets(scene)):
        found = speeds(air, x)
        for i, module in enumerate(task.modules_of_nodes):
            r = module.rotor_table.count
            alone = np.zeros((len(x), 1))
            if r:
                own = scene.l_arm / module.arm_length  # in units of its own
                pose, u = (own * scene.centres[i : i + 1], scene.R[i : i + 1]), design.inputs[k, i : i + 1, :r]
                alone = speeds(jets(module, task.air_density, *pose, own * air.rotors[i : i + 1, :r], u), own * x)
            np.testing.assert_allclose(found[:, i], alone[:, 0], rtol=1e-12)
        assert (speeds(air, x, 0.3) >= speeds(air, x + rng.uniform(-0.17, 0.17, x.shape))).all()
        region, far = RoundBody(ball(np.zeros(3), 4.0)), x[np.linalg.norm(x, axis=1) < 4.0]
        bound = bound_speed(air, region)
        assert speeds(air, far).sum(axis=1).max() <= bound.at_most <= 1.03 * bound.at_least
        beyond = 200 * x / np.linalg.norm(x, axis=1, keepdims=True)
        assert speeds(air, beyond).sum(axis=1).max() <= bound_beyond(air, np.zeros(3), 199.0) < 5.0
    rotors = audit(design).air.cases[0].rotors
    assert [[rotor.module, rotor.rotor] for rotor in rotors] == np.argwhere(task.input_limits > 0).tolist()


def test_only_rotors_that_exist_fail_and_a_joint_carries_what_hangs_on_it() -> None:
    tree = Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0), (2, 2, 0), (1, 0, 2)), types=(0, 2, 0, 2, 1))
    design = mixed_design(5).model_copy(update={"mount": Mount(module=0, port=1), "topology": tree})
    design = changed(design, types=["quad", "tri", "quad", "tri", "battery"])
    result, at, task = audit(design), by_hand(design), design.task
    out = result.flight.rotors_out_all
    assert out.of == 4 + 3 + 4 + 3
    exist = {tuple(row) for row in np.argwhere(task.input_limits > 0).tolist()}
    assert {*out.lost, *out.undecided} <= exist
    weight, p_E = np.array([0, 0, -task.total_mass(5) * 9.81]), np.array(design.end_effector_m) - at["com"]
    for k, case in enumerate(task.load_cases):
        exerted = np.array(case.at_end_effector.force)
        F = at["wrenches"][k, :3] - exerted + weight
        tau = at["wrenches"][k, 3:] - np.cross(p_E, exerted)
        a, alpha = F / task.total_mass(5), np.linalg.solve(at["J"], tau)
        force = 0.5 * (a + np.cross(alpha, at["p"][4] - at["com"]) + [0, 0, 9.81])
        (load,) = (j for j in result.flight.joints if j.case == f"load case {k}" and j.child == 4)
        assert load.force_N == pytest.approx(float(np.linalg.norm(force)))
    J_p = at["R"][4] @ np.diag(task.modules_of_nodes[4].inertia) @ at["R"][4].T
    arm = at["R"][4] @ [0.09, 0, 0]  # from the connector
    assert load.moment_Nm == pytest.approx(float(np.linalg.norm(J_p @ alpha + np.cross(arm, force))))


def test_the_battery_of_any_module_lasts_as_long() -> None:
    def endurance(on_quads: float | None, in_battery: float | None) -> list[float | None]:
        tree = Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0)), types=(1, 0, 0))
        types = [{**QUAD, "battery_Wh": on_quads}, {**BATTERY, "battery_Wh": in_battery}]
        task = typed_task(types, load_cases=[{"com": {"force": [0.0, 0.0, 1.0]}}])
        place = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (0.0, 0.0)}
        design = complete(Geometry(task=task, topology=tree, end_effector_m=(0.0, 0.0, 0.5), **place))
        assert not design.inputs[:, 0].any()
        result = audit(design)
        assert not any("force" in name or "rotor input" in name for name in failing(result))
        return [case.endurance_min for case in result.power]

    hover = endurance(15.0, None)
    assert hover == endurance(None, 30.0)
    assert len(hover) == 2
    assert hover[0] > 0


def test_a_geometry_gets_the_inputs_of_least_effort_whatever_the_limits_of_its_types() -> None:
    strong = {**QUAD, "name": "strong", "count": 1, "max_thrust_to_weight": 6.0}
    task = typed_task([{**QUAD, "count": 1}, strong, {**BATTERY, "mass": 0.1}])
    tree = Topology(((-1, -1, -1), (0, 0, 2), (0, 2, 0)), types=(2, 0, 1))
    place = {"root_orientation_rad": (0.0, 0.0, 0.0), "hinge_angles_rad": (0.30, -0.33)}
    bare = Geometry(task=task, topology=tree, end_effector_m=(0.0, 0.0, 0.5), **place)
    design = complete(bare.model_copy(update={"task": task.model_copy(update={"load_cases": task.load_cases[:1]})}))
    at = platform(design)
    A, b = wrench_map(at, design.task.modules_of_nodes), required_wrench(design.task.load_cases[0], at.p_e)
    u, limits = np.linalg.pinv(A, rcond=1e-9) @ b, design.task.input_limits.ravel()
    assert (u > 0)[limits > 0].all()
    assert (u <= limits + 1e-3).all()
    np.testing.assert_allclose(A @ u, b, atol=1e-9)
    np.testing.assert_allclose(design.inputs.ravel(), u, rtol=1e-3, atol=1.0)


@pytest.mark.parametrize("seed", range(2))
def test_no_error_takes_more_clearance_than_its_bound(seed: int) -> None:
    """Levers, masses and connectors are those of the types: a region follows the direction from the COM."""
    regions = [
        {"kind": "exterior", "half_angle_deg": 70.0},
        {"kind": "directional", "radius": 0.05, "along": "end_effector", "length": 1.0},
    ]
    drawn = mixed_design(seed, module={"joint_mass": 0.05}, exposure=regions)
    i, port = drawn.topology.free_connectors[-1]
    design = drawn.model_copy(update={"mount": Mount(module=i, port=port)})
    scene, rng, errors = Scene(design), np.random.default_rng(seed), Errors(0.02, 0.05, 0.02)
    checks = [check for group in CLEARANCES for check in group.checks(scene, design.mount) if check.counts]
    tolerance = Tolerance(scene, list(zip(checks, certify(checks), strict=True)), design.mount)
    bounds = {weakest.check.key: weakest.bound for weakest in tolerance.checks_up_to(errors, np.inf)}
    least = dict.fromkeys(bounds, np.inf)
    for _ in range(4):
        turns, v = (
            errors.delta * rng.choice([-1, 1], design.topology.n - 1),
            rng.normal(size=(design.topology.n + 1, 3)),
        )
        shifts = errors.delta_p * scene.l_arm * v / np.linalg.norm(v, axis=1, keepdims=True)
        envelope = errors.delta_e * scene.l_arm
        built = deviate(scene, turns, shifts, envelope=envelope, mount=design.mount)
        for check in (c for group in CLEARANCES for c in group.checks(built, design.mount) if c.key in least):
            least[check.key] = min(least[check.key], clearance_of(check))
    assert len(least) == len(checks)
    assert all(least[key] >= bound - 1e-9 for key, bound in bounds.items())


def test_levers_and_shares_of_mass_are_those_of_the_types() -> None:
    design = mixed_design(3, module={"joint_mass": 0.05}, end_effector={"mass": 0.2})
    i, port = design.topology.free_connectors[-1]
    mount, n = Mount(module=i, port=port), design.topology.n
    scene = Scene(design.model_copy(update={"mount": mount}))
    levers, none, eps = Levers(scene, i), np.zeros(n - 1, dtype=bool), 1e-6
    rates = np.array([levers.rates(x, k, none) for k, x in enumerate(scene.centres)])
    masses = np.array([module.mass for module in design.task.modules_of_nodes])
    turning = 0.0
    for h in range(n - 1):
        turned = deviate(scene, eps * np.eye(n - 1)[h], np.zeros((n + 1, 3)), envelope=0.0, mount=mount).platform
        moved = (turned.poses.p - scene.platform.poses.p) / scene.l_arm / eps
        np.testing.assert_allclose(rates[:, h], moved, atol=1e-4)
        np.testing.assert_allclose(levers.centre_rates(scene.centres, masses)[h], masses @ moved, atol=1e-4)
        joints = (turned.joints + turned.p_com - scene.platform.joints - scene.platform.p_com) / scene.l_arm / eps
        turning += masses @ np.linalg.norm(moved, axis=1) + 0.05 * np.linalg.norm(joints, axis=1).sum()
    checks = [check for check in scene.requirements() if check.counts]
    tolerance = Tolerance(scene, list(zip(checks, certify(checks), strict=True)), mount)
    assert tolerance._turning == pytest.approx(turning / design.task.total_mass(n), rel=1e-4)
