"""Charts of a maximised reserve: all that the rotors can add, and the largest disc or ball within it.

Forces that leave the torque about a point unchanged form the zero-moment force polytope, torques that leave the
force unchanged a polytope of torques. A disc is drawn in the horizontal plane, a ball in three planes through its
centre.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import HalfspaceIntersection, QhullError

from topo_search.export import palette
from topo_search.export.poses import largest_inputs
from topo_search.model import Array, Audit, Design, LoadCase
from topo_search.model.largest_value import ability
from topo_search.model.maximized import RESERVES, balls_of
from topo_search.report import Figure
from topo_search.report.charts import axes, line, markers
from topo_search.report.wording import rounded_down
from verify.flight.programs import Bounds
from verify.flight.vehicle import force_hull
from verify.kinematics import has_rotor, platform, required_wrench, wrench_map

PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
"""Axes of the planes through the centre of a ball."""
FILL = "rgba(0,114,178,0.15)"
"""Colour inside an outline."""


class Slice(NamedTuple):
    """A plane section of a polytope through the centre of its ball."""

    caption: str
    plane: str
    """Two of x, y and z."""
    outline: Array
    """Vertices in order, shape (m, 2) [N or N m]."""
    radius: float
    """Radius of the ball, from the audit [N or N m]."""
    weakest: Array | None
    """Direction in which a disc ends first, shape (2,)."""
    unit: str


def polytopes(designs: Sequence[tuple[Design, Audit | None]]) -> dict[str, Any] | None:
    """Return the charts of designs, the best first, to one scale; None unless a reserve is maximised."""
    best = designs[0][0].task
    if best.search.maximize not in RESERVES:
        return None
    sections = [section for design, audit in designs if audit is not None for section in _sections(design, audit)]
    reach = 1.05 * max((float(np.abs(section.outline).max()) for section in sections), default=0.0)
    charts = [
        (f"polytope-{number}", section.caption, _figure(section, reach)) for number, section in enumerate(sections)
    ]
    return {"charts": charts, "ability": ability(best, best.search.reached)} if charts else None


def _sections(design: Design, audit: Audit) -> Iterator[Slice]:
    """Yield the sections of the polytope in which the smallest ball of a design lies."""
    task, flight = design.task, audit.flight
    if flight is None:
        return
    is_force = task.search.maximize == "force_reserve"
    is_disc = is_force and task.flight.directions == "horizontal"
    name, unit = ("force", "N") if is_force else ("torque", "N m")
    radii = ((getattr(flight.cases[ball.number], ball.size) or 0.0, ball) for ball in balls_of(task))
    radius, ball = min(radii, key=lambda pair: pair[0])
    at_tip = is_force and not ball.point
    facets = _facets(design, ball.case, is_force=is_force, at_tip=at_tip)
    if facets is None:
        return
    where = f" at the {'end-effector' if at_tip else 'centre of mass'}" * is_force
    size = f"{design.topology.key}: {rounded_down(radius, digits=4)} {unit}"
    weakest = getattr(flight.cases[ball.number], ball.weakest)
    for plane, pair in PLANES.items():
        outline = None if is_disc and plane != "xy" else _outline(facets[:, [*pair, 3]])
        if outline is not None:
            what = "horizontal forces" if is_disc else f"{name}s along {plane[0]} and {plane[1]}"
            towards = np.array(weakest)[:2] if is_disc and weakest is not None else None
            yield Slice(f"{size} ({what}{where}, {ball.label})", plane, outline, radius, towards, unit)


def _facets(design: Design, case: LoadCase, *, is_force: bool, at_tip: bool) -> Array | None:
    """Return the facets n . x + d <= 0 of what can be added to a load case, rows (n, d); None if it has no volume.

    That is a force at the tip or at the COM, or a torque.
    """
    task, placed = design.task, platform(design)
    units = np.repeat([task.force_unit(task.n), task.torque_unit(task.n)], 3)
    A = wrench_map(placed, task.modules_of_nodes)[:, has_rotor(task).ravel()] * largest_inputs(task)
    wrenches = np.column_stack([A, required_wrench(case, placed.p_e)])
    if at_tip:
        wrenches[3:] -= np.cross(placed.p_e, wrenches[:3], axisb=0).T
    force, torque = np.split(wrenches / units[:, None], 2)
    varied, fixed = (force, torque) if is_force else (torque, force)
    box = Bounds(np.full(A.shape[1], task.module.min_input), np.ones(A.shape[1]))
    hull = force_hull(varied[:, :-1], fixed[:, :-1], fixed[:, -1], box)
    if hull is None:
        return None
    n, d = np.split(np.unique(hull.equations, axis=0), [3], axis=1)
    return np.hstack([n, (d + n @ varied[:, -1:]) * units[0 if is_force else 3]])


def _outline(facets: Array) -> Array | None:
    """Return the vertices of the polygon n . x + d <= 0 in order, shape (m, 2); None if zero is not inside."""
    try:
        vertices: Array = HalfspaceIntersection(facets, np.zeros(2)).intersections
    except QhullError:
        return None
    return vertices[np.argsort(np.arctan2(vertices[:, 1], vertices[:, 0]))]


def _figure(section: Slice, reach: float) -> Figure:
    """Return the chart of a section, with the same scale along both axes."""
    x, y = np.vstack([section.outline, section.outline[:1]]).T.round(4).tolist()
    angles = np.linspace(0, 2 * np.pi, 91)
    across, up = (section.radius * np.stack([np.cos(angles), np.sin(angles)])).round(4).tolist()
    can = line(x, y, "can be added", palette.CONNECTOR, 2)
    data = [
        {**can, "fill": "toself", "fillcolor": FILL, "hoverinfo": "skip"},
        line(across, up, "holds, audited", palette.SERIES[1], 2, dash="dash"),
    ]
    if section.weakest is not None:
        (x,), (y,) = (section.radius * section.weakest[:, None]).round(4).tolist()
        data.append(
            markers([x], [y], "weakest direction", palette.SERIES[1], ["weakest direction"], "%{text}", size=9)
        )
    layout = axes(*(f"{axis} [{section.unit}]" for axis in section.plane), legend=-0.2)
    layout["xaxis"] |= {"range": [-reach, reach], "constrain": "domain"}
    layout["yaxis"] |= {"range": [-reach, reach], "scaleanchor": "x", "constrain": "domain"}
    return {"data": data, "layout": layout}
