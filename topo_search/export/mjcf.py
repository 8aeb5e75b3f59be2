"""A design as a model for MuJoCo (MJCF): rigid bodies, one thrust actuator a rotor, one keyframe a load case.

| symbol | meaning | unit |
|---|---|---|
| o_0 | the root module's centre from the platform COM, -p_COM | m |
| l_c, e_a | module centre to connector; direction of port a | m, - |
| alpha_i, kappa | hinge angle of the joint h-i; quarter turns of the child, (a + 2 - b) mod 4 | rad, - |
| k_f, k_tau | rotor thrust and drag-torque coefficients | N s^2, N m s^2 |
| u | squared rotor speed; the actuator's control is the thrust k_f u | rad^2/s^2, N |

The body `platform` floats freely. Its frame has its origin at the centre of mass and the axes of the task frame
W, so that a load case reads there as it stands in the task. Modules hang below it as the topology says, each behind
its hinge with the angle that the design states. Masses are those of the solver and the audit: m at every module's
centre with the module's inertia; m_E at p_E and that of a joint at its hinge are points. The rod that holds the
end-effector has a shape, and mass where the design counts it. `Physics` says what else a simulator is to have.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from xml.etree.ElementTree import Comment, Element, SubElement

from topo_search.export import palette
from topo_search.export.poses import ROTOR_ANGLES, poses, rod_of
from topo_search.export.simulator_xml import (
    AS_SEARCHED,
    Physics,
    add_lag,
    add_rod_mass,
    add_solid_regions,
    add_tip,
    numbers,
    rgba,
    xml_text,
)
from topo_search.model.arrays import PORT_DIRECTIONS, ROTOR_SPINS
from topo_search.model.design import Design
from topo_search.model.module import Module

SPIN_CLASSES = {-1: "drag_against_thrust_axis", 1: "drag_along_thrust_axis"}
"""Classes of actuators by the sign of the drag torque."""

ABOUT = """
Body `platform`: origin at the centre of mass, axes of the task frame. Units: kg, m, s, rad, N.
Actuator `module_I_rotor_Q`, Q = 0..3: the thrust of a rotor [N], k_f times its squared speed; with its drag torque.
Its range is that of a rotor that runs; one that is dead is off (gainprm 0).
Keyframe `load_case_K`: the thrusts that produce load case K. Gravity is not part of a load case.
"""


def mjcf(design: Design, physics: Physics = AS_SEARCHED) -> str:
    """Return a design as the text of an MJCF file.

    Args:
        design: the design.
        physics: what it is to have beyond the model of the search.
    """
    task, module = design.task, design.task.module
    at, counts = poses(design), task.end_effector.counted_rod is not None
    model = Element("mujoco", model=f"{task.name} {design.topology.key}")
    model.append(Comment(ABOUT + replace(physics, rod_mass=physics.rod_mass and not counts).about))
    SubElement(model, "compiler", angle="radian", eulerseq="zxy", inertiafromgeom="false")
    SubElement(model, "option", gravity=numbers(0, 0, -task.gravity))
    _defaults(SubElement(model, "default"), module, task.gravity, physics)
    sky = {"type": "skybox", "builtin": "flat", "rgb1": "1 1 1", "rgb2": "1 1 1", "width": "8", "height": "8"}
    asset = SubElement(model, "asset")
    SubElement(asset, "texture", sky)
    for k, piece in enumerate(module.body.frame or ()):
        corners = {
            "vertex": numbers(*itertools.chain(*piece.vertices)),
            "face": " ".join(map(str, itertools.chain(*piece.triangles))),
        }
        SubElement(asset, "mesh", {"name": f"frame_{k}", **corners})
    world = SubElement(model, "worldbody")
    SubElement(world, "light", pos="0 0 5", dir="0 0 -1", directional="true")
    platform = SubElement(world, "body", name="platform")
    SubElement(platform, "freejoint", name="platform")
    SubElement(platform, "site", name="centre_of_mass", rgba=rgba(palette.CENTRE_OF_MASS))
    at_root = {"pos": numbers(*-at.p_com), "euler": numbers(*design.root_orientation_rad)}
    bodies = [_module_body(platform, 0, at_root, module)]
    for (h, i, a, b), alpha in zip(design.topology.edges(), design.hinge_angles_rad, strict=True):
        hinge = _hinge(bodies[h], i, a, alpha, module)
        behind = {"pos": numbers(*module.connector_distance * PORT_DIRECTIONS[a])}
        if kappa := (a + 2 - b) % 4:
            behind["euler"] = numbers(kappa * math.pi / 2, 0, 0)
        bodies.append(_module_body(hinge, i, behind, module))
    end_effector = SubElement(platform, "body", name="end_effector", pos=numbers(*at.p_E))
    SubElement(end_effector, "inertial", pos="0 0 0", mass=numbers(task.end_effector.mass), diaginertia="0 0 0")
    rod = rod_of(design, at)
    if design.mount is not None and rod is not None:
        shape = {"type": "capsule", "size": numbers(rod.radius), "rgba": rgba(palette.END_EFFECTOR)}
        endpoints = numbers(*(rod.start - rod.end), 0, 0, 0)
        passing = {"contype": "0", "conaffinity": "0"} if physics.contacts else {}
        SubElement(end_effector, "geom", {"name": "rod", "fromto": endpoints, **shape, **passing})
        _bar(bodies[design.mount.module], design.mount.port, module)
        if physics.rod_mass or counts:
            add_rod_mass(platform, rod, design, at)
    met = physics.solid_regions and add_solid_regions(model, asset, world, design, at)
    if physics.contacts:
        add_tip(end_effector, design, rod, on_solid=met)
    SubElement(end_effector, "site", name="end_effector", rgba=rgba(palette.END_EFFECTOR))
    actuator = SubElement(model, "actuator")
    for i, q in itertools.product(range(design.topology.n), range(4)):  # module-major like the inputs
        rotor = f"module_{i}_rotor_{q}"
        SubElement(actuator, "general", {"class": SPIN_CLASSES[int(ROTOR_SPINS[q])], "name": rotor, "site": rotor})
    keyframe = SubElement(model, "keyframe")
    for k, u_k in enumerate(design.inputs):  # a pose at rest with the thrusts that produce it, which lag no longer
        thrusts = numbers(*module.thrust_coefficient * u_k.ravel())
        running = {} if physics.motor_lag is None else {"act": thrusts}
        key = {"name": f"load_case_{k}", "qpos": "0 0 0 1 0 0 0", "ctrl": thrusts, **running}
        SubElement(keyframe, "key", key)
    return xml_text(model)


def _defaults(default: Element, module: Module, gravity: float, physics: Physics) -> None:
    """State once what all sites, parts and rotors have in common."""
    body, l_arm = module.body, module.arm_length
    SubElement(default, "site", type="sphere", size=numbers(body.arm_width / 2))
    hub = SubElement(default, "default", {"class": "hub"})
    SubElement(hub, "geom", type="box", size=numbers(*(edge / 2 for edge in body.hub)), rgba=rgba(palette.MODULE))
    frame = SubElement(default, "default", {"class": "frame"})
    SubElement(frame, "geom", type="mesh", rgba=rgba(palette.MODULE))
    arm = SubElement(default, "default", {"class": "arm"})
    half = l_arm / 2, body.arm_width / 2, body.arm_width / 2
    SubElement(arm, "geom", type="box", size=numbers(*half), rgba=rgba(palette.ARM))
    rotor = SubElement(default, "default", {"class": "rotor"})
    size = numbers(body.rotor_radius, body.rotor_height / 2)
    SubElement(rotor, "geom", type="cylinder", size=size, rgba=rgba(palette.ROTOR, 0.5))
    bar = SubElement(default, "default", {"class": "joint"})
    look = {"rgba": rgba(palette.CONNECTOR), "contype": "0", "conaffinity": "0"}
    SubElement(bar, "geom", {"type": "capsule", "size": numbers(body.arm_width / 4), **look})
    limit = module.thrust_coefficient * module.max_input(gravity)
    for spin, name in SPIN_CLASSES.items():
        turning = SubElement(default, "default", {"class": name})
        drag_per_thrust = spin * module.torque_coefficient / module.thrust_coefficient
        gear, span = numbers(0, 0, 1, 0, 0, drag_per_thrust), numbers(module.min_input * limit, limit)
        motor = {"gear": gear, "ctrllimited": "true", "ctrlrange": span}
        SubElement(turning, "general", add_lag(motor, physics.motor_lag))


def _hinge(parent: Element, i: int, a: int, alpha: float, module: Module) -> Element:
    """Add the hinge at a parent's port a, at which module i hangs."""
    about_x, about_y = (0.0, alpha) if a % 2 == 0 else (alpha, 0.0)
    step = numbers(*module.connector_distance * PORT_DIRECTIONS[a])
    _bar(parent, a, module)
    hinge = SubElement(parent, "body", name=f"hinge_{i}", pos=step, euler=numbers(0, about_x, about_y))
    if module.joint_mass:
        SubElement(hinge, "inertial", pos="0 0 0", mass=numbers(module.joint_mass), diaginertia="0 0 0")
    _bar(hinge, a, module)
    return hinge


def _bar(body: Element, port: int, module: Module) -> None:
    endpoints = numbers(0, 0, 0, *module.connector_distance * PORT_DIRECTIONS[port])
    SubElement(body, "geom", {"class": "joint", "fromto": endpoints})


def _module_body(parent: Element, i: int, pose: dict[str, str], module: Module) -> Element:
    """Add module i with its mass, its parts and its rotors."""
    body = SubElement(parent, "body", {"name": f"module_{i}", **pose})
    x, y, z = module.inertia
    inertia = numbers(min(x, y + z), min(y, x + z), min(z, x + y))  # as MuJoCo checks them
    SubElement(body, "inertial", pos="0 0 0", mass=numbers(module.mass), diaginertia=inertia)
    frame = module.body.frame
    if frame is None:
        SubElement(body, "geom", {"class": "hub"})
    for k in range(len(frame or ())):
        SubElement(body, "geom", {"class": "frame", "mesh": f"frame_{k}"})
    for q, angle in enumerate(ROTOR_ANGLES):
        x, y = module.arm_length * math.cos(angle), module.arm_length * math.sin(angle)
        arm = {"class": "arm", "pos": numbers(x / 2, y / 2, 0), "euler": numbers(angle, 0, 0)}
        if frame is None:
            SubElement(body, "geom", arm)
        SubElement(body, "geom", {"class": "rotor", "pos": numbers(x, y, 0)})
        SubElement(body, "site", name=f"module_{i}_rotor_{q}", pos=numbers(x, y, 0))
    return body
