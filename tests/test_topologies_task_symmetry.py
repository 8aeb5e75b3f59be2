"""Which tasks are their own mirror image, and what follows for the candidates."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from typing import Any

import numpy as np
import pytest
import trimesh
from nlp_cases import HOVER
from nlp_cases import PUSH as PUSH_CASES
from nlp_cases import push as push_task
from numpy.typing import NDArray
from older import older_task

from nlp import solve
from topo_search.model import Design, EndEffector, LoadCase, ResolvedTask, Search, Topology, Wrench
from topo_search.model.exposure import Allowed, Directional, Exterior, Local, Plane
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates, count, improper_isometry, resolve_symmetry
from topo_search.topologies.rooted import image, key_of, rooted_of, text_of

Array = NDArray[np.float64]
PUSH = (([0.5, 0, 0.5], None), ([0, 0.5, 0.5], None))
EXCHANGE = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])


def task_of(
    *cases: tuple[Any, Any],
    com: tuple[Any, ...] = (),
    weights: Sequence[float] | None = None,
    position: Any = "free",
    exposure: tuple[Any, ...] = (),
    **search: Any,
) -> ResolvedTask:
    """A task with these (force, torque) at the end-effector, then at the COM."""
    wrenches = [
        {place: Wrench(force=tuple(map(float, f)), torque=tuple(map(float, tau if tau is not None else (0, 0, 0))))}
        for place, rows in (("end_effector", cases), ("com", com))
        for f, tau in rows
    ]
    weights = weights or [1.0] * len(wrenches)
    return older_task(
        name="made",
        modules=5,
        load_cases=tuple(
            LoadCase(**wrench, weight=weight) for wrench, weight in zip(wrenches, weights, strict=True)
        ),
        end_effector=EndEffector(position=position),
        exposure=exposure,
        search=Search(**search),
    ).resolve(5)


def bent(*paths: Any) -> Directional:
    """Bent paths, points as whole numbers or not."""
    return Directional(polylines=tuple(tuple(tuple(map(float, point)) for point in path) for path in paths))


def below(*planes: tuple[float, float, float, float]) -> Allowed:
    """Half-spaces, (normal, offset) each."""
    return Allowed(
        planes=tuple(Plane(normal=(float(x), float(y), float(z)), offset=offset) for x, y, z, offset in planes)
    )


def maps_load_cases_onto_themselves(O: Array, task: ResolvedTask) -> bool:
    """Straight from the definition, on raw load cases: force -> O f, torque -> det(O) O tau."""

    def rows(image: Array, sign: float) -> list[Array]:
        return [
            np.concatenate(
                [
                    image @ case.at_end_effector.force,
                    image @ case.at_com.force,
                    sign * image @ np.add(case.at_end_effector.torque, case.at_com.torque) / 0.1,
                    [case.weight],
                ]
            )
            for case in task.load_cases
        ]

    before, after = rows(np.eye(3), 1.0), rows(O, np.linalg.det(O))
    return all(sum(np.allclose(a, b, atol=1e-7) for b in before) == 1 for a in after)


def random_rotation(rng: np.random.Generator) -> Array:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.linalg.det(Q)


@pytest.mark.parametrize(
    ("name", "classes"),
    [
        ("push", 28),
        ("push-exterior-90", 28),
        ("push-directional", 49),
        ("ten-wrenches", 49),
    ],
)
def test_shipped_examples(name: str, classes: int) -> None:
    task = read_task(name).resolve(5)
    O = improper_isometry(task)
    assert (O is None) == (classes == 49)
    if O is not None:
        np.testing.assert_allclose(O, EXCHANGE, atol=1e-12)
    listed = list(candidates(5, symmetry="task", task=task))
    assert len(listed) == count(5, symmetry="task", task=task) == classes
    assert sum(candidate.orbit for candidate in listed) == 49


def test_the_sizes_of_the_push_task() -> None:
    for n, mirrored in ((4, 10), (6, 120), (7, 507)):
        assert count(n, symmetry="task", task=read_task("push").resolve(n)) == mirrored


def test_connectors_and_root_of_a_symmetric_task() -> None:
    any_port = task_of(*PUSH, connectors="any")
    listed = list(candidates(4, symmetry="task", connectors="any", task=any_port))
    assert len(listed) == 58
    assert Counter(candidate.orbit for candidate in listed) == {1: 22, 2: 36}
    assert resolve_symmetry(any_port).exact
    paper = task_of(*PUSH, root="paper")
    rooted = list(candidates(5, symmetry="task", root="paper", task=paper))
    assert len(rooted) == 455
    assert {candidate.orbit for candidate in rooted} == {1}


@pytest.mark.parametrize("seed", range(5))
def test_turning_the_task_turns_its_isometry(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R = random_rotation(rng)
    torques = rng.normal(size=3)
    mirrored = -EXCHANGE @ torques
    task = task_of(
        (R @ [0.5, 0, 0.5], R @ torques),
        (R @ [0, 0.5, 0.5], R @ mirrored),
        com=((R @ [0, 0, 1.0], None),),
        exposure=(Directional(segments=(tuple(R @ [1, 0, 0]), tuple(R @ [0, 1, 0]))), Local()),
    )
    O = improper_isometry(task)
    np.testing.assert_allclose(O, R @ EXCHANGE @ R.T, atol=1e-9)
    assert maps_load_cases_onto_themselves(O, task)
    assert not O.flags.writeable


@pytest.mark.parametrize("kind", ["reflection", "point reflection", "rotary reflection"])
@pytest.mark.parametrize("seed", range(4))
def test_orbits_of_any_improper_isometry_are_symmetric_and_torques_are_pseudovectors(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    R = random_rotation(rng)
    plain = {
        "reflection": np.diag([1.0, 1, -1]),
        "point reflection": -np.eye(3),
        "rotary reflection": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, -1]]),
    }[kind]
    O = R @ plain @ R.T
    order = 4 if kind == "rotary reflection" else 2
    drawn = rng.normal(size=(3, 2, 3))
    right, wrong = [], []
    for force, torque in drawn:
        for _ in range(order):
            right.append((force, torque))
            force, torque = O @ force, -O @ torque
        for _ in range(order):
            wrong.append((force, torque))
            force, torque = O @ force, O @ torque
    order_of_cases = rng.permutation(len(right))
    task = task_of(*(right[i] for i in order_of_cases))
    found = improper_isometry(task)
    assert np.linalg.det(found) == pytest.approx(-1)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)
    assert maps_load_cases_onto_themselves(found, task)
    words = {"reflection": "reflection along", "rotary reflection": "with a turn of 90 deg"}.get(kind, kind)
    assert words in resolve_symmetry(task).reason
    assert improper_isometry(task_of(*wrong)) is None


@pytest.mark.parametrize(
    ("cases", "symmetric"),
    [
        ([([0, 0, 1], None)], True),  # on a line: every plane that holds it
        ([([0, 0, 1], [0, 0, 1])], False),  # a screw has a handedness
        ([([0, 0, 1], [0, 0, 1]), ([0, 0, 1], [0, 0, -1])], True),
        ([([0, 0, 1], [1, 0, 0])], True),  # a torque is mirrored in the planes along it with a change of sign
        ([([0, 0, 0], [0, 0, 1])], True),  # a pure torque: the plane across it
        ([([0, 0, 0], None)], True),
        ([([1, 0, 0], None), ([0.3, 0, 1], None)], True),  # forces in a plane
        ([([1, 0, 0], None), ([0.3, 0, 1], [0, 0.2, 0])], True),  # torque across the plane: kept
        ([([1, 0, 0], None), ([0.3, 0, 1], [0.2, 0, 0])], False),  # torque in the plane: reversed
        ([([1, 0, 0], None), ([0.3, 0, 1], [0.2, 0, 0]), ([0.3, 0, 1], [-0.2, 0, 0])], True),
        ([([1, 0, 0], None), ([0, 1, 0], None), ([0, 0, 1], None)], True),
        ([([1, 0, 0], None), ([0, 2, 0], None), ([0, 0, 3], None)], False),  # all of space, all different
        ([([1, 0, 0], None), ([0, 2, 0], None), ([0, 0, 3], None), ([-1, 0, 0], None)], True),
        ([([0, 0, 1], [0, 0, 1]), ([1, 0, 0], None), ([-1, 0, 0], None)], False),
        ([([0, 0, 1], [0, 0, 1]), ([0, 0, -1], [0, 0, 1]), ([1, 0, 0], None)], True),
    ],
)
def test_small_sets_of_wrenches(cases: list[tuple[Any, Any]], symmetric: bool) -> None:
    rng = np.random.default_rng(1)
    for R in (np.eye(3), random_rotation(rng), random_rotation(rng)):
        task = task_of(*((R @ f, None if tau is None else R @ tau) for f, tau in cases))
        O = improper_isometry(task)
        assert (O is not None) == symmetric
        assert O is None or maps_load_cases_onto_themselves(O, task)
        assert resolve_symmetry(task).group == ("d2" if symmetric else "c2")


def test_weights_count_and_equal_load_cases_count_as_one() -> None:
    lift = ([0, 0, 1], None)
    assert improper_isometry(task_of(*PUSH, lift, weights=[2.0, 2.0, 1.0])) is not None
    assert improper_isometry(task_of(*PUSH, lift, weights=[1.0, 2.0, 1.0])) is None
    assert improper_isometry(task_of(*PUSH, lift, PUSH[0], weights=[1.0, 3.0, 1.0, 2.0])) is not None
    assert improper_isometry(task_of(*PUSH, lift, PUSH[0])) is None


def test_the_place_of_a_force_counts_and_that_of_a_torque_does_not() -> None:
    hover = (([0, 0, 1], None),)
    assert improper_isometry(task_of(*PUSH, com=hover)) is not None
    assert improper_isometry(task_of(PUSH[0], com=(PUSH[1], *hover))) is None
    assert improper_isometry(task_of(PUSH[0], com=(PUSH[1], *hover), position="com")) is not None
    along_x, along_y = [1, 0, 0], [0, -1, 0]
    nowhere = [0, 0, 0]
    assert improper_isometry(task_of((nowhere, along_x), com=((nowhere, along_y),))) is not None


@pytest.mark.parametrize(
    ("position", "symmetric"),
    [("com", True), ((0.1, 0.1, -0.3), True), ((0.1, -0.1, 0.0), False), ((0.0, 0.0, 0.2), True)],
)
def test_a_fixed_end_effector_stays_where_it_is(position: Any, symmetric: bool) -> None:
    task = task_of(*PUSH, com=(([0, 0, 1], None),), position=position)
    assert (improper_isometry(task) is not None) == symmetric


@pytest.mark.parametrize(
    ("exposure", "symmetric"),
    [
        ((Directional(segments=((1.0, 0.0, 0.0),)),), False),
        ((Directional(segments=((1.0, 1.0, -1.0),)),), True),
        ((Directional(segments=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),), True),
        ((Directional(segments=((1.0, 0.0, 0.0),)), Directional(segments=((0.0, 1.0, 0.0),))), True),
        ((Directional(segments=((1.0, 0.0, 0.0),)), Directional(radius=0.1, segments=((0.0, 1.0, 0.0),))), False),
        ((Directional(along="end_effector", length=1.0), Local(), Exterior()), True),
        ((Exterior(axis=(2.0, 0.0, 0.0)), Exterior(axis=(0.0, 3.0, 0.0))), True),
        ((Exterior(axis=(2.0, 0.0, 0.0)), Exterior(half_angle_deg=61.0, axis=(0.0, 3.0, 0.0))), False),
        ((bent(((0.5, 0, 0), (0, 0.5, 0))),), True),  # onto itself, the other way round
        ((bent(((0.5, 0, 0), (0, 0.6, 0))),), False),
        ((bent(((0.5, 0, 0), (1, 0, 1)), ((0, 1, 1), (0, 0.5, 0))),), True),
        ((bent(((0.5, 0, 0), (1, 0, 1)), ((0, 1, 1), (0, 0.5, 0.1))),), False),
        ((below((1, 0, 0, 0.1), (0, 2, 0, 0.2)),), True),
        ((below((1, 0, 0, 0.1), (0, 1, 0, 0.2)),), False),
        ((below((1, 1, 0, -0.1)), Exterior(axis=(-1.0, -1.0, 0.0))), True),
        ((Local(box=(0.4, 0.4, 0.2)),), True),
        ((Local(box=(0.4, 0.3, 0.2)),), False),
        ((Local(vertices=((0.1, 0.2, 0), (0.2, 0.1, 0), (-0.1, -0.1, 0), (0, 0, 0.3))),), True),
        ((Local(vertices=((0.1, 0.2, 0), (0.2, 0, 0), (-0.1, -0.1, 0), (0, 0, 0.3))),), False),
    ],
)
def test_exposure_requirements_are_mapped_onto_themselves(exposure: tuple[Any, ...], symmetric: bool) -> None:
    task = task_of(*PUSH, com=(([0, 0, 1], None),), exposure=exposure)
    assert (improper_isometry(task) is not None) == symmetric


def test_what_is_lossy_says_so() -> None:
    push, directional = (read_task(name).resolve(5) for name in ("push", "push-directional"))
    paper = task_of(*PUSH, root="paper")
    exact = {name: resolve_symmetry(push, name).exact for name in ("task", "none", "c2", "d2", "c4", "d4")}
    assert exact == {"task": True, "none": True, "c2": True, "d2": True, "c4": False, "d4": False}
    assert "reflection" in resolve_symmetry(push).reason
    assert not resolve_symmetry(directional, "d2").exact
    assert "lossy: " in resolve_symmetry(directional, "d2").reason
    assert "no mirror symmetry" in resolve_symmetry(directional).reason
    assert resolve_symmetry(paper).exact
    assert not resolve_symmetry(paper, "c2").exact
    with pytest.raises(ValueError, match="symmetry must be one of"):
        resolve_symmetry(push, "d3")  # type: ignore[arg-type]


@pytest.mark.parametrize("wrench", [([0, 0, 1], None), ([0, 0, 0], [0, 0, 1]), ([0, 0, 0], None)])
def test_where_many_isometries_would_do_a_plain_reflection_is_named(wrench: tuple[Any, Any]) -> None:
    assert "reflection along" in resolve_symmetry(task_of(wrench)).reason
    assert "turn of" not in resolve_symmetry(task_of(wrench)).reason


@pytest.mark.parametrize("seed", range(12))
def test_each_quantity_is_compared_on_its_own_scale(seed):
    """Mirror pairs of everything, sizes up to 1e12 apart: a thousandth off any one is not symmetric."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    O = turn @ np.diag([1.0, 1.0, -1.0]) @ turn.T

    def vector():
        return 10.0 ** rng.uniform(-6, 6) * rng.normal(size=3)

    forces, torques, paths = ([vector() for _ in range(2)] for _ in range(3))
    corners = [vector() for _ in range(4)]
    given = [*forces, *(O @ f for f in forces), *torques, *(-O @ tau for tau in torques)]
    given += [*paths, *(O @ end for end in paths), *corners, *(O @ corner for corner in corners)]

    def symmetric(values):
        cases = [
            LoadCase(end_effector=Wrench(force=tuple(f), torque=tuple(tau)), units="SI")
            for f, tau in zip(values[:4], values[4:8], strict=True)
        ]
        exposure = (
            Directional(radius=0.1, segments=tuple(tuple(end) for end in values[8:12])),
            Local(vertices=tuple(tuple(corner) for corner in values[12:])),
        )
        return (
            improper_isometry(
                older_task(name="mixed", modules=3, load_cases=tuple(cases), exposure=exposure).resolve(3)
            )
            is not None
        )

    assert symmetric(given)
    for broken in range(12):  # a corner may lie inside the others' hull: those are left as they are
        off = [np.array(value) for value in given]
        off[broken] = off[broken] + 1e-3 * np.linalg.norm(off[broken]) * rng.normal(size=3)
        assert not symmetric(off), broken


@pytest.mark.parametrize(("speeds", "mirrored"), [((1.0, 1.0), True), ((1.0, 2.0), False), ((1.0, None), False)])
def test_air_speeds_are_part_of_what_a_mirror_keeps(speeds: tuple[float | None, ...], mirrored: bool) -> None:
    """Two walls that face each other, and a push between them whose only mirror exchanges them."""
    pushes = (([0.3, 0.2, 1.0], None), ([-0.3, 0.2, 1.0], None), ([0.0, 1.0, 0.3], None))
    walls = (
        below((x, 0, 0, 0.5)).model_copy(update={"speed": speed}) for x, speed in zip((1, -1), speeds, strict=True)
    )
    assert (improper_isometry(task_of(*pushes, exposure=tuple(walls))) is not None) == mirrored


def carried(x: float, y: float, **fields: Any) -> dict[str, Any]:
    """A force at the tip of a hovering platform."""
    return {"carries_weight": True, "end_effector": {"force": [x, y, 0.0]}, **fields}


ALONG, ACROSS, SKEW, DIAGONAL = ((0.1, 0.0), (0.0, 0.1), (0.1, 0.03), (0.1, 0.1))
LEVEL = {"force_reserve": 0.1, "directions": "horizontal"}
CONE = {"axis": [1.0, 0.0, 0.0], "half_angle_deg": 20.0, "force": 0.15}
BESIDE = [{"force": [0.1, y, 0.0]} for y in (0.05, -0.05)]
TWISTED = {**BESIDE[0], "torque": [0.1, 0.2, 0.0]}


@pytest.mark.parametrize(
    ("cases", "flight", "mirrored"),
    [
        ([carried(*ALONG)], {"rotor_out": "hover"}, True),
        ([carried(*ALONG)], {"rotor_out": "all"}, True),
        ([carried(*SKEW)], {}, True),
        ([carried(*SKEW)], {"rotor_out": "hover"}, False),
        ([carried(*ALONG)], {"force_reserve": 0.1}, True),  # a ball of corners
        ([carried(*DIAGONAL)], LEVEL, True),  # a disc of corners
        ([carried(*SKEW)], LEVEL, False),
        ([carried(*DIAGONAL)], {"angular_acceleration": (4.0, 4.0, 1.0)}, True),
        ([carried(*DIAGONAL)], {"angular_acceleration": (4.0, 3.0, 1.0)}, False),
        ([carried(*ALONG, cone=CONE), HOVER], {}, True),
        ([carried(*ALONG, cone=CONE, vertices=[TWISTED]), HOVER], {}, False),
        ([carried(*ALONG, vertices=BESIDE), HOVER], {}, True),
        ([*PUSH_CASES, carried(*ALONG, weight=0.0)], {}, False),
        ([*PUSH_CASES, carried(*ALONG, weight=0.0), carried(*ACROSS, weight=0.0)], {}, True),
        ([*PUSH_CASES, carried(*ALONG, weight=0.0), carried(*ACROSS)], {}, False),
    ],
)
def test_reserves_failures_sets_and_weightless_cases_are_part_of_what_a_mirror_keeps(
    cases: list[Any], flight: dict[str, Any], mirrored: bool
) -> None:
    assert (improper_isometry(push_task(3, load_cases=cases, flight=flight)) is not None) == mirrored


OBLIQUE = [{"end_effector": {"force": force}} for force in ([0.3, 0.0, 0.9], [0.0, -0.4, 0.8])]
"""Two forces, and so a mirror in their plane, which turns gravity."""
AT_COM = [
    {"end_effector": {"force": [0.2, 0.0, 0.0]}, "com": {"force": [0.0, 0.0, 1.0]}},
    {"end_effector": {"force": [0.0, 0.0, 0.3]}, "com": {"force": [0.2, 0.1, 0.7]}},
]
OPTIONS: dict[str, Any] = {
    "units": "SI",
    "around": "all",
    "at": "both",
    "directions": "horizontal",
    "allocator": "pseudo-inverse",
    "force_reserve": 0.1,
    "torque_reserve": 0.01,
    "com_error": 0.005,
    "tilt_deg": 5.0,
    "angular_acceleration": (4.0, 3.0, 1.0),
    "rotor_out": "hover",
    "rotor_out_torque": 0.02,
    "joint_moment": 2.0,
    "joint_force": 40.0,
    "tolerances": True,
}
PAIRS = [{first: OPTIONS[first], second: OPTIONS[second]} for first, second in combinations(OPTIONS, 2)]
NEEDS_A_FAILURE = "rotor_out_torque"


def tasks_with(flight: dict[str, Any], n: int) -> Iterator[ResolvedTask]:
    """Tasks with these requirements, and some mirror or none."""
    if NEEDS_A_FAILURE in flight:
        flight = {"rotor_out": "hover", **flight}
    tolerances = {"tolerances": {"hinge_angle_deg": 0.1}} if "tolerances" in flight else {}
    for cases, position in (
        (OBLIQUE, "free"),
        ([carried(*ALONG), HOVER], "free"),
        (AT_COM, "com"),
    ):
        fields = {"end_effector": {"position": position, "exclusion": False, "rod": "none"}, **tolerances}
        yield push_task(n, load_cases=cases, flight=flight, exposure=[], **fields)


def requirements_keep(O: Array, task: ResolvedTask) -> bool:
    """Straight from the definition of each requirement, whether the isometry changes none."""
    flight, axes = task.flight, np.abs(np.round(O, 9))
    needs_hover = flight.keeps_reserves or flight.tilt_deg > 0 or flight.rotor_out != "none"
    a = np.array(flight.angular_acceleration)
    loads = [
        np.concatenate([case.at_end_effector.force, case.at_com.force]) for case in task.load_cases
    ]  # without torques
    images = [np.concatenate([O @ load[:3], O @ load[3:]]) for load in loads]
    apart = task.end_effector.fixed_position is None or task.joint_limits != (None, None)
    points = np.eye(6) if apart else np.hstack([np.eye(3), np.eye(3)])
    return (
        (not needs_hover or np.allclose(O[:, 2], [0, 0, 1]))
        and (not a.any() or np.allclose(axes @ np.diag(a), np.diag(a) @ axes))
        and (not (a.any() or flight.com_error) or np.all((axes < 1e-9) | (np.abs(axes - 1) < 1e-9)))
        and all(any(np.allclose(points @ (image - load), 0, atol=1e-9) for load in loads) for image in images)
    )


def test_a_mirror_keeps_all_that_each_pair_of_flight_requirements_asks() -> None:
    mirrored = 0
    for task in chain.from_iterable(tasks_with(flight, 1) for flight in PAIRS):
        O = improper_isometry(task)
        mirrored += O is not None
        assert O is None or requirements_keep(O, task), (task.flight, O)
    assert mirrored > len(PAIRS)


def test_a_tilt_by_the_pseudo_inverse_distinguishes_trees_that_a_mirror_of_gravity_would_merge() -> None:
    for flight, classes in (({}, 3), ({"tilt_deg": 5.0, "allocator": "pseudo-inverse"}, 4)):
        task = push_task(3, load_cases=OBLIQUE, flight=flight, exposure=[])
        assert count(3, symmetry="task", task=task) == classes


@pytest.mark.slow
@pytest.mark.parametrize("flight", PAIRS, ids="-".join)
def test_trees_that_a_task_merges_cost_the_same_when_solved_apart(flight: dict[str, Any]) -> None:
    for task in tasks_with(flight, 3):
        if improper_isometry(task) is None:
            continue
        costs = []
        for key in ("a300", key_of(text_of(image(rooted_of("a300"), (0, True))))):
            solved = solve(task, Topology.from_key(key), starts=range(6), seed=0)
            costs.append(solved.objective if isinstance(solved, Design) else None)
        assert costs[0] == (None if costs[1] is None else pytest.approx(costs[1], rel=1e-3)), task.load_cases


def block(size: float, *at: float) -> dict[str, Any]:
    """A convex piece of a frame: a cube somewhere in the plane of the rotors."""
    cube = trimesh.creation.box([size] * 3).apply_translation([*at, 0.0])
    return {"vertices": cube.vertices.tolist(), "triangles": cube.faces.tolist()}


CUBE, BAY, OTHER_BAY = block(0.08, 0.0, 0.0), block(0.02, 0.05, 0.01), block(0.02, -0.05, -0.01)


@pytest.mark.parametrize(
    ("frame", "group"),
    [([CUBE], "d2"), ([CUBE, BAY, OTHER_BAY], "c2"), ([CUBE, BAY], "c1")],
)
def test_a_frame_that_a_turn_or_mirror_changes_distinguishes_trees(frame: list[Any], group: Any) -> None:
    body = {"frame": frame, "inertia": [0.001, 0.001, 0.002]}
    for connectors in ("aligned", "any"):
        task = push_task(4, module={"body": body}, search={"connectors": connectors})
        found = resolve_symmetry(task)
        assert (found.group, found.exact) == (group, True)
        listed = list(candidates(4, symmetry="task", connectors=connectors, task=task))
        assert len(listed) == count(4, symmetry="task", connectors=connectors, task=task)
        plain = {"d2": "task", "c2": "c2", "c1": "none"}[group]
        # with spins of two senses, no two rooted trees are the same platform
        root = "paper" if group == "c1" and connectors == "any" else "free"
        frameless = push_task(4, search={"connectors": connectors})
        assert len(listed) == count(4, symmetry=plain, connectors=connectors, root=root, task=frameless)
        assert resolve_symmetry(task, "c2").exact == (group != "c1")
        assert resolve_symmetry(task, "none").exact == (group != "c1" or connectors == "aligned")
