r"""A design as a model for MuJoCo (MJCF): rigid bodies, a thrust actuator per rotor, a keyframe per load case.

| symbol | meaning | unit |
|---|---|---|
| o_0 | the root module's centre from the platform COM, -p_COM | m |
| l_c, e_a | module centre to connector; direction of port a | m, - |
| alpha_i, kappa | hinge angle of the joint h-i; quarter turns of the child, (a + 2 - b) mod 4 | rad, - |
| k_f, k_tau | rotor thrust and drag-torque coefficients | N s^2, N m s^2 |
| u | squared rotor speed; the actuator's control is the thrust k_f u | rad^2/s^2, N |

The body `platform` floats freely. Its frame has its origin at the centre of mass and the axes of the task frame
W, so wrenches of load cases have the same components as in the task. Modules are its descendants along the tree,
each behind a hinge fixed at the design's angle. Masses are those of the solver and the audit: m and the module's
inertia at every module's centre, masses m_E at p_E and the joints' at their hinges. Some readers refuse a body
without mass and replace the inertia of a point, so each of these, and the body `platform`, has a mass of at least
MOTE and the inertia SPIN. The rod that holds the end-effector has a shape, and a mass if the design counts it.
`Physics` adds what a simulator may need beyond that.

An added rod mass moves the centre of mass off the origin of the body `platform`, so no keyframe hovers exactly; a
controller must compensate. The tip is a ball centred at the end-effector, as thick as the rod; it shrinks to a
point if the end-effector starts on a solid region, so that it does not start inside.

Solid regions of a task are bodies of the world: walls, panes, objects that the platform and the tip can touch.

| symbol | meaning | shape | unit |
|---|---|---|---|
| p_E | end-effector in the pose of the keyframes, the origin of the regions | (3,) | m |
| n_k | inward normal of a half-space that touches the cone along a generator | (3,) | - |

Balls, capsules and hulls are exported exactly. A half-space is a plane of MuJoCo, which is solid below its surface.
The outside of a cone is the union of 48 such planes (`Cone.half_spaces`); that cone is wider than the task's by up
to 1 / cos(pi / 48) - 1 = 0.2 % of its radius. Rod and tip do not collide with a region that contains p_E.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Comment, Element, SubElement

from topo_search.export import palette
from topo_search.export.poses import ModuleKind, RodPose, arms, kind_of, kinds, mass_of, rod_of, thrusts
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.design import Design
from topo_search.model.end_effector import TIP
from topo_search.model.exposure import segment_of
from topo_search.model.module import Module
from topo_search.model.shape import Shape
from topo_search.model.task import ResolvedTask
from verify.kinematics import Platform, platform
from verify.solid_regions import tip_distances

COLLISION = "3"
"""Group of geoms used only for contacts, which viewers hide by default."""
MOTE = 1e-15
"""Mass of a body that has none [kg]."""
SPIN = 1e-9
"""Moment of inertia of a point mass [kg m^2]; with less than 1e-10 some readers replace it by 1e-6."""
POINT = 1e-5
"""Radius of a tip that starts on a solid region [m]."""


@dataclass(frozen=True)
class Physics:
    """Physics beyond the model of the search; nothing by default."""

    motor_lag: float | None = None
    """Time constant of a rotor's thrust [s]; None: thrust follows its control without lag."""
    rod_mass: bool = False
    """True if the rod has mass, `end_effector.rod_linear_density` per metre."""
    contacts: bool = False
    """True if the end-effector has a tip that can touch things."""
    solid_regions: bool = False
    """True if the solid regions of the task are bodies of the world."""

    @property
    def about(self) -> str:
        """Text for the comment at the head of the file, one line each."""
        lines = []
        if self.motor_lag is not None:
            lines.append(f"Thrusts follow their controls with a time constant of {self.motor_lag:g} s.")
        if self.rod_mass:
            lines.append("The rod has mass, which the design neglects: the centre of mass is not the origin.")
        if self.contacts:
            lines.append("The geometry `tip` represents the end of the rod in contacts.")
        if self.solid_regions:
            lines.append("Bodies `exposure_K` are the task's solid regions, placed for the pose of the keyframes.")
        return "".join(f"{line}\n" for line in lines)


AS_SEARCHED = Physics()
"""Nothing beyond the model of the search."""


def add_rod_mass(floating: Element, rod: RodPose, design: Design, poses: Platform) -> None:
    """Add the rod's mass as a separate body with its z axis along the rod."""
    mass, inertia, middle = mass_of(rod, design, poses)
    v = (rod.end - rod.start) / rod.length
    along = float(v @ inertia @ v)
    across = (float(inertia.trace()) - along) / 2
    body = SubElement(floating, "body", name="rod_mass", pos=numbers(*middle), zaxis=numbers(*v))
    moments = numbers(across, across, along)
    SubElement(body, "inertial", pos="0 0 0", mass=numbers(mass), diaginertia=moments)


def add_tip(end_effector: Element, design: Design, rod: RodPose | None, *, on_solid: bool) -> None:
    """Add the contact geoms of the end-effector: the rod without its end, and a ball at the end.

    Args:
        end_effector: the body of the end-effector.
        design: the design.
        rod: its rod.
        on_solid: whether the end-effector starts on a solid region.
    """
    radius = design.task.end_effector.rod_radius
    style = {"rgba": rgba(palette.END_EFFECTOR), "mass": "0"}
    if rod is not None and rod.length > TIP * radius:
        back = (rod.start - rod.end) / rod.length
        endpoints = numbers(*(back * rod.length), *(back * TIP * radius))
        hidden = {"group": COLLISION, "type": "cylinder", "size": numbers(radius), **style}
        SubElement(end_effector, "geom", {"name": "rod_contact", "fromto": endpoints, **hidden})
    size = numbers(POINT if on_solid else radius)
    SubElement(end_effector, "geom", {"name": "tip", "type": "sphere", "size": size, **style})


def numbers(*values: float) -> str:
    """Return numbers separated by blanks, with all digits of float64."""
    return " ".join(repr(float(value)) for value in values)


def rgba(colour: str, alpha: float = 1.0) -> str:
    """Return a colour like #d55e00 as red, green, blue and opacity in [0, 1]."""
    return numbers(*(int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)), alpha)


def xml_text(root: ElementTree.Element) -> str:
    """Return the text of an XML file; indents `root` in place."""
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text.decode() + "\n"


def add_solid_regions(model: Element, asset: Element, world: Element, design: Design, poses: Platform) -> bool:
    """Add every solid region as a body `exposure_K`, or `exposure_K_P` where it has several parts.

    Returns:
        Whether the end-effector starts on the surface of one of them, or within the rod's radius of it.
    """
    starts_on_solid, distances = False, tip_distances(design)
    touching = 1e-7  # depth of p_E up to which it counts as touching a region, not as inside it [m]
    for number, exposure in enumerate(design.task.exposure):
        if not exposure.solid:
            continue
        for part, task_shape in enumerate(exposure.shapes):
            segment = segment_of(exposure, part)
            name = f"exposure_{number}" if segment is None else f"exposure_{number}_{segment}"
            shape = task_shape.at(poses.p_e)
            body = SubElement(world, "body", name=name, pos=numbers(*poses.p_e))
            _add_shape(body, asset, name, shape)
            distance = distances[number, segment]
            if distance < -touching:
                contact = model.find("contact")
                contact = SubElement(model, "contact") if contact is None else contact
                SubElement(contact, "exclude", body1=name, body2="end_effector")
            elif distance <= design.task.end_effector.rod_radius:
                starts_on_solid = True
    return starts_on_solid


def _add_shape(body: Element, asset: Element, name: str, shape: Shape) -> None:
    """Add the geometry of a shape, in metres from p_E."""
    style, half_spaces = {"rgba": rgba(palette.EXPOSURE, 0.3)}, shape.half_spaces()
    for k, (point, n_k) in enumerate(half_spaces):
        side = {"name": f"{name}_side_{k}", "zaxis": numbers(*n_k), "group": COLLISION}
        only_side = {"name": name, "zaxis": numbers(*n_k)}
        # drawn 2 m wide
        plane = {"type": "plane", "pos": numbers(*point), "size": numbers(1, 1, 1), **style}
        SubElement(body, "geom", {**(side if len(half_spaces) > 1 else only_side), **plane})
    if half_spaces:
        return
    if shape.primitive is None:
        SubElement(asset, "mesh", name=name, vertex=numbers(*shape.mesh(math.inf).vertices.ravel()))
        geom = {"type": "mesh", "mesh": name}
    else:
        kind, sizes = shape.primitive
        geom = {"type": kind, **{size: numbers(*values) for size, values in sizes.items()}}
    SubElement(body, "geom", {"name": name, **geom, **style})


SPIN_CLASSES = {-1: "drag_against_thrust_axis", 1: "drag_along_thrust_axis"}
"""Default classes of actuators by the sign of the drag torque."""

ABOUT = """
Body `platform`: origin at the centre of mass, axes of the task frame. Units: kg, m, s, rad, N.
Actuator `module_I_rotor_Q`, Q = 0..3: the thrust of a rotor [N], k_f times its squared speed; with its drag torque.
Its control range is that of a running rotor; set gainprm to 0 for a failed one.
Keyframe `load_case_K`: the thrusts that produce load case K. Gravity is not part of a load case.
"""


def mjcf(design: Design, physics: Physics = AS_SEARCHED) -> str:
    """Return a design as the text of an MJCF file.

    Args:
        design: the design.
        physics: physics beyond the model of the search.
    """
    task, modules = design.task, design.task.modules_of_nodes
    poses, counts_rod = platform(design), task.end_effector.counted_rod is not None
    model = Element("mujoco", model=f"{task.name} {design.topology.key}")
    model.append(Comment(ABOUT + replace(physics, rod_mass=physics.rod_mass and not counts_rod).about))
    SubElement(model, "compiler", angle="radian", eulerseq="zxy", inertiafromgeom="false")
    SubElement(model, "option", gravity=numbers(0, 0, -task.gravity))
    _add_names(model, design)
    default, types = SubElement(model, "default"), kinds(design)
    _defaults(default, types, task, physics)
    sky = {"type": "skybox", "builtin": "flat", "rgb1": "1 1 1", "rgb2": "1 1 1", "width": "8", "height": "8"}
    asset = SubElement(model, "asset")
    SubElement(asset, "texture", sky)
    for kind in types:
        for k, piece in enumerate(kind.module.body.frame or ()):
            corners = {
                "vertex": numbers(*itertools.chain(*piece.vertices)),
                "face": " ".join(map(str, itertools.chain(*piece.triangles))),
            }
            SubElement(asset, "mesh", {"name": f"frame{_tag(kind)}_{k}", **corners})
    world = SubElement(model, "worldbody")
    SubElement(world, "light", pos="0 0 5", dir="0 0 -1", directional="true")
    floating = SubElement(world, "body", name="platform")
    SubElement(floating, "freejoint", name="platform")
    SubElement(floating, "site", name="centre_of_mass", rgba=rgba(palette.CENTRE_OF_MASS))
    _point_mass(floating, 0.0)
    root_pose = {"pos": numbers(*-poses.p_com), "euler": numbers(*design.root_orientation_rad)}
    kind_at = [kind_of(design, i) for i in range(design.topology.n)]
    bodies = [_module_body(floating, 0, root_pose, kind_at[0])]
    for (h, i, a, b), alpha in zip(design.topology.edges(), design.hinge_angles_rad, strict=True):
        hinge = _hinge(bodies[h], i, a, alpha, (modules[h], modules[i]), task.module.joint_mass)
        beyond_hinge = {"pos": numbers(*modules[i].connector_distance * PORT_DIRECTIONS[a])}
        if kappa := (a + 2 - b) % 4:
            beyond_hinge["euler"] = numbers(kappa * math.pi / 2, 0, 0)
        bodies.append(_module_body(hinge, i, beyond_hinge, kind_at[i]))
    for k, (i, a, _, _) in enumerate(design.topology.closures):  # no loop: the modules are one body already
        connector = numbers(*modules[i].connector_distance * PORT_DIRECTIONS[a])
        closure = SubElement(bodies[i], "body", name=f"closure_{k}", pos=connector)
        _point_mass(closure, task.module.joint_mass)
        _bar(bodies[i], a, modules[i])
        _bar(closure, a, modules[i])
    end_effector = SubElement(floating, "body", name="end_effector", pos=numbers(*poses.p_e))
    _point_mass(end_effector, task.end_effector.mass)
    rod = rod_of(design, poses)
    if design.mount is not None and rod is not None:
        shape = {"type": "capsule", "size": numbers(rod.radius), "rgba": rgba(palette.END_EFFECTOR)}
        endpoints = numbers(*(rod.start - rod.end), 0, 0, 0)
        no_contact = {"contype": "0", "conaffinity": "0"} if physics.contacts else {}
        SubElement(end_effector, "geom", {"name": "rod", "fromto": endpoints, **shape, **no_contact})
        _bar(bodies[design.mount.module], design.mount.port, modules[design.mount.module])
        if physics.rod_mass or counts_rod:
            add_rod_mass(floating, rod, design, poses)
    starts_on_solid = physics.solid_regions and add_solid_regions(model, asset, world, design, poses)
    if physics.contacts:
        add_tip(end_effector, design, rod, on_solid=starts_on_solid)
    SubElement(end_effector, "site", name="end_effector", rgba=rgba(palette.END_EFFECTOR))
    actuator = SubElement(model, "actuator")
    # module-major like the inputs
    for i, module in enumerate(modules):
        for q, spin in enumerate(module.rotor_table.spins):
            rotor, own = f"module_{i}_rotor_{q}", _own_motor(kind_at[i], q, task)
            SubElement(actuator, "general", {"class": SPIN_CLASSES[-spin], "name": rotor, "site": rotor, **own})
    keyframe = SubElement(model, "keyframe")
    for k, T_k in enumerate(thrusts(design)):  # at rest, with thrusts that have reached their controls
        running = {} if physics.motor_lag is None else {"act": numbers(*T_k)}
        key = {"name": f"load_case_{k}", "qpos": "0 0 0 1 0 0 0", "ctrl": numbers(*T_k), **running}
        SubElement(keyframe, "key", key)
    return xml_text(model)


def _add_names(model: Element, design: Design) -> None:
    """Add the name of each module's type as a text `type_I`, if there are types."""
    if design.task.module_types:
        custom = SubElement(model, "custom")
        for i in range(design.topology.n):
            SubElement(custom, "text", name=f"type_{i}", data=kind_of(design, i).name)


def _tag(kind: ModuleKind) -> str:
    return kind.suffix.replace(" of ", "_")


def _defaults(default: Element, types: Sequence[ModuleKind], task: ResolvedTask, physics: Physics) -> None:
    """Add the default classes shared by all sites, joints and rotors, and by the parts of each type of module."""
    module, no_contact = task.module, {"contype": "0", "conaffinity": "0"}
    SubElement(default, "site", type="sphere", size=numbers(module.body.arm_width / 2))
    classes: list[tuple[str, str, list[float], str, dict[str, str]]] = []
    for kind in types:
        body, l_arm, tag = kind.module.body, kind.module.arm_length, _tag(kind)
        classes += [
            (f"hub{tag}", "box", [edge / 2 for edge in body.hub], rgba(kind.colour), {}),
            (f"frame{tag}", "mesh", [], rgba(kind.colour), {}),
            (f"arm{tag}", "box", [l_arm / 2, body.arm_width / 2, body.arm_width / 2], rgba(palette.ARM), {}),
            (f"rotor{tag}", "cylinder", [body.rotor_radius, body.rotor_height / 2], rgba(palette.ROTOR, 0.5), {}),
        ]
    classes.append(("joint", "capsule", [module.body.arm_width / 4], rgba(palette.CONNECTOR), no_contact))
    for name, shape, sizes, colour, more in classes:
        size = {"size": numbers(*sizes)} if sizes else {}
        part = SubElement(default, "default", {"class": name})
        SubElement(part, "geom", {"type": shape, **size, "rgba": colour, **more})
    limit = module.thrust_coefficient * module.max_input(task.gravity)
    tau = physics.motor_lag
    lag = {} if tau is None else {"dyntype": "filterexact", "dynprm": numbers(tau), "actearly": "true"}
    for spin, name in SPIN_CLASSES.items():
        turning = SubElement(default, "default", {"class": name})
        drag_per_thrust = spin * module.torque_coefficient / module.thrust_coefficient
        gear, span = numbers(0, 0, 1, 0, 0, drag_per_thrust), numbers(module.min_input * limit, limit)
        SubElement(turning, "general", {"gear": gear, "ctrllimited": "true", "ctrlrange": span, **lag})


def _own_motor(kind: ModuleKind, q: int, task: ResolvedTask) -> dict[str, str]:
    """Return what rotor q's motor has instead of its class; empty if all rotors are alike."""
    module = kind.module
    rotors, ratio = module.rotor_table, module.torque_coefficient / module.thrust_coefficient
    if rotors.is_uniform and not kind.name:
        return {}
    limit = float((module.thrust_coefficient * rotors.gains * module.max_inputs(task.gravity))[q])
    drag = float(rotors.drags[q] / rotors.gains[q]) * ratio
    return {"gear": numbers(0, 0, 1, 0, 0, drag), "ctrlrange": numbers(task.module.min_input * limit, limit)}


def _hinge(parent: Element, i: int, a: int, alpha: float, pair: tuple[Module, Module], mass: float) -> Element:
    """Add the hinge of module i at a parent's port a, of a mass [kg], between a pair of parent and child."""
    about_x, about_y = (0.0, alpha) if a % 2 == 0 else (alpha, 0.0)
    connector = numbers(*pair[0].connector_distance * PORT_DIRECTIONS[a])
    _bar(parent, a, pair[0])
    hinge = SubElement(parent, "body", name=f"hinge_{i}", pos=connector, euler=numbers(0, about_x, about_y))
    _point_mass(hinge, mass)
    _bar(hinge, a, pair[1])
    return hinge


def _point_mass(body: Element, mass: float) -> None:
    """Add a mass at a body's origin."""
    SubElement(body, "inertial", pos="0 0 0", mass=numbers(mass or MOTE), diaginertia=numbers(SPIN, SPIN, SPIN))


def _bar(body: Element, port: int, module: Module) -> None:
    endpoints = numbers(0, 0, 0, *module.connector_distance * PORT_DIRECTIONS[port])
    SubElement(body, "geom", {"class": "joint", "fromto": endpoints})


def _module_body(parent: Element, i: int, pose: dict[str, str], kind: ModuleKind) -> Element:
    """Add module i with its mass, its parts and its rotors."""
    module, tag = kind.module, _tag(kind)
    body = SubElement(parent, "body", {"name": f"module_{i}", **pose})
    x, y, z = module.inertia
    inertia = numbers(min(x, y + z), min(y, x + z), min(z, x + y))  # MuJoCo checks the triangle inequality
    SubElement(body, "inertial", pos="0 0 0", mass=numbers(module.mass), diaginertia=inertia)
    frame = module.body.frame
    if frame is None:
        SubElement(body, "geom", {"class": f"hub{tag}"})
    for k in range(len(frame or ())):
        SubElement(body, "geom", {"class": f"frame{tag}", "mesh": f"frame{tag}_{k}"})
    for q, (arm, axis) in enumerate(zip(arms(module), module.rotor_table.axes, strict=True)):
        middle = {"pos": numbers(*arm.end / 2), "euler": numbers(arm.azimuth, 0, 0 - arm.elevation)}
        if frame is None and arm.length:
            own = [arm.length / 2, module.body.arm_width / 2, module.body.arm_width / 2]
            size = {} if arm.length == module.arm_length else {"size": numbers(*own)}
            SubElement(body, "geom", {"class": f"arm{tag}", **size, **middle})
        place = {"pos": numbers(*arm.end)} | ({} if axis[2] == 1 else {"zaxis": numbers(*axis)})
        radius = float(module.rotor_radii[q])
        own_disc = (
            {} if module.rotor_table.sizes[q] == 1 else {"size": numbers(radius, module.body.rotor_height / 2)}
        )
        SubElement(body, "geom", {"class": f"rotor{tag}", **own_disc, **place})
        SubElement(body, "site", {"name": f"module_{i}_rotor_{q}", **place})
    return body
