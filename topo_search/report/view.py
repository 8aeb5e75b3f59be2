"""Pictures of one design: a thumbnail, and the data of the 3-D view: parts, throttles, load cases, assembly steps.

Meshes that all modules share are stored once, in the module's frame; the page's script places the copies.

Forces are drawn as straight arrows, torques as arrows along part of a ring around their axis:

| symbol | meaning | shape | unit |
|---|---|---|---|
| f, tau | force and torque, in the axes of the task | (3,) | N, N m |
| S | arrow length of the largest force; the radius of rings is proportional to it | | m |

The forces that a platform can exert at its end-effector while it hovers form a convex polytope:

| symbol | meaning | shape | unit |
|---|---|---|---|
| u | rotor inputs, module-major, 0 <= u <= u_max | (4 n,) | rad^2/s^2 |
| F, T | forces and torques about the centre of mass of unit inputs | (3, 4 n) | N s^2, N m s^2 |
| f | force exerted at the end-effector: F u = m_t g e_z + f, T u = p_E x f | (3,) | N |

All vectors are in the axes of the task. Eliminating f gives (T - p_E x F) u = -p_E x m_t g e_z. The polytope is
only drawn; the figures beside it are proven by the audit.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from topo_search.export import palette
from topo_search.export.allocation import largest_thrusts, thrust_matrix
from topo_search.export.poses import (
    azimuth_deg,
    kinds,
    largest_wrench,
    load_wrenches,
    poses_to_draw,
    throttles,
    towards_viewer,
)
from topo_search.export.solids import cylinder, join
from topo_search.limits import vector as vector_text
from topo_search.model import Array, Assembly, Audit, Design, Indices, LoadCase, Module, ResolvedTask
from topo_search.model.mesh import Mesh, rotation_to
from topo_search.model.topology import PORT_NAMES
from topo_search.report.scene import NUMBERED, Part, ball, closest_words, ring, scene, straight_arrow
from topo_search.report.wording import clearance, closest, figures, length, rounded_down, rounded_up
from verify.air.jets import MODEL, jets
from verify.flight.programs import Bounds
from verify.flight.vehicle import force_hull
from verify.kinematics import Platform


def arrows(design: Design, poses: Platform) -> Iterator[dict[str, Any]]:
    """Yield every load case: its name, description, labels with positions, and arrows as parts."""
    S = longest_arrow(design, poses)
    shortest, thick, radius = 0.15, 0.025, 0.3  # shortest arrow, shaft radius, ring radius, over the longest arrow
    largest = {kind: largest_wrench(design, poses, kind) for kind in ("force", "torque")}
    for k, wrenches in itertools.groupby(load_wrenches(design, poses), key=lambda wrench: wrench[0]):
        meshes, labels, words = [], [], []
        for _, kind, where, point, vector in wrenches:
            size = float(np.linalg.norm(vector))
            if not size:
                continue
            length = S * max(shortest, size / largest[kind])
            make_arrow, arrow_size = (straight_arrow, length) if kind == "force" else (ring, radius * length)
            mesh, end = make_arrow(point, vector / size, arrow_size, thick * S)
            text = f"{figures(size, 3)} {'N' if kind == 'force' else 'N m'}"
            meshes.append(mesh)
            labels.append((text, end.round(5).tolist()))
            words.append(f"{kind} {text}, along {vector_text((vector / size).tolist())}, at the {where}")
        case = [Part("case", f"load case {k}", palette.WRENCH, join(meshes))] if meshes else []
        yield {
            "name": design.task.case_labels[k],
            "description": "; ".join(words) or "nothing",
            "labels": labels,
            "parts": [*case, *_contact(design, design.task.load_cases[k], poses, S)],
        }


def _contact(design: Design, case: LoadCase, poses: Platform, longest: float) -> Iterator[Part]:
    """Yield the contact plane of a push in hover: a disc at the end-effector, normal to the force."""
    f = np.array(case.at_end_effector.force)
    weight = design.task.force_unit(design.topology.n)
    if not f.any() or case.at_com.force[2] < 0.999 * weight:  # not hovering unless the rotors carry the weight
        return
    disc = cylinder(0.35 * longest, 0.002, 48).move(rotation_to(f / np.linalg.norm(f)), poses.end_effector)
    yield Part("contact", "contact plane", palette.CONTACT, disc, opacity=0.5)


def metres_per_newton(design: Design, poses: Platform) -> float:
    """Return the scale of force arrows [m/N]; if no load case has a force, the weight has the longest arrow."""
    force = largest_wrench(design, poses, "force") or design.task.force_unit(design.topology.n)
    return longest_arrow(design, poses) / force


def longest_arrow(design: Design, poses: Platform) -> float:
    """Return the length of the longest arrow: 0.6 of the platform's extent from its centre of mass [m]."""
    points = np.vstack([poses.p, poses.end_effector])
    reach = float(np.linalg.norm(points - poses.p_com, axis=1).max()) + design.task.module.arm_length
    return 0.6 * reach


def force_polytope(design: Design, poses: Platform) -> tuple[Array, Indices] | None:
    """Return vertices, (m, 3) [N], and triangles, (t, 3) vertex indices, of the polytope of forces.

    None if the platform cannot hover, or if all forces lie in a plane.
    """
    task, weight = design.task, design.task.force_unit(design.topology.n)
    scale = np.repeat([weight, weight * task.module.arm_length], 3)[:, None]
    F, T = np.split(largest_thrusts(task) * thrust_matrix(task, poses) / scale, 2)
    x, y, z = poses.p_e / task.module.arm_length
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # lever @ f = p_E x f
    carried, bounds = np.array([0.0, 0.0, 1.0]), Bounds(np.zeros(F.shape[1]), np.ones(F.shape[1]))
    # the hull may have thousands of facets; five rounds approximate its volume within a few percent
    polytope = force_hull(F, T - lever @ F, -lever @ carried, bounds, rounds=5)
    return None if polytope is None else (weight * (polytope.points - carried), polytope.simplices)


def view(
    design: Design,
    poses: Platform,
    audit: Audit | None,
    *,
    forces: bool = False,
    flights: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Return the data of the 3-D view of a design, which the page's script draws.

    Args:
        design: any design.
        poses: its poses.
        audit: its audit.
        forces: whether to add the forces that it can exert in hover, which takes a second or more.
        flights: flights to play.
    """
    assembly = None if audit is None else audit.assembly
    nearest = closest(audit)
    return {
        "parts": [part.dump() for part in scene(design, poses, nearest, assembly)],
        "towards": towards_viewer(azimuth_deg(poses)).round(4).tolist(),
        "R": poses.R.round(7).tolist(),
        "p": poses.p.round(6).tolist(),
        "numbered": design.topology.n <= NUMBERED,
        "marks": [["tip", poses.end_effector.round(6).tolist()], ["centre of mass", poses.p_com.round(6).tolist()]],
        "modules": _modules(design, poses, audit),
        "throttle": _throttles(design),
        "air": _air(design),
        "cases": [{**case, "parts": [part.dump() for part in case["parts"]]} for case in arrows(design, poses)],
        "closest": None if nearest is None else closest_words(nearest),
        "steps": _steps(design, assembly),
        "forces": _forces(design, poses, audit) if forces else None,
        "flights": flights,
    }


def _throttles(design: Design) -> list[list[list[float]]]:
    """Return the throttle of each rotor, by load case and module."""
    counts = np.cumsum([module.rotor_table.count for module in design.task.modules_of_nodes])[:-1]
    return [[part.tolist() for part in np.split(row, counts)] for row in throttles(design).round(6)]


def _air(design: Design) -> dict[str, Any]:
    """Return the parameters from which the script computes air speeds, besides poses and throttles [m, m/s]."""
    return {
        "of": list(design.topology.types) or [0] * design.topology.n,
        "types": [
            {"rotors": _jets(kind.module, design.task), "jet": kind.module.airflow.jet.model_dump()}
            for kind in kinds(design)
        ],
        "merged": MODEL.merged_at,
        "merges": MODEL.merges_over,
        "shear": MODEL.shear,
    }


def _jets(module: Module, task: ResolvedTask) -> list[dict[str, Any]]:
    """Return the jet of each rotor of a module in its frame [m, m/s]."""
    table, l_arm, I = module.rotor_table, module.arm_length, np.eye(3)[None]
    if not table.count:
        return []
    rotors, u_max = table.positions[None], np.full((1, table.count), module.max_input(task.gravity))
    full = jets(module, task.air_density, np.zeros((1, 3)), I, rotors, u_max)
    starts, axes = table.jet_axes
    columns = {
        "at": (l_arm * table.positions).round(6),
        "axis": table.axes,
        "radius": module.rotor_radii,
        "full": full.induced[0],
        "share": full.shares,
        "start": (l_arm * starts).round(6),
        "against": axes,
        "diameter": np.broadcast_to(l_arm * full.diameters, table.count),
    }
    return [{name: column[q].tolist() for name, column in columns.items()} for q in range(table.count)]


def _forces(design: Design, poses: Platform, audit: Audit | None) -> dict[str, Any] | None:
    """Return the forces that can be exerted at the end-effector in hover, to the scale of the arrows."""
    polytope = force_polytope(design, poses)
    if polytope is None:
        return None
    vertices, triangles = polytope
    scale = metres_per_newton(design, poses)
    corners = Mesh(poses.end_effector + scale * vertices, triangles)
    words = "feasible forces"
    parts = [Part("forces", words, palette.OFFSET, corners, opacity=0.35)]
    caption = "All forces that the tip can exert in hover, to the scale of the load cases' arrows."
    reserve = None if audit is None or audit.flight is None else audit.flight.hover.force_reserve_N
    if reserve is not None:
        sphere = ball(poses.end_effector, scale * reserve)
        parts.append(Part("forces", "force reserve", palette.END_EFFECTOR, sphere))
        caption += f" The ball shows the force reserve: {rounded_down(reserve, ' N')} in any direction."
    return {"description": caption, "parts": [part.dump() for part in parts]}


def _modules(design: Design, poses: Platform, audit: Audit | None) -> list[str]:
    """Return the tooltip of each module."""
    joints = [["the root"], *([] for _ in design.hinge_angles_rad)]
    for (h, a, i, b), alpha in design.bolts:
        angle = f"hinge {figures(math.degrees(alpha), 3)}°"
        joints[i].append(f"port {PORT_NAMES[b]} bolted to port {PORT_NAMES[a]} of module {h}, {angle}")
    tooltips = []
    names = {i: f", {kind.name}" for kind in kinds(design) if kind.name for i in kind.nodes}
    for i, of_module in enumerate(joints):
        lines = [
            f"module {i}{names.get(i, '')}",
            *of_module,
            f"centre {_vector(poses.p[i])} m",
            f"thrust axis {_vector(poses.z[i])}",
        ]
        tooltips.append("\n".join([*lines, *([] if audit is None else _audit_lines(audit, i))]))
    return tooltips


def _audit_lines(audit: Audit, i: int) -> Iterator[str]:
    """Yield a module's smallest clearance and the largest moment in its joint, from the audit."""
    between = ("airflow", "separation", "body", "rotor-airflow", "bracket-airflow", "bracket-rotor", "rod-airflow")
    pairs = [pair for pair in audit.pairs if pair.a == i or (pair.b == i and pair.kind in between)]
    if pairs:
        nearest = min(pairs, key=lambda pair: pair.analytic_m)
        yield f"smallest clearance {clearance(nearest)}: {nearest.name}"
    loads = [] if audit.flight is None else [load for load in audit.flight.joints if load.child == i]
    if loads:
        worst = max(loads, key=lambda load: load.moment_Nm)
        yield f"largest joint moment {rounded_up(worst.moment_Nm, ' N m')}, in {worst.case}"


def _steps(design: Design, assembly: Assembly | None) -> list[str]:
    """Return the assembly steps, the root first and the rod or the end-effector last."""
    steps = ["Start with module 0, the root."]
    for i, joints in itertools.groupby(design.bolts, key=lambda joint: joint[0][2]):
        ((h, a, _, b), alpha), *closures = joints
        closed = (f", port {PORT_NAMES[d]} to port {PORT_NAMES[c]} of module {k}" for (k, c, _, d), _ in closures)
        steps.append(
            f"Bolt port {PORT_NAMES[b]} of module {i} to port {PORT_NAMES[a]} of module {h}{''.join(closed)}; "
            f"set the hinge to {figures(math.degrees(alpha), 5)}°."
        )
    sheet = None if assembly is None else assembly.end_effector
    if sheet is not None and sheet.mount is not None and sheet.rod is not None:
        steps.append(
            f"Fix the rod of {length(sheet.rod.length_m)} to port {PORT_NAMES[sheet.mount.port]} of module "
            f"{sheet.mount.module}; it holds the end-effector."
        )
    else:
        steps.append("Mount the end-effector; no straight rod is known that could hold it.")
    return steps


def _vector(values: np.ndarray[Any, Any]) -> str:
    return f"[{', '.join(f'{x:.3f}' for x in (values + 0.0).tolist())}]".replace("-", "−")


def _top(module: Module) -> Array:
    """Return the corners of a hub's upper side in the module's frame, (4, 3) [m]."""
    return np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]) * module.body.hub / 2


def thumbnail(design: Design, side: int = 36) -> Markup:
    """Return a small picture of a design as inline SVG, from the viewpoint of the 3-D view.

    Args:
        design: any design.
        side: edge of the picture [px].
    """
    poses, sides = poses_to_draw(design), 10  # sides of a rotor disc
    towards = towards_viewer(azimuth_deg(poses))
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, towards)])  # right and down, like pixels
    angles = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    modules = design.task.modules_of_nodes
    hubs = [poses.p_com + at[: module.rotor_table.count] for at, module in zip(poses.rotors, modules, strict=True)]
    discs = np.concatenate(
        [
            hub[:, None] + (module.rotor_radii[:, None, None] * circle) @ R.T
            for hub, module, R in zip(hubs, modules, poses.R, strict=True)
        ]
    )
    bodies = [
        poses.p[i] + _top(kind.module) @ poses.R[i].T
        for kind in kinds(design)
        if not kind.module.rotor_table.count
        for i in kind.nodes
    ]
    outline = np.concatenate([discs.reshape(-1, 3), *bodies, poses.end_effector[None]]) @ axes.T
    low, high = outline.min(axis=0), outline.max(axis=0)
    tip = max(3, side // 40)
    scale = (side - 2 * tip) / max(*(high - low), 1e-9)

    def pixels(points: Array) -> str:
        flat = side / 2 + scale * (points @ axes.T - (low + high) / 2)
        return " ".join(f"{u:.0f},{v:.0f}" for u, v in flat)

    back_first = np.argsort(np.concatenate(hubs) @ towards)
    arms = "".join(f'<path d="M{pixels(hub[[0, 2]])}M{pixels(hub[[1, 3]])}"/>' for hub in hubs if len(hub) >= 4)
    arms += "".join(f'<polygon points="{pixels(body)}" fill="{palette.ARM}"/>' for body in bodies)
    rotors = "".join(f'<polygon points="{pixels(discs[i])}"/>' for i in back_first)
    x, y = pixels(poses.end_effector[None]).split(",")
    return Markup(
        f'<svg class="thumbnail" width="{side}" height="{side}" viewBox="0 0 {side} {side}" aria-hidden="true">'
        f'<g stroke="{palette.ARM}">{arms}</g><g fill="{palette.ROTOR}" stroke="{palette.MODULE}">{rotors}</g>'
        f'<circle cx="{x}" cy="{y}" r="{tip}" fill="{palette.END_EFFECTOR}"/></svg>'
    )
