"""Tasks, trees and points for the tests of the inner problem."""

import math
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from older import older_task

from nlp import solve
from nlp.evaluation import correct_point
from nlp.numbers.point import Point, fixed_end_effector
from nlp.program import AssembledProgram
from nlp.start_result import StartResult
from nlp.starts.random_starts import draw, generator
from topo_search.model import Design, Infeasible, Mount, ResolvedTask, Topology
from topo_search.model.end_effector import CountedRod

Array = NDArray[np.float64]
Table = dict[str, Any]

ROOT = (-1, -1, -1)
HOVER: Table = {"com": {"force": [0.0, 0.0, 1.0]}}
PUSH: list[Table] = [
    {"end_effector": {"force": [0.5, 0.0, 0.5]}},
    {"end_effector": {"force": [0.0, 0.5, 0.5]}},
    HOVER,
]

GENTLE_PUSH: list[Table] = [
    {"end_effector": {"force": [0.25, 0.0, 0.75]}},
    {"end_effector": {"force": [0.0, 0.25, 0.75]}},
    HOVER,
]
"""Feasible where the push task is not."""

BESIDE_A_DECK: Table = {
    "name": "bridge",
    "modules": 5,
    "module": {
        "mass": 0.9,
        "arm_length": 0.22,
        "connector_distance": 0.3,
        "torque_to_thrust": 0.016,
        "min_input": 0.02,
        "max_thrust_to_weight": 2.2,
        "body": {"rotor_radius": 0.127},
    },
    "load_cases": [
        {"carries_weight": True, "units": "SI", "end_effector": {"force": [0.0, 0.0, 5.0]}},
        {"carries_weight": True},
    ],
    "exposure": [
        {"kind": "directional", "radius": 0.1, "polylines": [[[-1.0, 0.4, 0.0], [1.0, 0.4, 0.0], [1.0, 0.4, 0.3]]]},
        {"kind": "allowed", "planes": [{"normal": [0.0, 0.0, 1.0]}], "solid": True},
    ],
    "end_effector": {"mass": 0.15},
    "flight": {"units": "SI", "force_reserve": 1.0, "torque_reserve": 0.1},
}
"""A touch from below, next to an edge: efforts are nearly flat in the length of the rod."""

LOCAL: Table = {"kind": "local", "radius": 0.15}
BOX: Table = {"kind": "local", "box": [0.35, 0.3, 0.2]}
WEDGE: Table = {
    "kind": "local",
    "vertices": [[-0.15, -0.1, 0.1], [0.2, -0.1, 0.1], [-0.1, 0.2, 0.1], [0.0, 0.0, -0.15], [0.1, 0.1, 0.2]],
}
PIECES: Table = {
    "kind": "local",
    "pieces": [WEDGE["vertices"], [[x + 0.1, y - 0.4, z + 0.3] for x, y, z in WEDGE["vertices"]]],
}
PATH: Table = {"kind": "directional", "radius": 0.15, "segments": [[1.0, 0.0, 0.0]]}
TWO_PATHS: Table = {"kind": "directional", "radius": 0.15, "segments": [[1.0, 0.0, 0.0], [1.0, 1.0, -1.0]]}
OUTWARDS: Table = {"kind": "directional", "radius": 0.15, "along": "end_effector", "length": 1.0}
CONE: Table = {"kind": "exterior", "half_angle_deg": 60.0, "axis": "com"}
HALF_SPACE: Table = {"kind": "exterior", "half_angle_deg": 90.0, "axis": "com"}
CONE_DOWN: Table = {"kind": "exterior", "half_angle_deg": 60.0, "axis": [-0.3, -0.3, -1.0]}
BENT: Table = {
    "kind": "directional",
    "radius": 0.1,
    "polylines": [[[0.0, 0.0, 0.1], [0.5, 0.0, 0.2], [0.5, 0.3, 0.6]], [[-0.2, 0.1, 0.3], [-0.2, 0.4, 0.3]]],
}
BELOW: Table = {
    "kind": "allowed",
    "planes": [{"normal": [0.0, 0.3, 2.0], "offset": 0.05}, {"normal": [1.0, 0.0, 0.5], "offset": 0.2}],
}
HALF_SPACE_DOWN: Table = {"kind": "exterior", "half_angle_deg": 90.0, "axis": [0.1, -0.2, -2.0]}
PANE: Table = {
    "kind": "local",
    "vertices": [[0.0, -0.4, -0.4], [0.0, 0.4, -0.4], [0.0, 0.0, 0.4], [0.05, 0.0, 0.0]],
}
PILLAR: Table = {
    "kind": "local",
    "vertices": [[-0.3, -0.1, -0.5], [-0.2, -0.1, -0.5], [-0.25, 0.1, -0.5], [-0.25, 0.0, 0.4]],
}

WIDE_AT_REGIONS: Table = {"airflow": {"regions": {"start_radius": 0.2, "spread_angle_deg": 4.0, "reach": 1.9}}}
"""A module whose envelope against regions is wider at the top and longer than that between modules."""


def with_rod(region: Table, **rod: float) -> Table:
    """Return the fields of a straight rod and of a region that it may not pass."""
    return {"exposure": [{**region, "solid": True}], "end_effector": {"rod": "straight", **rod}}


FEATURES: dict[str, Table] = {
    "push": {},
    "local": {"exposure": [LOCAL]},
    "box": {"exposure": [BOX]},
    "convex region": {"exposure": [WEDGE]},
    "several pieces": {"exposure": [PIECES], "module": WIDE_AT_REGIONS},
    "one path": {"exposure": [PATH]},
    "two paths": {"exposure": [TWO_PATHS]},
    "a path along the end-effector": {"exposure": [OUTWARDS]},
    "60 degree cone": {"exposure": [CONE]},
    "half-space": {"exposure": [HALF_SPACE]},
    "60 degree cone with a fixed axis": {"exposure": [CONE_DOWN]},
    "half-space with a fixed axis": {"exposure": [HALF_SPACE_DOWN]},
    "bent paths": {"exposure": [BENT]},
    "planes": {"exposure": [BELOW]},
    "several requirements": {"exposure": [LOCAL, OUTWARDS, HALF_SPACE], "module": WIDE_AT_REGIONS},
    "paper root": {"search": {"root": "paper"}},
    "no body clearance": {"search": {"body_clearance": False}},
    "ablation": {"search": {"interference": "separation"}},
    "merging airflow": {"search": {"interference": "parts"}},
    "merging airflow, no body clearance": {"search": {"interference": "parts", "body_clearance": False}},
    "no exclusion": {"end_effector": {"exclusion": False}},
    "stand-off": {"end_effector": {"stand_off": 0.4}},
    "stand-off in place of exclusion": {"end_effector": {"exclusion": False, "stand_off": 0.1}},
    "peak input": {"search": {"peak_input": 0.9}},
    "end-effector at the COM": {"end_effector": {"position": "com", "exclusion": False}, "load_cases": GENTLE_PUSH},
    "fixed end-effector": {"end_effector": {"position": [0.1, 0.1, 0.3]}},
    "least input": {"module": {"min_input": 0.1}},
    "joint mass": {"module": {"joint_mass": 0.02}, "exposure": [CONE]},
    "joint mass, fixed end-effector": {
        "module": {"joint_mass": 0.02},
        "end_effector": {"position": [0.1, 0.1, 0.3]},
    },
    "any port": {"search": {"connectors": "any"}},
    "solid half-space with a fixed axis": {"exposure": [{**HALF_SPACE_DOWN, "solid": True}]},
    "solid cone with a fixed axis": {"exposure": [{**CONE_DOWN, "solid": True}]},
    "solid cone": {"exposure": [{**CONE, "solid": True}]},
    "solid ball": {"exposure": [{**LOCAL, "radius": 0.3, "solid": True}]},
    "solid paths": {"exposure": [{**TWO_PATHS, "solid": True}]},
    "solid path along the end-effector": {"exposure": [{**OUTWARDS, "solid": True}]},
    "solid convex region": {"exposure": [{**WEDGE, "solid": True}]},
    "several solid pieces": {"exposure": [{**PIECES, "solid": True}]},
    "solid bent paths": {"exposure": [{**BENT, "solid": True}]},
    "solid planes": {"exposure": [{**BELOW, "solid": True}]},
    "reach": {"end_effector": {"largest_reach": 0.5}},
    "rod beside solid bent paths": with_rod(BENT),
    "rod on a solid path along the end-effector": with_rod({**OUTWARDS, "radius": 0.004}),
    "rod in a solid cone within reach": with_rod(CONE, largest_reach=0.6),
    "rod in a solid cone with a fixed axis": with_rod(CONE_DOWN),
    "rod on a solid pane": with_rod(PANE),
    "rod beside a solid pillar": with_rod(PILLAR),
    "rod within solid planes": with_rod(BELOW),
    "thick rod in a solid ball": with_rod({**LOCAL, "radius": 0.019}, rod_radius=0.02),
    "rod along an axis": {
        "end_effector": {"rod": "straight", "axis": [0.3, -0.2, 1.0], "within_deg": 35.0, "largest_reach": 0.6}
    },
    "tilted rotors": {
        "module": {
            "rotors": [
                {"position": [0.1, -0.05, 0.01], "axis": [0.1, 0.2, 1.0], "spin": 1},
                {"position": [0.02, 0.11, 0.0], "axis": [0.1, -0.1, 1.0], "spin": 1},
                {"position": [-0.12, -0.01, -0.02], "axis": [-0.2, -0.1, 1.0], "spin": -1},
                {"position": [-0.03, -0.1, 0.0], "axis": [0.0, 0.0, 1.0], "spin": -1},
                {"position": [0.06, 0.05, 0.05], "axis": [0.0, 0.0, 1.0], "spin": 1},
            ],
            "body": {"rotor_radius": 0.03},
        }
    },
    "jets of their own": {
        "module": {
            "max_thrust_to_weight": 4.0,
            "rotors": [
                {"position": [0.0707, -0.0707, 0.0], "axis": [0.353553, 0.353553, 0.866025], "spin": 1},
                {"position": [-0.0707, -0.0707, 0.0], "axis": [-0.353553, 0.353553, 0.866025], "spin": -1},
                {"position": [-0.0707, 0.0707, 0.0], "axis": [-0.353553, -0.353553, 0.866025], "spin": 1},
                {"position": [0.0707, 0.0707, 0.0], "axis": [0.353553, -0.353553, 0.866025], "spin": -1},
            ],
            "body": {"rotor_radius": 0.03},
            "airflow": {"regions": {"start_radius": 0.04, "spread_angle_deg": 8.0, "reach": 1.2}},
        },
        "search": {"interference": "separation"},
        "exposure": [LOCAL, PATH],
    },
    "rod along a force": {"end_effector": {"rod": "straight", "axis": "force"}},
}
"""What a task can ask for: fields laid over the push task."""

DISTINCT = (
    *("several pieces", "two paths", "60 degree cone with a fixed axis", "bent paths", "planes"),
    *("several requirements", "paper root", "ablation", "merging airflow, no body clearance"),
    *("stand-off in place of exclusion", "peak input", "end-effector at the COM", "least input"),
    *("joint mass, fixed end-effector", "any port", "solid cone", "solid path along the end-effector"),
    *("several solid pieces", "rod beside solid bent paths", "rod in a solid cone within reach"),
    *("thick rod in a solid ball", "rod along an axis", "tilted rotors", "jets of their own"),
)
"""Features of which each has rows, or an option, that no other one of these has: what the fast suite looks at."""


def push(n: int = 5, **fields: Any) -> ResolvedTask:
    """The push task of the paper for n modules, with other fields beside or instead."""
    if "torque_to_thrust" not in (module := fields.get("module", {})):
        fields["module"] = {"torque_coefficient": 1.06e-8, **module}
    fields["end_effector"] = {"rod": "none", "largest_reach": False, **fields.get("end_effector", {})}
    return older_task({"name": "push", "modules": n, "load_cases": PUSH, **fields}).resolve(n)


def hover(n: int, **fields: Any) -> ResolvedTask:
    """Nothing but the platform's weight, at its centre of mass."""
    return push(n, **{"load_cases": [HOVER], **fields})


def random_tree(n: int, rng: np.random.Generator, *, aligned: bool = False) -> Topology:
    """A tree that grows by one module at a random free port at a time."""
    joints, free = [ROOT], [(0, port) for port in range(4)]
    for i in range(1, n):
        h, a = free.pop(rng.integers(len(free)))
        b = (a + 2) % 4 if aligned else int(rng.integers(4))
        joints.append((h, a, b))
        free += [(i, port) for port in range(4) if port != b]
    return Topology(tuple(joints))


@st.composite
def trees(draw: st.DrawFn, most: int = 12, *, aligned: bool = False) -> Topology:
    """Trees of any ports, or aligned ones, the same half turned or in another order included."""
    joints, free = [ROOT], [(0, port) for port in range(4)]
    for i in range(1, draw(st.integers(1, most))):
        h, a = free.pop(draw(st.integers(0, len(free) - 1)))
        b = (a + 2) % 4 if aligned else draw(st.integers(0, 3))
        joints.append((h, a, b))
        free += [(i, port) for port in range(4) if port != b]
    return Topology(tuple(joints))


def with_masses(task: ResolvedTask, topology: Topology) -> ResolvedTask:
    """Return the task with heavy joints and a thick, heavy rod from a free connector, whatever its length."""
    module = task.module.model_copy(update={"joint_mass": 0.05})
    tip = task.end_effector.model_copy(update={"rod_mass": "included", "rod_radius": 0.05})
    module_of_rod, port = topology.free_connectors[-1]
    heavy = task.model_copy(update={"module": module, "end_effector": tip})
    return heavy.with_rod(CountedRod(module=module_of_rod, port=port, mass=0.1))


def random_point(task: ResolvedTask, topology: Topology, rng: np.random.Generator) -> Point:
    """Any values of all variables, within their bounds."""
    n, K = topology.n, len(task.load_cases)
    right = math.pi / 2
    root = rng.uniform([-math.pi, -right, -math.pi], [math.pi, right, math.pi])
    if task.search.root == "paper":
        root = np.array([0.0, root[1], root[2] / 2])
    alpha = rng.uniform(-right, right, n - 1)
    p_E = rng.normal(size=3) * 5 * task.module.arm_length
    if task.end_effector.fixed_position is not None:
        p_E = fixed_end_effector(task, topology, root, alpha)
    u = rng.uniform(0.0, task.max_input, (K, n, task.rotors_per_module)) * (task.input_shares > 0)
    return Point(task, topology, root, alpha, p_E, u)


def as_design(point: Point) -> Design:
    """The point as a design, whether it meets its constraints or not: what the audit reads."""
    weights = np.array([case.weight for case in point.task.load_cases])
    rod = point.task.end_effector.counted_rod
    return Design(
        task=point.task,
        mount=rod and Mount(module=rod.module, port=rod.port),
        topology=point.topology,
        root_orientation_rad=tuple(point.root.tolist()),
        hinge_angles_rad=tuple(point.alpha.tolist()),
        end_effector_m=tuple(point.tip.tolist()),
        rotor_speeds_squared=tuple(tuple(u_k.ravel().tolist()) for u_k in point.u),
        objective=float(weights @ np.sum(point.u**2, axis=(1, 2))),
    )


def as_point(design: Design) -> Point:
    """A design as a point of the problem."""
    root, alpha, p_E = (
        np.array(values) for values in (design.root_orientation_rad, design.hinge_angles_rad, design.end_effector_m)
    )
    return Point(design.task, design.topology, root, alpha, p_E, np.array(design.inputs))


def solved(result: Design | Infeasible) -> Design:
    """The result, which must be a design."""
    assert isinstance(result, Design), result.message
    return result


@cache
def best_design(task: ResolvedTask, topology: Topology, starts: int, seed: int = 0) -> Design:
    """The best of some starts, solved once however many tests ask for it: it is a pure function."""
    return solved(solve(task, topology, starts=range(starts), seed=seed))


def placed(task: ResolvedTask, topology: Topology, starts: int) -> StartResult:
    """The best of some starts from which Ipopt solves the whole problem, without the reduced search."""
    ready = AssembledProgram(task, topology)
    origins = [draw(task, topology, generator(task, topology, s, 0)) for s in range(starts)]
    ends = [ready.solve(origin) for origin in origins]
    found = [
        StartResult.from_point(s, correct_point(end.point, ()), end) for s, end in enumerate(ends) if end.finite
    ]
    return min(found, key=lambda outcome: outcome.rank)
