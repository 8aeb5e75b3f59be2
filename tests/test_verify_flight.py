"""Figures of flight of whole designs: attacked with random wrenches, scaled, mirrored, and by MuJoCo."""

import math
import sys
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from export_cases import inertia_about_com
from numpy.typing import NDArray
from scipy.optimize import linprog
from suites import few
from verify_cases import FAN, HOVER, changed, design, fan

from topo_search.model import Audit, CaseFlight, Design, Flight, Topology
from topo_search.model.files import read_json
from topo_search.topologies import sample
from verify import audit
from verify.flight.balls import half_angles
from verify.kinematics import platform, required_wrench, wrench_map

Array = NDArray[np.float64]

MODULE = {"max_thrust_to_weight": 4.0, "torque_coefficient": 1.06e-8}
PUSH = {"end_effector": {"force": [0.01, 0.005, 0.0]}, "com": {"force": [0.0, 0.0, 1.0]}}


def drawn(seed: int, n: int = 5, **task: Any) -> Design:
    """A platform of modules that lean every way but on the whole upright; it may hover and push, or not."""
    rng = np.random.default_rng(seed)
    (tree,) = sample(n, 1, seed)
    hinges = tuple(rng.uniform(-0.7, 0.7, n - 1).tolist())
    tip = tuple(rng.uniform(-0.5, 0.5, 3).tolist())
    leaning = design(tree, {"module": MODULE}, hinges=hinges, end_effector=tip)
    z = platform(leaning).poses.z.sum(axis=0)
    z /= np.linalg.norm(z)
    up = np.array([0.0, 0.0, 1.0])
    R = np.eye(3) - np.outer(z + up, z + up) / (1 + z[2]) + 2 * np.outer(up, z)  # takes z to up
    alpha_0 = math.asin(R[2, 1])
    root = (math.atan2(-R[0, 1], R[1, 1]), alpha_0, math.atan2(-R[2, 0], R[2, 2]))
    task = {"load_cases": [PUSH], "module": MODULE, **task}
    return design(tree, task, hinges=hinges, root=root, end_effector=tip)


ABLE = (0, 1, 4, 10, 30)
"""Seeds of platforms that can hover and push."""

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))

THREE = (3, 5, 7, 14, 26, 31, 46)
"""Seeds of platforms of three modules that can hover."""


def flight(given: Design) -> Flight:
    found = audit(given).flight
    assert found is not None
    return found


def producible(given: Design, wrench: Array, dead: int | None = None) -> bool:
    """Whether the rotors can produce a wrench about the COM, by HiGHS [N], [N m]."""
    task, found = given.task, platform(given)
    unit = np.repeat([task.force_unit(task.n), task.torque_unit(task.n)], 3)
    A = wrench_map(found, task.module) * task.module.max_input(task.gravity)
    bounds = [(0.0, 0.0 if j == dead else 1.0) for j in range(A.shape[1])]
    answer = linprog(np.zeros(A.shape[1]), A_eq=A / unit[:, None], b_eq=wrench / unit, bounds=bounds)
    return answer.status == 0


def asked(given: Design) -> list[Array]:
    """Wrenches of hover and of every load case."""
    found, weight = platform(given), given.task.force_unit(given.task.n)
    hover = np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0])
    return [hover, *(required_wrench(case, found.p_e) for case in given.task.load_cases)]


def directions(rng: np.random.Generator) -> Array:
    v = rng.normal(size=(40, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def reserves(case: CaseFlight) -> list[tuple[str, float, Array]]:
    rows = (
        ("force", case.force_reserve_N, case.force_weakest),
        ("horizontal", case.horizontal_reserve_N, case.horizontal_weakest),
        ("force_com", case.force_reserve_com_N, case.force_weakest_com),
        ("horizontal_com", case.horizontal_reserve_com_N, case.horizontal_weakest_com),
        ("torque", case.torque_reserve_Nm, case.torque_weakest),
    )
    return [(name, size, np.array(v)) for name, size, v in rows if size is not None and v is not None]


def added(name: str, x: Array, p_E: Array) -> Array:
    """The wrench about the COM of a force or torque of the name's kind."""
    if name == "torque":
        return np.concatenate([np.zeros(3), x])
    return np.concatenate([x, np.zeros(3) if name.endswith("com") else np.cross(p_E, x)])


@pytest.mark.parametrize("seed", few(ABLE, 2))
def test_all_within_a_reserve_can_be_produced_and_nothing_just_beyond_it_at_its_weakest(seed: int) -> None:
    given = drawn(seed)
    p_E, found = platform(given).p_e, flight(given)
    rng = np.random.default_rng(seed)
    assert all(case.possible for case in found.cases)
    for case, b in zip(found.cases, asked(given), strict=True):
        assert producible(given, b) is case.possible
        for name, size, weakest in reserves(case):
            for d in (*directions(rng), weakest):
                if name.startswith("horizontal"):
                    d = np.append(d[:2], 0.0) / np.linalg.norm(d[:2])
                least = 0.999 * size * d
                assert producible(given, b + added(name, least, p_E))
            beyond = (1.001 * size + 1e-5) * weakest
            assert not producible(given, b + added(name, beyond, p_E))
        if case.load_factor is not None:
            carried = 0.0 * b if case.name == "hover" else asked(given)[0]  # the push carries the weight
            assert producible(given, carried + 0.9999 * case.load_factor * (b - carried))
            assert not producible(given, carried + 1.0001 * case.load_factor * (b - carried))


@pytest.mark.parametrize("seed", few([*ABLE, 2, 3], 1))
def test_the_rotors_that_may_fail_are_those_without_which_all_can_be_produced(seed: int) -> None:
    given = drawn(seed, 3)
    found, wrenches = flight(given), asked(given)
    able = [[producible(given, b, dead) for b in wrenches] for dead in range(12)]
    for out, cases in ((found.rotors_out_hover, 1), (found.rotors_out_all, 2)):
        lost = tuple((j // 4, j % 4) for j in range(12) if not all(able[j][:cases]))
        assert (out.lost, out.undecided, out.survive + out.hover_only) == (lost, (), 12 - len(lost))


def force_at(angle: float, towards: Array) -> Array:
    """A force of one weight at an angle from z, shape (2,) to (3,)."""
    return np.append(math.sin(angle) * towards / np.linalg.norm(towards), math.cos(angle))


@pytest.mark.parametrize("seed", few(ABLE, 2))
def test_hover_is_held_at_every_tilt_up_to_the_largest_and_not_just_beyond_it(seed: int) -> None:
    given = drawn(seed)
    weight, hover = given.task.force_unit(5), flight(given).hover
    assert hover.tilt_deg is not None
    t, rng = math.radians(hover.tilt_deg), np.random.default_rng(seed)
    assert math.degrees(t) <= hover.tilt_at_most_deg <= math.degrees(t) + 1e-4
    assert t > 0.01
    for angle in (*rng.uniform(0.0, t - 1e-6, 40), t - 1e-6):
        f = weight * force_at(angle, rng.normal(size=2))
        assert producible(given, np.append(f, np.zeros(3)))
    beyond = weight * force_at(t + 1e-4, np.array(hover.tilt_weakest[:2]))
    assert not producible(given, np.append(beyond, np.zeros(3)))


def test_the_largest_tilt_does_not_imply_smaller_ones() -> None:
    """A facet cuts arcs between 4 and 6 degrees alone."""
    d, up = force_at(math.radians(5.0), np.array([1.0, 0.0])), np.array([0.0, 0.0, 1.0])
    s = math.cos(math.radians(1.0))
    assert d @ force_at(math.radians(10.0), np.array([1.0, 0.0])) < s
    (t,) = half_angles(d[None], np.array([s - d @ up]), up)
    assert math.degrees(t) == pytest.approx(4.0, abs=1e-9)
    assert half_angles(d[None], np.array([1.001 - d @ up]), up) == pytest.approx(math.pi)


@pytest.mark.parametrize("seed", few(ABLE[:3], 1))
def test_accelerations_about_each_axis_can_be_had_either_way_and_no_more_one_way(seed: int) -> None:
    given = drawn(seed)
    J = inertia_about_com(given)
    for case, b in zip(flight(given).cases, asked(given), strict=True):
        for k, a in enumerate(case.angular_acceleration_rad_s2):
            assert a > 0.1
            added = np.append(np.zeros(3), J[:, k] * a)
            assert producible(given, b + 0.9999 * added)
            assert producible(given, b - 0.9999 * added)
            assert not (producible(given, b + 1.0001 * added) and producible(given, b - 1.0001 * added))
            assert a <= case.angular_acceleration_at_most_rad_s2[k] <= a * (1 + 1e-6)


@pytest.mark.filterwarnings("ignore:Importing from numpy.matlib")
@pytest.mark.parametrize("given", ["wall-push", "survives-a-rotor", *few(THREE, 2)])
def test_reserves_are_distances_to_facets_that_pycapacity_enumerates(given: str | int) -> None:
    """Shipped designs, and random platforms of three modules."""
    from pycapacity.algorithms import hyper_plane_shift_method

    file = Path(__file__).parent / f"designs/{given}.json"
    given = drawn(given, 3) if isinstance(given, int) else read_json(Design, file)
    at, task = platform(given), given.task
    unit = np.repeat([task.force_unit(3), task.torque_unit(3)], 3)
    A = wrench_map(at, task.module) * task.module.max_input(task.gravity) / unit[:, None]
    normals, offsets = map(np.array, hyper_plane_shift_method(A, np.zeros(12), np.ones(12)))
    found = flight(given)
    assert found.hover.possible
    for case, b in zip(found.cases, asked(given), strict=True):
        rest = offsets.ravel() - normals @ (b / unit)
        for what, reserve, _ in reserves(case):
            columns = np.array(
                [added(what, x, at.p_e) / unit for x in np.eye(3)[: 2 if "horizontal" in what else 3]]
            )
            sizes = np.linalg.norm(normals @ columns.T, axis=1)
            assert reserve == pytest.approx((rest[sizes > 1e-9] / sizes[sizes > 1e-9]).min(), rel=1e-5)


@pytest.mark.parametrize("seed", few(ABLE, 2))
def test_the_pseudo_inverse_stays_within_limits_up_to_its_reserves_and_not_beyond(seed: int) -> None:
    given = drawn(seed)
    task, at, J = given.task, platform(given), inertia_about_com(given)
    A = wrench_map(at, task.module) * task.module.max_input(task.gravity)
    unit = np.repeat([task.force_unit(5), task.torque_unit(5)], 3)
    inverse = np.linalg.pinv(A / unit[:, None]) / unit

    def within(b: Array) -> bool:
        v = inverse @ b
        return bool(np.all(v >= -1e-12) and np.all(v <= 1 + 1e-12))

    rng = np.random.default_rng(seed)
    for case, b in zip(flight(given).cases, asked(given), strict=True):
        for name, best, _ in reserves(case):
            which, _, place = name.partition("_")
            field = f"{which}_reserve{place and '_' + place}_{'Nm' if name == 'torque' else 'N'}"
            size = getattr(case, f"{field}_pseudo_inverse")
            assert 0 <= size <= best * (1 + 1e-9) + 1e-6
            turns = rng.normal(size=(3000, 3)) * ([1, 1, 0] if name.startswith("horizontal") else 1)
            turns /= np.linalg.norm(turns, axis=1, keepdims=True)
            wrenches = [added(name, x, at.p_e) for x in turns]
            assert all(within(b + 0.9999 * size * w) for w in wrenches) == within(b)
            assert not all(within(b + (1.1 * size + 1e-6) * w) for w in wrenches)
        for k, a in enumerate(case.angular_acceleration_rad_s2_pseudo_inverse):
            turn = np.append(np.zeros(3), J[:, k])
            assert 0 <= a <= case.angular_acceleration_rad_s2[k] * (1 + 1e-6)
            ways = [within(b + sign * 0.9999 * a * turn) for sign in (1, -1)]
            assert all(ways) == within(b)
            assert not all(within(b + sign * (1.0001 * a + 1e-6) * turn) for sign in (1, -1))
        if case.name == "hover":
            t = math.radians(case.tilt_deg_pseudo_inverse)
            assert t <= math.radians(case.tilt_deg) + 1e-6
            arcs = np.linspace(0.0, 2 * math.pi, 1441)
            for angle in np.linspace(0.0, 0.9999 * t, 9):
                forces = [b[2] * force_at(angle, np.array([math.cos(e), math.sin(e)])) for e in arcs]
                assert all(within(np.append(f, np.zeros(3))) for f in forces) == within(b)
            beyond = [b[2] * force_at(t + 1e-3, np.array([math.cos(e), math.sin(e)])) for e in arcs]
            assert not all(within(np.append(f, np.zeros(3))) for f in beyond)


@pytest.mark.parametrize(
    ("name", "tip", "com", "tilt_deg"),
    [("wall-push", 0.1356, 0.2768, 8.170), ("window-cleaning", 0.1327, 0.3239, 9.217)],
)
def test_reserves_of_1_08_newtons_are_lost_by_the_pseudo_inverse_and_at_a_tilt_of_ten_degrees(
    name: str, tip: float, com: float, tilt_deg: float
) -> None:
    found = flight(read_json(Design, Path(__file__).parent / f"designs/{name}.json")).hover
    assert found.force_reserve_N >= 1.0
    assert found.force_reserve_N_pseudo_inverse == pytest.approx(tip, abs=1e-4)
    assert found.force_reserve_com_N_pseudo_inverse == pytest.approx(com, abs=1e-4)
    assert found.tilt_deg == pytest.approx(tilt_deg, abs=1e-3)


def test_a_wrench_that_no_inputs_exert_is_no_reserve_of_the_pseudo_inverse() -> None:
    flat = flight(design(FAN, {"module": {"max_thrust_to_weight": 2.0}}, hinges=(0.0, 0.0))).hover
    names = "force_reserve_com_N", "horizontal_reserve_N", "tilt_deg"
    assert [getattr(flat, f"{name}_pseudo_inverse") for name in names] == [0.0, 0.0, 0.0]
    assert flat.torque_reserve_Nm_pseudo_inverse > 0
    assert min(flat.angular_acceleration_rad_s2_pseudo_inverse) > 0


def test_tilt_and_accelerations_are_required_where_a_task_asks_for_them() -> None:
    given = drawn(ABLE[0])
    hover = flight(given).hover
    a = hover.angular_acceleration_rad_s2
    for share, status in ((0.99, "clear"), (1.01, "violated")):
        demand = {"tilt_deg": share * hover.tilt_deg, "angular_acceleration": [0.0, share * a[1], 0.0]}
        task = given.task.model_dump(mode="json") | {"flight": {"units": "SI", **demand}}
        rows = {row.name: row for row in audit(changed(given, task=task)).residuals}
        told = [rows[name] for name in ("hover, tilt", "hover, angular acceleration about y")]
        assert [(row.status, row.unit) for row in told] == [(status, "deg"), (status, "rad/s^2")]
        task["flight"]["allocator"] = "pseudo-inverse"
        rows = {row.name: row for row in audit(changed(given, task=task)).residuals}
        told = [rows[name] for name in ("hover, tilt", "hover, angular acceleration about y")]
        known = [hover.tilt_deg_pseudo_inverse, hover.angular_acceleration_rad_s2_pseudo_inverse[1]]
        assert [row.derived for row in told] == pytest.approx(known, rel=1e-9)
        assert [row.status for row in told] == ["violated", "violated"]
        assert not any("about x" in name for name in rows)


@pytest.mark.parametrize("seed", few(ABLE[:3], 1))
def test_the_centre_of_mass_may_be_off_by_so_much_along_each_axis_and_no_more(seed: int) -> None:
    given = drawn(seed)
    for case, b in zip(flight(given).cases, asked(given), strict=True):
        force = np.array([0.0, 0.0, given.task.force_unit(5)])  # at the centre of mass in each case

        def possible(e: float, b: Array = b, force: Array = force) -> list[bool]:
            return [producible(given, b + np.append(np.zeros(3), np.cross(e * c, force))) for c in CUBE]

        assert case.com_error_m > 1e-4
        assert all(possible(0.9999 * case.com_error_m))
        assert not all(possible(1.0001 * case.com_error_m))
        assert case.com_error_m <= case.com_error_at_most_m <= case.com_error_m * (1 + 1e-6)
        assert case.com_error_m_pseudo_inverse <= case.com_error_m * (1 + 1e-6)


def test_reserves_are_those_left_wherever_the_centre_of_mass_may_be() -> None:
    given, rng = drawn(ABLE[1]), np.random.default_rng(0)
    nominal = flight(given).hover
    e = 0.8 * nominal.com_error_m_pseudo_inverse
    task = given.task.model_dump(mode="json") | {"flight": {"units": "SI", "com_error": e}}
    hover, (b, *_) = flight(changed(given, task=task)).hover, asked(given)
    p_E, J = platform(given).p_e, inertia_about_com(given)
    a = np.array(hover.angular_acceleration_rad_s2)
    assert np.all(a < nominal.angular_acceleration_rad_s2)
    assert hover.tilt_deg < nominal.tilt_deg
    assert 0 < hover.tilt_deg_pseudo_inverse < nominal.tilt_deg_pseudo_inverse
    sizes = {name: size for name, size, _ in reserves(hover)}
    fallen = [name for name, size, _ in reserves(nominal) if sizes[name] < 0.99 * size]
    assert {"torque", "horizontal_com"} <= {*fallen}
    short = dict.fromkeys([*sizes, "turn"], 0)
    for c in (*(e * CUBE), *rng.uniform(-e, e, (12, 3))):

        def leaves(wrench: Array, c: Array = c) -> bool:
            """True if a wrench about the centre of mass at c can be produced besides hover."""
            force, torque = (b + wrench)[:3], (b + wrench)[3:]
            return producible(given, np.append(force, torque + np.cross(c, force)))

        for name, r, weakest in reserves(hover):
            x = rng.normal(size=3) * ([1, 1, 0] if name.startswith("horizontal") else 1)
            assert leaves(0.9999 * r * added(name, x / np.linalg.norm(x), p_E - c))
            short[name] += not leaves(1.001 * r * added(name, np.array(weakest), p_E - c))
        for axis, turn in zip(a, np.hstack([np.zeros((3, 3)), J.T]), strict=True):
            short["turn"] += not all(leaves(1.001 * way * axis * turn) for way in (1, -1))
            assert all(leaves(0.9999 * way * axis * turn) for way in (1, -1))
    assert min(short.values()) > 0


def test_an_error_of_the_centre_of_mass_is_required_where_a_task_asks_for_it() -> None:
    given = drawn(ABLE[1])
    known = flight(given).hover
    figures = {"optimal": known.com_error_m, "pseudo-inverse": known.com_error_m_pseudo_inverse}
    for allocator, most in figures.items():
        for share, status in ((0.99, "clear"), (1.01, "violated")):
            demand = {"com_error": share * most, "allocator": allocator, "torque_reserve": 1e-4}
            task = given.task.model_dump(mode="json") | {"flight": {"units": "SI", **demand}}
            rows = {row.name: row for row in audit(changed(given, task=task)).residuals}
            error, torque = rows["hover, error of the centre of mass"], rows["hover, torque reserve"]
            assert (error.status, error.unit, error.derived) == (status, "m", pytest.approx(most, rel=1e-9))
            assert (torque.status, torque.derived > 0) == (status, status == "clear")


def test_the_weight_does_not_grow_with_the_load() -> None:
    """A platform that lifts s weights lifts s - 1 of them besides its own."""
    hold = {"name": "hold", "carries_weight": True, "com": {"force": [0.0, 0.0, 0.5]}}
    whole = {"com": {"force": [0.0, 0.0, 0.5]}}
    hover, *found = (case.load_factor for case in flight(fan({"load_cases": [hold, whole]})).cases)
    assert found == pytest.approx([(hover - 1) / 0.5, hover / 0.5], rel=1e-6)


def test_parallel_rotors_have_no_side_force_and_a_known_load_factor() -> None:
    module = {"max_thrust_to_weight": 2.0}
    flat = design(FAN, {"module": module}, hinges=(0.0, 0.0))
    found = flight(flat)
    hover, task = found.hover, flat.task
    assert hover.possible
    assert (hover.force_reserve_N, hover.horizontal_reserve_N) == (0.0, 0.0)
    assert abs(hover.force_weakest[2]) < 1e-6
    # the tip is above the COM, so that nothing turns the platform: all rotors grow alike
    most = 3 * 2.0 * task.module.mass / task.total_mass(3)
    assert hover.load_factor == pytest.approx(most, rel=1e-7)
    assert found.hover_power_ratio == pytest.approx(1, rel=1e-6)
    assert found.hover_input == pytest.approx(1 / most, rel=1e-7)
    assert found.span_m == pytest.approx(math.hypot(4 * 0.15 + math.sqrt(2) * 0.1, math.sqrt(2) * 0.1) + 0.1)


def test_one_module_loses_hover_with_any_rotor() -> None:
    found = flight(design(Topology(((-1, -1, -1),)), {}, hinges=()))
    assert found.rotors_out_hover.lost == ((0, 0), (0, 1), (0, 2), (0, 3))
    assert found.joints == ()
    assert found.joint_moment_Nm is None


def test_a_platform_that_cannot_hover_says_so() -> None:
    given = fan({"module": {"max_thrust_to_weight": 0.9}, "load_cases": [{"com": {"force": [0.0, 0.0, 0.1]}}]})
    found = flight(given)
    assert found.hover.possible is False
    assert found.hover.force_reserve_N is None
    assert found.hover_input is None
    assert found.rotors_out_hover.survive == 0
    assert found.weakest_point == "cannot hover"
    assert found.cases[1].possible
    assert {load.case for load in found.joints} == {"load case 0"}


@pytest.mark.parametrize(("seed", "n"), [(ABLE[0], 5), (ABLE[4], 5), (THREE[4], 3)])
def test_a_mirrored_platform_has_mirrored_figures(seed: int, n: int) -> None:
    """Across y: ports +y and -y change places, hinges at them and psi, alpha_0 change sign; torques are axial."""
    given = drawn(seed, n, load_cases=[{**PUSH, "com": {"force": [0.0, 0.0, 1.0], "torque": [0.03, 0.02, 0.01]}}])
    swapped = (0, 3, 2, 1)
    rows = [(h, swapped[a], swapped[b]) if h >= 0 else (h, a, b) for h, a, b in given.topology.joints]
    signs = [1 if a % 2 == 0 else -1 for _, _, a, _ in given.topology.edges()]
    psi, alpha_0, alpha_1 = given.root_orientation_rad
    x, y, z = given.end_effector_m
    pushed = {"end_effector": {"force": [0.01, -0.005, 0.0]}}
    other = design(
        Topology(tuple(rows)),
        {
            "module": MODULE,
            "load_cases": [{**pushed, "com": {"force": [0.0, 0.0, 1.0], "torque": [-0.03, 0.02, -0.01]}}],
        },
        hinges=tuple(sign * alpha for sign, alpha in zip(signs, given.hinge_angles_rad, strict=True)),
        root=(-psi, -alpha_0, alpha_1),
        end_effector=(x, -y, z),
    )
    one, mirrored = flight(given), flight(other)
    axial = {"torque": [-1, 1, -1]}
    for a, b in zip(one.cases, mirrored.cases, strict=True):
        assert a.possible == b.possible
        for (name, size, v), (_, same, w) in zip(reserves(a), reserves(b), strict=True):
            assert same == pytest.approx(size, abs=1e-6), name
            assert np.allclose(w, np.array(axial.get(name, [1, -1, 1])) * v, atol=1e-5), name
        assert b.load_factor == (None if a.load_factor is None else pytest.approx(a.load_factor, rel=1e-6))
    for a, b in ((one.rotors_out_hover, mirrored.rotors_out_hover), (one.rotors_out_all, mirrored.rotors_out_all)):
        assert {(i, 3 - q) for i, q in a.lost} == set(b.lost)
    for before, after in zip(one.joints, mirrored.joints, strict=True):
        assert after.moment_Nm == pytest.approx(before.moment_Nm, rel=1e-6)
        assert after.about_hinge_Nm == pytest.approx(before.about_hinge_Nm, rel=1e-5, abs=1e-9)
    assert one.rotors_out_hover.survive > 0


@pytest.mark.parametrize("seed", few(range(5), 2))
@pytest.mark.parametrize("connectors", ["aligned", "any"])
def test_joints_bear_what_mujoco_measures(seed: int, connectors: Any) -> None:
    rng = np.random.default_rng(seed)
    (tree,) = sample(5, 1, seed, connectors=connectors)
    case = {
        "end_effector": {"force": [0.3, -0.2, 0.1], "torque": [0.2, 0.1, -0.3]},
        "com": {"force": [0.1, 0.0, 0.7], "torque": [0.0, 0.4, 0.0]},
    }
    module, port = list(tree.free_connectors)[int(rng.integers(len(list(tree.free_connectors))))]
    given = design(
        tree,
        {
            "load_cases": [case],
            "search": {"connectors": connectors},
            "module": {"body": {"inertia": [2e-3, 1e-3, 2.5e-3]}},
        },
        hinges=tuple(rng.uniform(-1.5, 1.5, 4).tolist()),
        root=(1.0, 0.4, -0.3),
        end_effector=(0.5, -0.6, 0.7),
    )
    u = rng.uniform(0, given.task.max_input, 20)  # nothing in equilibrium
    given = changed(
        given, mount={"module": module, "port": port}, rotor_speeds_squared=[u.tolist()], objective=float(u @ u)
    )
    measured = by_mujoco(given, module, u.reshape(-1, 4))
    loads = [load for load in flight(given).joints if load.case == "load case 0"]
    assert len(loads) == len(measured) == 4
    for load, (force, moment, about) in zip(loads, measured, strict=True):
        assert load.force_N == pytest.approx(force, rel=1e-6)
        assert load.moment_Nm == pytest.approx(moment, rel=1e-6)
        assert load.about_hinge_Nm == pytest.approx(abs(about), rel=1e-5, abs=1e-9)
        assert load.across_hinge_Nm == pytest.approx(math.sqrt(moment**2 - about**2), rel=1e-5)


def by_mujoco(given: Design, holder: int, u: Array) -> list[tuple[float, float, float]]:
    """Force, moment and moment about the hinge in every joint: bodies without joints, cut by MuJoCo's own sensors.

    Thrusts and drags act on modules, the reaction on the end-effector; gravity is MuJoCo's. Each module's frame has
    its origin at the connector that holds it, so that the sensor there reads moments about the connector.
    """
    task, at, tree = given.task, platform(given), given.topology
    module, l_c = task.module, task.module.connector_distance
    ports = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    origins, children = [np.zeros(3)], {i: [] for i in range(tree.n)}
    for h, i, a, _ in tree.edges():
        origins.append(at.p[h] + l_c * at.R[h] @ ports[a])
        children[h].append(i)

    def text(v: Array) -> str:
        return " ".join(repr(float(x)) for x in v)

    def body(i: int, parent: Array) -> str:
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, at.R[i].ravel())
        centre = f'pos="{text(at.p[i] - origins[i])}" quat="{text(quaternion)}"'
        inertial = f'<inertial {centre} mass="{module.mass}" diaginertia="{text(np.array(module.inertia))}"/>'
        inside = "".join(body(j, origins[i]) for j in children[i])
        if i == holder:
            place = text(np.array(given.end_effector_m) - origins[i])
            point = f'<inertial pos="0 0 0" mass="{task.end_effector.mass}" diaginertia="0 0 0"/>'
            inside += f'<body name="tip" pos="{place}">{point}</body>'
        free = "" if i else "<freejoint/>"
        site = f'<site name="s{i}"/>'
        return f'<body name="b{i}" pos="{text(origins[i] - parent)}">{free}{inertial}{site}{inside}</body>'

    sensors = "".join(f'<force site="s{i}"/><torque site="s{i}"/>' for i in range(1, tree.n))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 {-task.gravity}"/><worldbody>{body(0, np.zeros(3))}</worldbody>'
        f"<sensor>{sensors}</sensor></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    q = np.array([-1.0, 1.0, -1.0, 1.0])
    arms = module.arm_length / math.sqrt(2) * np.array([[1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]])
    for i in range(tree.n):
        z = at.R[i][:, 2]
        thrusts = module.thrust_coefficient * u[i]
        torque = sum(np.cross(at.R[i] @ arm, thrust * z) for arm, thrust in zip(arms, thrusts, strict=True))
        torque = torque + module.torque_coefficient * (q @ u[i]) * z
        data.body(f"b{i}").xfrc_applied[:] = [*(thrusts.sum() * z), *torque]
    (case,) = task.load_cases
    data.body("tip").xfrc_applied[:] = np.negative([*case.at_end_effector.force, *case.at_end_effector.torque])
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    mujoco.mj_sensorAcc(model, data)
    found = []
    for (h, i, a, _), load in zip(tree.edges(), data.sensordata.reshape(-1, 6), strict=True):
        axis = at.R[h][:, 1 if a % 2 == 0 else 0]
        turned = data.site(f"s{i}").xmat.reshape(3, 3)
        moment = turned @ load[3:]
        found.append((float(np.linalg.norm(load[:3])), float(np.linalg.norm(moment)), float(moment @ axis)))
    return found


def test_an_audit_with_its_flight_is_written_and_read_again() -> None:
    found = audit(drawn(ABLE[3]))
    assert Audit.model_validate_json(found.model_dump_json()) == found
    assert Audit.model_validate({**found.model_dump(mode="json"), "flight": None}).flight is None


def test_accelerations_of_a_platform_that_cannot_hover_are_three_zeros() -> None:
    """Its nominal case has none either; the centre of mass may be off all the same."""
    flight = audit(fan({"flight": {"com_error": 1e-3}, "module": {"max_thrust_to_weight": 1.01}})).flight
    assert flight is not None
    assert flight.hover.possible is False
    assert flight.hover.angular_acceleration_rad_s2 == (0.0, 0.0, 0.0)
    assert type(flight).model_validate_json(flight.model_dump_json()) == flight


def test_figures_that_overflow_are_left_out() -> None:
    assert audit(fan(end_effector=(1e200, 0.0, 0.0))).flight is None
    weak = fan({"module": {"thrust_coefficient": 1e12}})
    inputs = [1e308, -1e308, *weak.rotor_speeds_squared[0][2:]]
    found = flight(changed(weak, rotor_speeds_squared=[inputs])).cases[1]
    assert (found.largest_input, found.least_input) == (sys.float_info.max, -sys.float_info.max)


def test_hover_is_told_of_a_task_that_never_asks_for_it() -> None:
    found = flight(fan({"load_cases": [{"com": {"force": [0.0, 0.0, 1.1]}}, HOVER]}))
    assert [case.name for case in found.cases] == ["hover", "load case 0", "load case 1"]
    for a, b in zip(reserves(found.hover), reserves(found.cases[2]), strict=True):
        assert a[1] == b[1]
    assert found.load_factor == found.cases[2].load_factor
    growth = (found.load_factor - 1.0) / 0.1  # of what the first case asks for beside the weight
    assert found.cases[1].load_factor == pytest.approx(growth, rel=1e-9)
