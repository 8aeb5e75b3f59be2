"""A design as a robot description (URDF): a link per module, fixed joints, a frame at every rotor.

| symbol | meaning | shape | unit |
|---|---|---|---|
| W | task frame, origin at the root module's centre | | |
| R_i, p_i | orientation and centre of module i in W | (3, 3), (3,) | -, m |
| F_i | orientation of link i's frame in W: the identity for the root, R_i for others | (3, 3) | |
| r, p, y | roll, pitch, yaw: R = Rz(y) Ry(p) Rx(r) | | rad |

The root of the tree is the link of module 0, which has mass, because simulators fix or ignore a massless root. Its
frame is W, so a platform spawned without rotation has the attitude of the task. URDF has no actuators: a
controller applies thrust and drag torque along z of the link `module_I_rotor_Q`; the comment at the head of the
file gives the formulas. Links that are only frames have an explicit mass of 0, because some readers assume 1 kg if
it is missing. A module's frame is drawn as hub and arms even if the module has its own meshes, which URDF only
allows in other files.
"""

import math
from xml.etree.ElementTree import Comment, Element, SubElement

import numpy as np

from topo_search.export import palette
from topo_search.export.mjcf import SPIN, numbers, rgba, xml_text
from topo_search.export.poses import ModuleKind, arms, kind_of, kinds, mass_of, rod_of, rotor_rotations
from topo_search.model.arrays import PORT_DIRECTIONS, Array
from topo_search.model.design import Design
from topo_search.model.mesh import rotation_to
from verify.kinematics import platform, rotation

ABOUT = """
Link `module_0`: origin at the root module's centre, axes of the task frame. Other module links: their own frames.
Link `centre_of_mass`: of the whole platform, axes of the task frame. Load cases act there and at `end_effector`.
{rotors}"""
ROTORS = """\
Rotor Q at the squared speed u [rad^2/s^2] exerts the force {k_f!r} u [N] along z of the link
`module_I_rotor_Q`, and the torque D {k_tau!r} u [N m] about it; u is at most {u_max!r}.
D is {signs} for Q = 0, 1, ...{own}
"""


def urdf(design: Design) -> str:
    """Return a design as the text of a URDF file."""
    task, poses, types = design.task, platform(design), kinds(design)
    robot = Element("robot", name=task.name)
    robot.append(Comment(ABOUT.format(rotors="".join(_about_rotors(kind, task.gravity) for kind in types))))
    parts = (("arm", palette.ARM), ("rotor", palette.ROTOR), ("end_effector", palette.END_EFFECTOR))
    for name, colour in (*((_material(kind), kind.colour) for kind in types), *parts):
        material = SubElement(robot, "material", name=name)
        SubElement(material, "color", rgba=rgba(colour))
    F, joint_mass = [np.eye(3), *poses.R[1:]], task.module.joint_mass
    for i, module in enumerate(task.modules_of_nodes):
        R = F[i].T @ poses.R[i]
        _module_link(robot, i, R, kind_of(design, i))
        for q, (arm, turn) in enumerate(zip(arms(module), rotor_rotations(module), strict=True)):
            rotor = f"module_{i}_rotor_{q}"
            _point(robot, rotor, 0.0)
            _joint(robot, f"module_{i}", rotor, R @ arm.end, R @ turn)
    for h, i, a, _ in design.topology.edges():
        _joint(robot, f"module_{h}", f"module_{i}", F[h].T @ (poses.p[i] - poses.p[h]), F[h].T @ F[i])
        if joint_mass:
            hinge = task.modules_of_nodes[h].connector_distance * F[h].T @ poses.R[h] @ PORT_DIRECTIONS[a]
            _point(robot, f"joint_{i}", joint_mass)
            _joint(robot, f"module_{h}", f"joint_{i}", hinge, np.eye(3))
    closing = poses.joints[design.topology.n - 1 :] + poses.p_com
    for k, place in enumerate(closing if joint_mass else ()):
        _point(robot, f"closure_{k}", joint_mass)
        _joint(robot, "module_0", f"closure_{k}", place, np.eye(3))
    _point(robot, "centre_of_mass", 0.0)
    _joint(robot, "module_0", "centre_of_mass", poses.p_com, np.eye(3))
    tip = _point(robot, "end_effector", task.end_effector.mass)
    _joint(robot, "module_0", "end_effector", poses.end_effector, np.eye(3))
    if rod := rod_of(design, poses):
        tube = "cylinder", {"radius": numbers(rod.radius), "length": numbers(rod.length)}
        R = rotation_to((rod.end - rod.start) / rod.length)
        _shape(tip, tube, (rod.start - rod.end) / 2, R, "end_effector")
        if task.end_effector.counted_rod is not None:
            mass, inertia, _ = mass_of(rod, design, poses)
            _inertial(SubElement(robot, "link", name="rod"), mass, inertia)
            _joint(robot, "module_0", "rod", (rod.start + rod.end) / 2, np.eye(3))
    return xml_text(robot)


def _material(kind: ModuleKind) -> str:
    return f"module {kind.name}".strip()


def _about_rotors(kind: ModuleKind, gravity: float) -> str:
    """Return the formulas of the rotors of a type of module for the comment; empty without rotors."""
    module = kind.module
    rotors, own = module.rotor_table, ""
    if not rotors.count:
        return ""
    signs = ", ".join(f"{-spin:+d}" for spin in rotors.spins)
    if not rotors.is_uniform:
        factors = zip(rotors.gains, np.abs(rotors.drags), module.input_shares(gravity), strict=True)
        own = "\nForce, torque and largest u of rotor Q are these times " + "; ".join(
            f"{f:.9g}, {t:.9g}, {u:.9g}" for f, t, u in factors
        )
    which = f"I = {', '.join(map(str, kind.nodes))}:\n" if kind.name else ""
    coefficients = {"k_f": module.thrust_coefficient, "k_tau": module.torque_coefficient}
    return which + ROTORS.format(**coefficients, u_max=module.max_input(gravity), signs=signs, own=own)


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Return r, p, y with R = Rz(y) Ry(p) Rx(r) [rad], also at p = 90 deg, where y is arbitrary."""
    y = math.atan2(R[1, 0], R[0, 0])
    tilted = rotation(2, -y) @ R
    p = math.atan2(-tilted[2, 0], tilted[0, 0])
    r = math.atan2(-tilted[1, 2], tilted[1, 1])
    return r, p, y


def _module_link(robot: Element, i: int, R: Array, kind: ModuleKind) -> None:
    """Add the link of module i, coloured by its type; R is the module's orientation in the link's frame."""
    module = kind.module
    link = SubElement(robot, "link", name=f"module_{i}")
    _inertial(link, module.mass, R @ np.diag(module.inertia) @ R.T)
    body = module.body
    _shape(link, ("box", {"size": numbers(*body.hub)}), np.zeros(3), R, _material(kind))
    for arm, turn, radius in zip(arms(module), rotor_rotations(module), module.rotor_radii, strict=True):
        rotor = "cylinder", {"radius": numbers(radius), "length": numbers(body.rotor_height)}
        bar = "box", {"size": numbers(arm.length, body.arm_width, body.arm_width)}
        if arm.length:
            _shape(link, bar, R @ (arm.end / 2), R @ arm.R, "arm")
        _shape(link, rotor, R @ arm.end, R @ turn, "rotor")


def _point(robot: Element, name: str, mass: float) -> Element:
    link = SubElement(robot, "link", name=name)
    _inertial(link, mass, (SPIN if mass else 0.0) * np.eye(3))
    return link


def _inertial(link: Element, mass: float, tensor: Array) -> None:
    """Add mass and inertia in the link's axes."""
    inertial = SubElement(link, "inertial")
    _origin(inertial, np.zeros(3), np.eye(3))
    SubElement(inertial, "mass", value=numbers(mass))
    # slightly larger: after rounding, readers may find Izz > Ixx + Iyy for a flat body
    I = tensor + 1e-14 * tensor.trace() * np.eye(3)
    entries = {f"i{'xyz'[a]}{'xyz'[b]}": numbers(I[a, b]) for a in range(3) for b in range(a, 3)}
    SubElement(inertial, "inertia", entries)


def _shape(link: Element, shape: tuple[str, dict[str, str]], position: Array, R: Array, material: str) -> None:
    """Add a visual and a collision shape to a link."""
    for purpose in ("visual", "collision"):
        part = SubElement(link, purpose)
        _origin(part, position, R)
        SubElement(SubElement(part, "geometry"), *shape)
        if purpose == "visual":
            SubElement(part, "material", name=material)


def _joint(robot: Element, parent: str, child: str, position: Array, R: Array) -> None:
    joint = SubElement(robot, "joint", name=f"{parent}_to_{child}", type="fixed")
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    _origin(joint, position, R)


def _origin(element: Element, position: Array, R: Array) -> None:
    SubElement(element, "origin", xyz=numbers(*position), rpy=numbers(*roll_pitch_yaw(R)))
