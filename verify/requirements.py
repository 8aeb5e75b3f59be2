"""Every geometric requirement of a design, as pairs of bodies.

Lengths are in l_arm and positions relative to the mean of the module centres, so that scenes are centred and
tolerances mean the same on every scale. A least distance d of two points is the requirement that balls of radius
d / 2 around them keep apart; so is the end-effector's from every module's centre.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import combinations

import numpy as np

from topo_search.model import Allowed, Design, Directional, Exterior, Mount
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.exposure import Exposure
from topo_search.model.module import AirflowEnvelope
from verify.bodies import Array, Cone, ConeSphere, ball
from verify.certificate import ClearanceRow, Solid
from verify.compounds import Compound
from verify.hulls import Hull, hull
from verify.kinematics import Platform, platform
from verify.meshes import LARGEST_COORDINATE
from verify.parts import StraightRod, module_body


class Requirement(ClearanceRow[Solid, Solid | Cone | Hull]):
    """An airflow envelope, a ball, a bracket or a rod beside a volume, or in a cone."""


class Scene:
    """A design with its volumes: airflow, rigid parts, rods, target regions."""

    def __init__(self, design: Design, placed: Platform | None = None) -> None:
        self.design = design
        self.platform = platform(design) if placed is None else placed
        self.R: Array = self.platform.poses.R
        self.l_arm = design.task.module.arm_length
        middle = self.platform.o.mean(axis=0)
        self.centres: Array = (self.platform.o - middle) / self.l_arm
        self.p_E: Array = (self.platform.p_e - middle) / self.l_arm
        self.offset: Array = self.platform.p_e / self.l_arm
        """p_E from the COM, where some requirements take their direction from."""

    @cached_property
    def envelopes(self) -> list[Solid]:
        """The airflow of all modules."""
        return self._place(self.design.task.module.envelope)

    @cached_property
    def region_envelopes(self) -> list[Solid]:
        """Those that keep out of target regions."""
        return self._place(self.design.task.module.region_envelope)

    def _place(self, envelope: AirflowEnvelope) -> list[Solid]:
        length, r, dr = (x / self.l_arm for x in (envelope.length, envelope.start_radius, envelope.growth))
        still = Solid(ConeSphere(np.zeros(3), np.array([0.0, 0.0, -length]), r, dr))
        return [still.place(R, o) for R, o in zip(self.R, self.centres, strict=True)]

    @cached_property
    def body(self) -> Compound:
        """The rigid parts of a module in its own frame."""
        return module_body(self.design.task.module)

    @cached_property
    def modules(self) -> tuple[Compound, ...]:
        """The rigid parts of all modules."""
        return tuple(self.body.place(R, o) for R, o in zip(self.R, self.centres, strict=True))

    @property
    def in_range(self) -> bool:
        """True if all coordinates keep the digits that a proof needs."""
        return all(module.in_range for module in self.modules) and bool(
            np.all(np.abs(self.p_E) < LARGEST_COORDINATE / 16)
        )

    def straight_rod(self, mount: Mount) -> StraightRod:
        """Return the rod from a free connector."""
        module = self.design.task.module
        l_c, radius = module.connector_distance / self.l_arm, self.design.task.end_effector.rod_radius / self.l_arm
        start = self.centres[mount.module] + l_c * self.R[mount.module] @ PORT_DIRECTIONS[mount.port]
        return StraightRod(mount, start, self.p_E - start, radius)

    def requirements(self) -> Iterator[Requirement]:
        """Yield every requirement: airflow, exposure, exclusion, separation."""
        task, pairs = self.design.task, list(combinations(range(len(self.centres)), 2))
        kind = task.search.interference
        for a, b in pairs if kind != "parts" else ():
            yield Requirement("airflow", a, b, self.envelopes[a], self.envelopes[b], counts=kind == "airflow")
        for number, exposure in enumerate(task.exposure):
            for segment, region in self.regions(exposure) if exposure.geometry else ():
                for a, envelope in enumerate(self.region_envelopes):
                    yield Requirement(exposure.kind, a, number, envelope, region, segment)
        if (distance := task.exclusion_radius) is not None:
            *around, tip = _balls([*self.centres, self.p_E], distance / self.l_arm / 2)
            for a, ball in enumerate(around):
                yield Requirement("exclusion", a, -1, ball, tip)
        ablation = kind == "separation"
        distance = task.separation if ablation else task.body_clearance
        if distance is not None:
            exempt = frozenset() if ablation else self.design.topology.bolted
            balls = _balls(self.centres, distance / self.l_arm / 2)
            for a, b in pairs:
                if (a, b) not in exempt:
                    yield Requirement("separation", a, b, balls[a], balls[b])

    def counterpart(self, other: Requirement) -> Requirement:
        """Return the same requirement as one of another platform of the same task and tree."""
        if other.kind == "airflow":  # of a hundred modules there are thousands
            return Requirement("airflow", other.a, other.b, self.envelopes[other.a], self.envelopes[other.b])
        key = other.kind, other.a, other.b, other.segment
        return next(r for r in self.requirements() if (r.kind, r.a, r.b, r.segment) == key)

    def regions(self, exposure: Exposure) -> Iterator[tuple[int | None, Solid | Cone | Hull]]:
        """Yield the volumes of a requirement, with the numbers of its paths or planes; of cones what is allowed."""
        if isinstance(exposure, Exterior):
            yield from ((None, cone) for cone in self._cones(exposure))
        elif isinstance(exposure, Directional):
            yield from enumerate(self._capsules(exposure))
        elif isinstance(exposure, Allowed):
            yield from enumerate(self._half_spaces(exposure))
        elif exposure.radius is not None:
            yield None, Solid(ball(self.p_E, exposure.radius / self.l_arm))
        else:
            for piece, points in enumerate(exposure.polytopes):
                region = hull(points / self.l_arm).move(self.p_E)  # far away corners lose their digits
                yield None if exposure.pieces is None else piece, region

    def _capsules(self, exposure: Directional) -> list[Solid]:
        r = exposure.radius / self.l_arm
        here, paths = np.zeros(3), list[tuple[Array, Array]]()
        if exposure.segments is not None:
            paths = [(here, np.array(segment) / self.l_arm) for segment in exposure.segments]
        elif exposure.polylines is not None:
            for points in exposure.polylines:
                at = np.array(points) / self.l_arm
                paths += [(at[k], at[k + 1] - at[k]) for k in range(len(at) - 1)]
        elif exposure.length is not None and (outwards := self._outward_direction()) is not None:
            paths = [(here, exposure.length / self.l_arm * outwards)]
        return [Solid(ConeSphere(self.p_E + start, path, r, 0.0)) for start, path in paths]

    def _half_spaces(self, exposure: Allowed) -> Iterator[Cone]:
        """Yield every half-space that is allowed: a cone of 90 degrees with its apex on the plane."""
        for plane in exposure.planes:
            out = _unit(np.array(plane.normal))
            yield Cone(self.p_E + plane.offset / self.l_arm * out, -out, 90.0)

    def _cones(self, exposure: Exterior) -> list[Cone]:
        """Return the cone, unless it has no axis."""
        if exposure.axis == "com":
            outwards = self._outward_direction()
            axis = None if outwards is None else -outwards
        else:
            axis = _unit(np.array(exposure.axis))
        return [] if axis is None else [Cone(self.p_E, axis, exposure.half_angle_deg)]

    def rod(self, mount: Mount | None) -> Iterator[Requirement]:
        """Yield the rod from a mount against every airflow, if there is a rod; counted if the task asks for one."""
        if mount is None or not self.in_range:
            return
        body = self.straight_rod(mount).solid
        counts = self.design.task.end_effector.rod == "straight"
        for b, envelope in enumerate(self.envelopes):
            yield Requirement("rod-airflow", mount.module, b, body, envelope, counts=counts)

    def _outward_direction(self) -> Array | None:
        """Return p_E / ||p_E||; None where it has no direction, which the residuals report as a violation."""
        return _unit(self.offset) if np.abs(self.offset).max() > 1e-12 else None


def _balls(centres: Sequence[Array] | Array, radius: float) -> list[Solid]:
    """Return equal balls: copies of one."""
    still, R = Solid(ball(np.zeros(3), radius)), np.eye(3)
    return [still.place(R, centre) for centre in centres]


def _unit(v: Array) -> Array:
    v = v / np.abs(v).max()  # first, so that squares neither overflow nor vanish
    return np.asarray(v / np.linalg.norm(v))
