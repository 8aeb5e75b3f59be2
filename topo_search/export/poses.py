"""Geometry shared by pictures, pages and exported files: wrenches, rod, exposure regions, viewpoint.

Poses come from the audit's kinematics.

| symbol | meaning | shape | unit |
|---|---|---|---|
| c | connector of module i at port a, such as the rod's, p_i + l_c R_i e_a, with the l_c of its type | (3,) | m |
| p'_E | end-effector in W | (3,) | m |
| m, v | mass of the rod, which solver and audit may ignore; unit vector along the rod | , (3,) | kg, - |

Shapes of exposure requirements are in metres from the end-effector; a direction that depends on the design is
resolved.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from topo_search.export import palette
from topo_search.limits import vector
from topo_search.model import PORT_DIRECTIONS, Array, BadInput, Design, Fault, Module, ResolvedTask
from topo_search.model.shape import Shape
from verify.kinematics import Platform, has_rotor, platform, rotation


class ModuleKind(NamedTuple):
    """Modules of one type in a design."""

    module: Module
    name: str
    """Name of the type; empty if the platform has one type of module."""
    colour: str
    nodes: list[int]
    """Their numbers."""
    suffix: str
    """Ending of mesh names: ` of K` for type K; empty if there is one."""

    @property
    def words(self) -> str:
        """Return the name of the type, or `module`."""
        return self.name or "module"


def kinds(design: Design) -> list[ModuleKind]:
    """Return the types of module of a design, with a colour each."""
    types = design.task.module_types
    if not types:
        return [ModuleKind(design.task.module, "", palette.MODULE, list(range(design.topology.n)), "")]
    return [
        ModuleKind(kind, kind.name, colour, nodes, f" of {k}")
        for k, (kind, (_, nodes), colour) in enumerate(
            zip(types, design.task.placed_types, itertools.cycle(palette.TYPES), strict=False)
        )
    ]


def kind_of(design: Design, i: int) -> ModuleKind:
    """Return the type of module i."""
    return next(kind for kind in kinds(design) if i in kind.nodes)


class Arm(NamedTuple):
    """An arm of a module, from the centre to a rotor, in the module's frame."""

    azimuth: float
    """Angle from the x axis about z [rad]."""
    elevation: float
    """Angle above the module's plane [rad]."""
    length: float
    """[m]"""

    @property
    def R(self) -> Array:
        """Rotation of the x axis along the arm, (3, 3)."""
        return rotation(2, self.azimuth) @ rotation(1, -self.elevation)

    @property
    def end(self) -> Array:
        """Centre of the rotor, (3,) [m]."""
        out = math.cos(self.elevation)
        x, y = out * math.cos(self.azimuth), out * math.sin(self.azimuth)
        return self.length * np.array([x, y, math.sin(self.elevation)])


def arms(module: Module) -> list[Arm]:
    """Return the arms of a module, in the order of its rotors."""
    table = module.rotor_table
    lengths = (module.arm_length * table.distances).tolist()
    bearings = [(math.atan2(y, x), math.atan2(z, math.hypot(x, y))) for x, y, z in table.directions.tolist()]
    return [Arm(*bearing, length) for bearing, length in zip(bearings, lengths, strict=True)]


def rotor_rotations(module: Module) -> list[Array]:
    """Return the smallest rotation from z to each rotor's axis, shape (3, 3) each."""
    return [_tilt(axis) for axis in module.rotor_table.axes]


def largest_inputs(task: ResolvedTask) -> Array:
    """Return u_max of every rotor, module by module, shape (N,) [rad^2/s^2]."""
    return np.concatenate([module.max_inputs(task.gravity) for module in task.modules_of_nodes])


def throttles(design: Design) -> Array:
    """Return the input of every rotor over its u_max, module by module, shape (K, N)."""
    return np.asarray(design.inputs[:, has_rotor(design.task)] / largest_inputs(design.task))


def thrusts(design: Design) -> Array:
    """Return the thrust of every rotor, module by module, shape (K, N) [N]."""
    tables = [(module.thrust_coefficient, module.rotor_table.gains) for module in design.task.modules_of_nodes]
    k_f, gains = (np.concatenate(x) for x in zip(*((np.full_like(g, k), g) for k, g in tables), strict=True))
    return np.asarray(k_f * (gains * design.inputs[:, has_rotor(design.task)]))


def connector(design: Design, poses: Platform, i: int, port: int) -> Array:
    """Return a connector of module i in W, (3,) [m]."""
    l_c = design.task.modules_of_nodes[i].connector_distance
    return np.asarray(poses.p[i] + l_c * poses.R[i] @ PORT_DIRECTIONS[port])


def _tilt(axis: Array) -> Array:
    x, y, z = axis
    if z < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    V = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])  # cross product with UP x axis
    return np.asarray(np.eye(3) + V + V @ V / (1 + z))


def load_wrenches(design: Design, poses: Platform) -> Iterator[tuple[int, str, str, Array, Array]]:
    """Yield each force and torque of all load cases, zeros included.

    An item is the load case, "force" or "torque", the name of the point, the point (3,) [m], the vector [N, N m].
    """
    for k, case in enumerate(design.task.load_cases):
        for wrench, where, point in (
            (case.at_end_effector, "end-effector", poses.end_effector),
            (case.at_com, "centre of mass", poses.p_com),
        ):
            yield k, "force", where, point, np.array(wrench.force)
            yield k, "torque", where, point, np.array(wrench.torque)


def largest_wrench(design: Design, poses: Platform, kind: str) -> float:
    """Return the largest force [N] or torque [N m] of all load cases."""
    return max(float(np.linalg.norm(v)) for _, name, _, _, v in load_wrenches(design, poses) if name == kind)


@dataclass(frozen=True)
class RodPose:
    """A straight rod with round ends."""

    start: Array
    """c, in W [m]."""
    end: Array
    """p'_E, in W [m]."""
    radius: float
    """[m]"""

    @property
    def length(self) -> float:
        """Distance between the centres of the round ends [m]."""
        return float(np.linalg.norm(self.end - self.start))


def mass_of(rod: RodPose, design: Design, poses: Platform) -> tuple[float, Array, Array]:
    """Return mass [kg], inertia (3, 3) [kg m^2] about the middle in W's axes, and the middle from the COM (3,) [m].

    The rod is modelled as a thin tube.
    """
    counted = design.task.end_effector.counted_rod
    m = design.task.end_effector.rod_linear_density * rod.length if counted is None else counted.mass
    v = (rod.end - rod.start) / rod.length
    along = np.outer(v, v)
    inertia = m * (rod.length**2 / 12 * (np.eye(3) - along) + rod.radius**2 / 2 * (np.eye(3) + along))
    return m, inertia, (rod.start + rod.end) / 2 - poses.p_com


def rod_of(design: Design, poses: Platform) -> RodPose | None:
    """Return the rod of a design; None if no connector holds one, or its length is 0."""
    if design.mount is None:
        return None
    start = connector(design, poses, design.mount.module, design.mount.port)
    rod = RodPose(start, poses.end_effector, design.task.end_effector.rod_radius)
    return rod if rod.length > 0 else None


def axis_words(task: ResolvedTask, direction: ArrayLike) -> str:
    """Return the angle between a rod, a unit vector in W, and the task's axis in words; empty without an axis."""
    if (axis := task.rod_axis) is None:
        return ""
    angle = math.degrees(math.acos(np.clip(np.dot(direction, axis), -1.0, 1.0)))
    return f"{angle:.1f} deg from {vector(axis)} in the task's axes"


def longest_reach(task: ResolvedTask) -> float:
    """Return the reach of the airflow that reaches farthest from its module [m]."""
    return max(kind.reach for kind in task.types if kind.rotor_table.count)


ELEVATION_DEG = 20.0


def poses_to_draw(design: Design) -> Platform:
    """Return the poses of a design; BadInput if the end-effector is too far away to be drawn to scale."""
    task = design.task
    limit = 1000.0 * (2 * task.longest_connector * design.topology.n + longest_reach(task))
    if max(map(abs, design.end_effector_m)) > limit:
        rule = f"must be within {limit:.3g} m of the root module to be drawn, but got {list(design.end_effector_m)}"
        raise BadInput(design.task.name, [Fault("end_effector_m", rule)])
    return platform(design)


def azimuth_deg(poses: Platform) -> float:
    """Return the azimuth [deg] that best shows the offset from the centre of mass to p_E, along no axis."""
    x, y, _ = poses.p_e
    azimuths = (-60, -30, 30, 60)  # near an axis, its labels would overlap
    across = y * np.cos(np.radians(azimuths)) - x * np.sin(np.radians(azimuths))
    return azimuths[int(np.argmax(np.abs(across)))]


def towards_viewer(azimuth_deg: float) -> Array:
    """Return the unit vector towards the viewer, (3,)."""
    elevation, azimuth = math.radians(ELEVATION_DEG), math.radians(azimuth_deg)
    across = math.cos(elevation)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation)])


def shapes(task: ResolvedTask, p_E: Array) -> Iterator[tuple[int, Shape]]:
    """Yield every shape of every exposure requirement, with its number; p_E is from the centre of mass."""
    for number, exposure in enumerate(task.exposure):
        for shape in exposure.shapes:
            yield number, shape.at(p_E)


def cone_slant(design: Design, poses: Platform) -> float:
    """Return the slant height at which pictures cut a cone off; it encloses most of the airflow [m]."""
    return float(np.linalg.norm(poses.p - poses.end_effector, axis=1).max()) + 2 * longest_reach(design.task) / 3
