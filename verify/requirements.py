"""The geometric requirements on envelopes and centres of a design, as pairs of bodies.

Lengths are in the l_arm of `[module]` and positions relative to the mean of the module centres, so scenes are
centred and tolerances mean the same at every scale. A minimum distance d of two points, such as module centres or
the end-effector, is the requirement that balls of radius d / 2 around them keep apart.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np

from topo_search.model import PORT_DIRECTIONS, AirflowEnvelope, Array, Design, Mount
from topo_search.model.exposure import Allowed, Directional, Exposure, Exterior
from verify.bodies import AllowedCone, ConeSphere, ball
from verify.certificate import ClearanceCheck, RoundBody
from verify.compounds import Compound
from verify.hulls import HullBody, hull
from verify.kinematics import Platform, platform
from verify.meshes import LARGEST_COORDINATE
from verify.parts import StraightRod, module_body


class ClearanceRequirement(ClearanceCheck[RoundBody, RoundBody | AllowedCone | HullBody]):
    """A cone-sphere (airflow envelope, ball or rod) that must keep clear of a volume or stay inside a cone."""


class PlacedAir(NamedTuple):
    """Airflow envelope of a module of a design, or of one of its rotors."""

    module: int
    rotor: int | None
    body: RoundBody


class Scene:
    """The volumes of a design: airflow, rigid parts, rods, target regions."""

    def __init__(self, design: Design, placed: Platform | None = None) -> None:
        self.design = design
        self.platform = platform(design) if placed is None else placed
        self.R: Array = self.platform.poses.R
        self.l_arm = design.task.module.arm_length
        middle = self.platform.o.mean(axis=0)
        self.centres: Array = (self.platform.o - middle) / self.l_arm
        self.tip: Array = (self.platform.p_e - middle) / self.l_arm
        """End-effector from the mean of the module centres, as all positions here."""
        self.offset: Array = self.platform.p_e / self.l_arm
        """End-effector from the COM; some requirements take their direction from it."""

    @cached_property
    def envelopes(self) -> list[PlacedAir]:
        """Airflow envelopes of all modules, module by module."""
        return self._place([module.envelopes for module in self.design.task.modules_of_nodes])

    @cached_property
    def region_envelopes(self) -> list[PlacedAir]:
        """Airflow envelopes used against target regions."""
        return self._place([module.region_envelopes for module in self.design.task.modules_of_nodes])

    def _place(self, envelopes: Sequence[tuple[AirflowEnvelope, ...]]) -> list[PlacedAir]:
        bodies = dict[AirflowEnvelope, RoundBody]()  # shared, as are their meshes
        for envelope in chain(*envelopes):
            length, r, dr = (x / self.l_arm for x in (envelope.length, envelope.start_radius, envelope.growth))
            start, path = np.array(envelope.origin) / self.l_arm, -length * np.array(envelope.upstream)
            bodies.setdefault(envelope, RoundBody(ConeSphere(start, path + 0.0, r, dr)))
        return [
            PlacedAir(i, None if len(of_module) == 1 else q, bodies[envelope].place(R, o))
            for i, (R, o, of_module) in enumerate(zip(self.R, self.centres, envelopes, strict=True))
            for q, envelope in enumerate(of_module)
        ]

    @cached_property
    def bodies(self) -> tuple[Compound, ...]:
        """Rigid parts of each module in its own frame."""
        return tuple(module_body(module, self.l_arm) for module in self.design.task.modules_of_nodes)

    @cached_property
    def modules(self) -> tuple[Compound, ...]:
        """Rigid parts of each module."""
        poses = zip(self.bodies, self.R, self.centres, strict=True)
        return tuple(body.place(R, o) for body, R, o in poses)

    @property
    def in_range(self) -> bool:
        """True if all coordinates are precise enough for a proof."""
        is_tip_near = bool(np.all(np.abs(self.tip) < LARGEST_COORDINATE / 16))
        return is_tip_near and all(module.in_range for module in self.modules)

    def straight_rod(self, mount: Mount) -> StraightRod:
        """Return the rod from a free connector."""
        task = self.design.task
        l_c, radius = (
            x / self.l_arm for x in (task.connector_distances[mount.module], task.end_effector.rod_radius)
        )
        start = self.centres[mount.module] + l_c * self.R[mount.module] @ PORT_DIRECTIONS[mount.port]
        return StraightRod(mount, start, self.tip - start, radius)

    def requirements(self) -> Iterator[ClearanceRequirement]:
        """Yield the requirements: airflow, exposure, exclusion, separation."""
        task, pairs = self.design.task, list(combinations(range(len(self.centres)), 2))
        kind = task.search.interference
        for first, second in combinations(self.envelopes, 2) if kind != "parts" else ():
            if first.module != second.module:
                yield self.airflows_apart(first, second)
        for number, exposure in enumerate(task.exposure):
            for segment, region in self.regions(exposure) if exposure.geometry else ():
                for a, rotor, envelope in self.region_envelopes:
                    yield ClearanceRequirement(exposure.kind, a, number, envelope, region, segment, rotor=rotor)
        if (distance := task.exclusion_radius) is not None:
            *balls, tip = _balls([*self.centres, self.tip], distance / self.l_arm / 2)
            for a, ball in enumerate(balls):
                yield ClearanceRequirement("exclusion", a, -1, ball, tip)
        ablation = kind == "separation"
        distance = task.separation if ablation else task.body_clearance
        if distance is not None:
            exempt = frozenset() if ablation else self.design.topology.bolted
            balls = _balls(self.centres, distance / self.l_arm / 2)
            for a, b in pairs:
                if (a, b) not in exempt:
                    yield ClearanceRequirement("separation", a, b, balls[a], balls[b])

    def regions(self, exposure: Exposure) -> Iterator[tuple[int | None, RoundBody | AllowedCone | HullBody]]:
        """Yield the volumes of a requirement with their path or plane numbers; a cone is the allowed side."""
        if isinstance(exposure, Exterior):
            outwards = self._outward_direction() if exposure.axis == "com" else -_unit(np.array(exposure.axis))
            if outwards is not None:
                yield None, AllowedCone(self.tip, -outwards, exposure.half_angle_deg)
        elif isinstance(exposure, Directional):
            yield from enumerate(self._capsules(exposure))
        elif isinstance(exposure, Allowed):
            for number, (outwards, offset) in enumerate(half_spaces(exposure)):
                yield number, AllowedCone(self.tip + offset / self.l_arm * outwards, -outwards, 90.0)
        elif exposure.radius is not None:
            yield None, RoundBody(ball(self.tip, exposure.radius / self.l_arm))
        else:
            for piece, points in enumerate(exposure.polytopes):
                region = hull(points / self.l_arm).move(self.tip)  # hull first: coordinates far away lose digits
                yield None if exposure.pieces is None else piece, region

    def _capsules(self, exposure: Directional) -> list[RoundBody]:
        r = exposure.radius / self.l_arm
        origin, paths = np.zeros(3), list[tuple[Array, Array]]()
        if exposure.segments is not None:
            paths = [(origin, np.array(segment) / self.l_arm) for segment in exposure.segments]
        elif exposure.polylines is not None:
            for polyline in exposure.polylines:
                points = np.array(polyline) / self.l_arm
                paths += [(points[k], points[k + 1] - points[k]) for k in range(len(points) - 1)]
        elif exposure.length is not None and (outwards := self._outward_direction()) is not None:
            paths = [(origin, exposure.length / self.l_arm * outwards)]
        return [RoundBody(ConeSphere(self.tip + start, path, r, 0.0)) for start, path in paths]

    def rod(self, mount: Mount | None) -> Iterator[ClearanceRequirement]:
        """Yield the rod from a mount against every airflow envelope; counts if the task requires a straight rod."""
        if mount is None or not self.in_range:
            return
        body = self.straight_rod(mount).round_body
        counts = self.design.task.end_effector.rod == "straight"
        for b, rotor, air in self.envelopes:
            yield ClearanceRequirement("rod-airflow", mount.module, b, body, air, counts=counts, rotor=rotor)

    def airflows_apart(self, first: PlacedAir, second: PlacedAir) -> ClearanceRequirement:
        """Return the requirement that two envelopes do not overlap."""
        counts, (a, A), (b, B) = self.design.task.search.interference == "airflow", first[::2], second[::2]
        return ClearanceRequirement("airflow", a, b, A, B, first.rotor, counts, rotor=second.rotor)

    def _outward_direction(self) -> Array | None:
        """Return p_E / ||p_E||; None if p_E is almost zero, which the residuals report as a violation."""
        return _unit(self.offset) if np.abs(self.offset).max() > 1e-12 else None


def half_spaces(exposure: Exposure) -> list[tuple[Array, float]]:
    """Return the half-spaces of fixed direction that must hold all airflow: unit normals and distances [m]."""
    if isinstance(exposure, Allowed):
        planes = ((np.array(plane.normal), plane.offset) for plane in exposure.planes)
        return [(_unit(normal), offset / math.hypot(*normal)) for normal, offset in planes]
    if isinstance(exposure, Exterior) and exposure.half_angle_deg == 90 and exposure.axis != "com":
        return [(-_unit(np.array(exposure.axis)), 0.0)]
    return []


def _balls(centres: Sequence[Array] | Array, radius: float) -> list[RoundBody]:
    body, R = RoundBody(ball(np.zeros(3), radius)), np.eye(3)
    return [body.place(R, centre) for centre in centres]


def _unit(v: Array) -> Array:
    v = v / np.abs(v).max()  # squares then neither overflow nor underflow
    return np.asarray(v / np.linalg.norm(v))
