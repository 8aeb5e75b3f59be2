r"""The module with its brackets, and the end-effector with its rod.

The module: its mass, rotors, connectors, airflow envelope and real body.

| symbol | field | unit |
|---|---|---|
| m | mass | kg |
| l_arm | arm_length | m |
| l_c | connector_distance | m |
| k_f | thrust_coefficient | N s^2 |
| k_tau | torque_coefficient | N m s^2 |
| u_max | max_thrust_to_weight m g / (4 k_f), or max_thrust / k_f | rad^2/s^2 |
| r_air | airflow.start_radius | m |
| theta_air | airflow.spread_angle_deg | deg |
| l_air, dr_air | length of the envelope's axis, growth of its radius | m |

Defaults are this project's choice; k_f is from arXiv 2602.18344. The k_tau reported there, 1.06e-8, which the
paper's tasks use, gives rotors of 50 mm radius a figure of merit of 0.165; the default gives 0.566.

A rotor of radius R at rest in air of density rho, at the angular speed omega:

| symbol | meaning | unit |
|---|---|---|
| T, Q | thrust k_f omega^2 and drag torque k_tau omega^2 | N, N m |
| P | shaft power Q omega | W |
| FM | figure of merit: power of an ideal rotor of the same thrust over P | |
| C_T | thrust coefficient of propellers, T / (rho (omega / 2 pi)^2 (2 R)^4) | |

By momentum theory an ideal rotor needs the power T^1.5 / sqrt(2 rho pi R^2), so that

.. math:: FM = \frac{k_f^{1.5}}{k_\tau \sqrt{2 \rho \pi R^2}}, \qquad C_T = \frac{(2 \pi)^2 k_f}{\rho (2 R)^4}

(Leishman, *Principles of Helicopter Aerodynamics*, 2.8): no rotor has a figure of merit above 1.

The bracket that holds two modules at a hinge angle, as printed by the lab kit; the search ignores it.

| symbol | meaning | unit |
|---|---|---|
| c | connector, l_c from both modules' centres: centre of the bracket | |
| r | half width of a flange: bolt_circle / 2 + bolt_diameter / 2 + wall | m |
| d | distance of the flanges' outer faces from c: r + thickness + wall | m |

Two flanges at the distance d from c, one on either side and turned about c by up to 90 deg, stay farther apart than
a wall thickness. So all mating faces of the modules are the same, at l_c - d from their centres.

The end-effector: its mass, its position and the rod that carries it.

| symbol | meaning | unit |
|---|---|---|
| m_E | mass | kg |
| p_E | position from the platform COM | m |
| L | length of the rod, a tube clamped at its connector | m |
| E | elastic modulus of the rod | Pa |
| r, A, I | radius, area and second moment of area of its section | m, m^2, m^4 |
| F, M | largest force and torque at its tip, both across it | N, N m |
| w | weight per length | N/m |

The deflection of the tip of such a cantilever is

.. math:: \delta(L) = \frac{F L^3}{3 E I} + \frac{M L^2}{2 E I} + \frac{w L^4}{8 E I}, \qquad
   I = \tfrac{\pi}{4} (r^4 - r_i^4) = \tfrac{A}{4} (2 r^2 - A / \pi)

(Gere and Timoshenko, *Mechanics of Materials*, table of deflections of cantilever beams).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator

from topo_search.limits import LIMITS
from topo_search.model.mesh_file import ConvexPiece, frame_of, mesh_schema, take_mesh
from topo_search.model.value import (
    Broken,
    Flag,
    Index,
    Location,
    NonEmpty,
    NonNegative,
    Number,
    Omitted,
    OneOf,
    Positive,
    PositiveVector,
    Value,
    Vector,
    at_most,
    omit_if,
    refuse,
)

TIP = 2.0
"""Length of a rod's tip [rod radii]."""
INWARDS = 0.2
"""Depth behind the connector's plane to which bolted frames may touch [l_c]: 30 mm for the default module.

A frame as high as the default hub at its connector needs 20 mm when folded by 90 degrees.
"""
OUTWARDS = 0.05
"""The same in front of that plane [l_c]: room for a fitting, 7.5 mm for the default module."""

Position = Annotated[Literal["free"] | Literal["com"] | Vector, OneOf('must be "free", "com" or [x, y, z]')]
Reach = Annotated[Positive | Literal[False], OneOf("must be a length in metres or false")]


class Mount(Value):
    """Connector from which a straight rod carries the end-effector."""

    module: Index
    port: Annotated[int, Field(strict=True, ge=0, le=3)]
    """0..3 for +x, +y, -x, -y."""

    @property
    def words(self) -> str:
        """Name of the connector."""
        return f"port {self.port} of module {self.module}"


class CountedRod(Mount):
    """Rod of a design whose weight counts in the load cases, and its connector."""

    mass: NonNegative
    """Mass of the rod [kg]."""


class EndEffector(Value):
    """Rigid end-effector."""

    mass: NonNegative = 0.048
    """m_E [kg]."""
    position: Position = "free"
    """`free`: optimised; `com`: at the centre of mass; [x, y, z]: fixed, from the COM [m]."""
    exclusion: Flag = True
    """True if p_E must be at least connector_distance from every module's centre."""
    stand_off: Annotated[NonNegative, omit_if(0.0)] = 0.0
    """Minimum distance of p_E from every module's centre, if larger than the exclusion [m]."""
    rod: Literal["none", "straight"] = "straight"
    """`straight`: requires a straight rod, clear of all parts and airflow; `none`: a missing rod is reported."""
    largest_reach: Reach | None = None
    """Largest distance of p_E from its rod's connector [m]; false: any. Default: the length at which the rod bends
    by rod_deflection, or four times the width of the modules packed in a square if that is less; only the latter
    for a fixed position."""
    rod_radius: Positive = 0.005
    """Radius of the rod that carries the end-effector [m]."""
    rod_linear_density: NonNegative = 0.045
    """Mass of the rod per metre [kg/m]; default: a carbon-fibre tube (1,600 kg/m^3) with a 1 mm wall."""
    rod_mass: Annotated[Literal["included", "ignored"], omit_if("ignored")] = "ignored"
    """`included`: the rod's mass counts in weight, centre of mass and inertia; `ignored`: it is massless."""
    counted_rod: Omitted[CountedRod] = None
    """Rod whose mass counts. Set in designs, not in tasks."""
    rod_modulus: Annotated[Positive, omit_if(70e9)] = 70e9
    """Elastic modulus of the rod in its axial direction [Pa]; default: a carbon-fibre tube."""
    rod_deflection: Annotated[Positive, omit_if(0.005)] = 0.005
    """Deflection of the rod's tip under the task's largest load and the rod's weight [m], which limits the
    default of largest_reach."""

    def _broken_rules(self) -> Broken:
        if self.rod_mass == "included" and (self.rod == "none" or self.largest_reach is False):
            actual = 'rod = "none"' if self.rod == "none" else "largest_reach = false"
            yield "rod_mass", f'must be "ignored" with {actual}, but got "included"'
        if self.rod_mass == "ignored" and self.counted_rod is not None:
            yield "counted_rod", 'must be left out with rod_mass = "ignored"'

    def stiff_length(self, force: float, torque: float, gravity: float) -> float:
        """Return the length at which the rod bends by `rod_deflection` [m]; infinite for a rod without stiffness.

        Args:
            force: largest force at the tip besides the end-effector's weight [N].
            torque: largest torque at the tip [N m].
            gravity: g [m/s^2].
        """
        laminate = 1600.0  # density of a carbon-fibre tube [kg/m^3]; with the mass per metre it gives the wall
        area = min(self.rod_linear_density / laminate, math.pi * self.rod_radius**2)
        stiffness = self.rod_modulus * area / 4 * (2 * self.rod_radius**2 - area / math.pi)
        if stiffness == 0.0:
            return math.inf
        # the length is less than those for force, torque and own weight alone
        loads = (torque / 2, 2), ((force + self.mass * gravity) / 3, 3), (self.rod_linear_density * gravity / 8, 4)
        shortest, length = 0.0, math.inf
        for amount, power in loads:
            if amount > 0.0:
                length = min(length, (self.rod_deflection * stiffness / amount) ** (1 / power))
        for _ in range(50):  # bisections, to machine precision
            middle = (shortest + length) / 2
            deflection = sum(amount * middle**power for amount, power in loads) / stiffness
            shortest, length = (middle, length) if deflection <= self.rod_deflection else (shortest, middle)
        return length

    @property
    def fixed_position(self) -> Vector | None:
        """p_E [m] if the task fixes it."""
        if self.position == "free":
            return None
        return (0.0, 0.0, 0.0) if self.position == "com" else self.position


class ResolvedEndEffector(EndEffector):
    """End-effector of a design: fields that an older file lacks are not required."""

    rod: Literal["none", "straight"] = "none"
    """`straight`: a design needs a straight rod, clear of all parts and airflow; `none`: a missing
    rod is reported, not required."""
    largest_reach: Reach = False
    """Largest distance of p_E from the connector of its rod [m]; or false."""


class Bracket(Value):
    """Bracket: two square flanges with four bolts each, connected by two webs."""

    bolt_circle: Positive = 0.024
    """Diameter of the bolt circle of a flange [m]; four bolts, at 45 deg to the hinge axis."""
    bolt_diameter: Positive = 0.0032
    """Diameter of the bolt holes [m]; default: for M3."""
    thickness: Positive = 0.004
    """Thickness of a flange [m]."""
    wall: Positive = 0.003
    """Wall thickness of the webs, and around bolts and rod [m]."""

    def _broken_rules(self) -> Broken:
        if self.bolt_circle / math.sqrt(2) <= 2 * self.bolt_diameter:
            actual = f"bolt_circle = {self.bolt_circle}, bolt_diameter = {self.bolt_diameter}"
            rule = "`bolt_circle > 2 sqrt(2) bolt_diameter` must hold, so that bolts leave room for each other"
            yield "bolt_circle", f"{rule}, but got {actual}"

    @property
    def half_width(self) -> float:
        """r: half-width of a flange [m]."""
        return (self.bolt_circle + self.bolt_diameter) / 2 + self.wall

    @property
    def set_back(self) -> float:
        """d: distance of the flanges' outer faces from the connector [m]."""
        return self.half_width + self.thickness + self.wall


AIR_DENSITY = 1.2
"""rho [kg/m^3]."""
PRECISION = 1e-3
"""Relative difference up to which two values of one quantity agree: the precision of a data sheet."""


class Jet(Value):
    """Constants of the jet far below a module, in units of the distance of opposite rotors.

    At the depth s the speed on the axis is `decay` U_H / (s + `origin`), and half of that at the distance
    `half_width` (s + `origin`) from the axis; U_H is the induced speed of the discs. Defaults: arXiv 2403.13321.
    """

    decay: Positive = 10.11
    """Speed on the axis times the distance from the virtual origin, over U_H."""
    origin: Positive = 5.817
    """Height of the virtual origin above the rotors."""
    half_width: Positive = 0.0767
    """Growth rate of the radius at which the speed is half of that on the axis."""


class RegionAirflow(Value):
    """Airflow envelope of a module for target regions; default lengths scale with the module."""

    start_radius: Positive | None = None
    """Radius at the module's centre [m]; default: arm_length + rotor_radius, which encloses all slipstreams."""
    spread_angle_deg: Annotated[float, Field(strict=True, ge=0, le=90)] = 10.0
    """Full spreading angle [deg]."""
    reach: Positive | None = None
    """Distance from the module's centre to the far end [m]; default: same as between modules."""


Thrust = Annotated[
    Literal["hover", "full"] | Positive, OneOf('must be "hover", "full" or a thrust over the weight')
]


class Airflow(Value):
    """Airflow envelope of a module in a task file; default lengths scale with the arm."""

    start_radius: Positive | None = None
    """r_air: radius at the module's centre [m]; default: arm_length."""
    spread_angle_deg: Annotated[float, Field(strict=True, ge=0, le=90)] = 10.0
    """theta_air: full spreading angle of the jet [deg]."""
    reach: Positive | None = None
    """Distance from the module's centre to the far end of the envelope [m]; default: 20 arm_length / sqrt(2)."""
    jet: Annotated[Jet, omit_if(Jet())] = Jet()
    """Jet model for the air speeds of the audit; omitted from files where it has its defaults."""
    regions: Annotated[Omitted[RegionAirflow], BeforeValidator(lambda x: None if x is False else x)] = None
    """Envelope for target regions; without this table, or if false: same as between modules."""
    speed: Omitted[Positive] = None
    """Instead of `regions`: their envelope is the smallest cone-sphere around all air of a module at this speed or
    more [m/s]."""
    at: Annotated[Thrust, omit_if("hover")] = "hover"
    """Thrust of the module for `speed`: `hover`, `full`, or a thrust over the module's weight."""

    def _broken_rules(self) -> Broken:
        if self.speed is not None and self.regions is not None:
            yield "speed", "must be left out if `regions` is given"


class Body(Value):
    """Rigid parts of a module: hub and arms as boxes, rotor discs as cylinders."""

    model_config = ConfigDict(json_schema_extra=mesh_schema)

    rotor_radius: Positive = 0.05
    """Radius of a rotor disc [m]."""
    rotor_height: Positive = 0.02
    """Height of a rotor disc [m]."""
    arm_width: Positive = 0.02
    """Width and height of an arm [m]."""
    hub: PositiveVector = (0.08, 0.08, 0.04)
    """Edges of the hub along x, y, z [m]."""
    frame: Omitted[Annotated[tuple[ConvexPiece, ...], at_most(LIMITS.frame_pieces, "pieces"), NonEmpty]] = None
    """Convex pieces that replace hub and arms; a task file may name a `mesh` instead."""
    frame_excess: Annotated[NonNegative, omit_if(0.0)] = 0.0
    """Upper bound for the excess of the pieces over their source mesh [m]."""
    inertia: PositiveVector | None = None
    """Ixx, Iyy, Izz about the module's centre [kg m^2]; default: from the shapes at uniform density."""

    @model_validator(mode="before")
    @classmethod
    def _frame_of_a_mesh(cls, data: Any, info: ValidationInfo) -> Any:
        """Fill in the pieces of a mesh."""
        if not isinstance(data, dict):
            return data
        frame, data = data.get("frame"), dict(data)
        mesh = take_mesh(data, "frame", info.context, frame_of)
        if mesh is None:
            return data
        if frame is not None:
            refuse(("mesh", "must be left out if `frame` is given"))
        pieces, excess = mesh
        return {**data, "frame": pieces, "frame_excess": excess}

    def _broken_rules(self) -> Broken:
        if (triangles := sum(len(piece.triangles) for piece in self.frame or ())) > LIMITS.frame_triangles:
            yield "frame", f"must have at most {LIMITS.frame_triangles:,} triangles in all, but got {triangles:,}"
        if self.frame is not None and self.inertia is None:
            yield "inertia", "must be given with a custom `frame` or `mesh`, but is missing"
        if self.inertia is not None and 2 * max(self.inertia) > sum(self.inertia) * (1 + 1e-12):
            yield "inertia", f"no moment may exceed the sum of the other two, but got {list(self.inertia)}"


class AirflowEnvelope(Value):
    """Cone-sphere of a module: union of balls centred on a segment, with linearly growing radius."""

    length: Number
    """l_air: length of the axis, from the module's centre along -z [m]."""
    start_radius: Positive
    """r_air: radius at the module's centre [m]."""
    growth: Number
    """dr_air: growth of the radius along the axis [m]."""

    @classmethod
    def of(cls, start_radius: float, spread_angle_deg: float, reach: float) -> AirflowEnvelope:
        """Return the cone-sphere that ends at the distance `reach` from the module's centre; lengths in m."""
        growth_rate = math.tan(math.radians(spread_angle_deg) / 2)
        length = (reach - start_radius) / (1 + growth_rate)
        return cls(length=length, start_radius=start_radius, growth=length * growth_rate)

    @property
    def end_radius(self) -> float:
        """Radius of the far ball [m]."""
        return self.start_radius + self.growth


class FilledAirflow(NamedTuple):
    """Envelope in terms of the fields of files, with all lengths filled in [m]."""

    start_radius: float
    spread_angle_deg: float
    reach: float


class Module(Value):
    """Quadrotor module with four connectors."""

    mass: Positive = 0.24
    """m [kg]."""
    arm_length: Positive = 0.10
    """l_arm: distance from the module's centre to a rotor [m]."""
    connector_distance: Positive = 0.15
    """l_c: distance from the module's centre to a connector, and minimum radius of the exclusion of p_E [m]."""
    thrust_coefficient: Positive = 3.87e-7
    """k_f: thrust of a rotor over its squared speed [N s^2]."""
    torque_coefficient: Positive = 3.1e-9
    """k_tau: drag torque of a rotor over its squared speed [N m s^2]."""
    max_thrust_to_weight: Positive = 2.5
    """Largest thrust of a module over its own weight."""
    max_thrust: Omitted[Positive] = None
    """Largest thrust of a rotor [N]; replaces max_thrust_to_weight."""
    torque_to_thrust: Omitted[Positive] = None
    """Drag torque of a rotor over its thrust [m]; replaces torque_coefficient."""
    joint_moment: Omitted[Positive] = None
    """Rated moment of a joint [N m]."""
    joint_force: Omitted[Positive] = None
    """Rated force of a joint [N]."""
    joint_mass: Annotated[NonNegative, omit_if(0.0)] = 0.0
    """Mass of a joint (bracket, struts and bolts), located at its connector [kg]."""
    min_input: Annotated[float, Field(strict=True, ge=0, lt=1, exclude_if=lambda given: given == 0.0)] = 0.0
    """Minimum squared speed of a running rotor, as a share of the maximum; a failed rotor is exempt."""
    wake_loss: Annotated[NonNegative, omit_if(0.37)] = 0.37
    """Share of a rotor's thrust lost to a wake as fast as its own induced speed; default: blade-element theory."""
    battery_Wh: Omitted[Positive] = None
    """Energy of a module's battery [Wh], from which the audit bounds the endurance."""
    airflow: Airflow = Airflow()
    """Airflow envelope."""
    body: Body = Body()
    """Rigid parts."""
    bracket: Omitted[Bracket] = None
    """Hinge brackets of the lab kit; if given, the audit checks them against airflow and rotors."""

    @model_validator(mode="before")
    @classmethod
    def _torque_by_thrust(cls, data: Any) -> Any:
        """Fill in the torque coefficient from `torque_to_thrust`."""
        if not isinstance(data, dict) or data.get("torque_coefficient") is not None:
            return data
        k_f = data.get("thrust_coefficient", cls.model_fields["thrust_coefficient"].default)
        factors = data.get("torque_to_thrust"), k_f
        # other values are refused by their own fields
        valid = all(isinstance(x, int | float) and not isinstance(x, bool) and 1e-15 <= x <= 1e15 for x in factors)
        return {**data, "torque_coefficient": factors[0] * factors[1]} if valid else data

    def _broken_rules(self) -> Broken:
        ratio, due = self.torque_to_thrust, self.torque_coefficient / self.thrust_coefficient
        if ratio is not None and not math.isclose(ratio, due, rel_tol=PRECISION):
            rule = f"must agree with torque_coefficient / thrust_coefficient, {due:.4g} m"
            yield "torque_to_thrust", f"{rule}, but got {ratio}: leave one of them out"
        for field, envelope in ((("airflow",), self), (("airflow", "regions"), self.region_airflow)):
            if envelope is not None and envelope.reach <= envelope.start_radius:
                lengths = f"reach = {envelope.reach}, start_radius = {envelope.start_radius}"
                yield field, f"`reach > start_radius` must hold, but got {lengths}"
        # beyond this range parts cannot be built, and contact cannot be decided
        least, largest = 1e-4, 100.0  # [l_arm]
        low, high = least * self.arm_length, largest * self.arm_length
        body = self.body
        sizes: list[tuple[Location, float]] = [
            *((("body", name), getattr(body, name)) for name in ("rotor_radius", "rotor_height", "arm_width")),
            *((("body", "hub", k), edge) for k, edge in enumerate(body.hub)),
        ]
        rule = f"must be between {low:g} and {high:g}, {least:g} and {largest:g} arm lengths"
        yield from ((field, f"{rule}, but got {size}") for field, size in sizes if not low <= size <= high)

    @property
    def start_radius(self) -> float:
        """r_air: radius of the envelope at the module's centre [m]."""
        return self.airflow.start_radius or self.arm_length

    @property
    def reach(self) -> float:
        """Distance from the module's centre to the far end of its envelope [m].

        The paper's 20 l_arm / sqrt(2) is taken as the end of the volume, including the far ball. Taken as the
        length of the axis, the reach would be r_air + 20 l_arm / sqrt(2) (1 + tan(theta_air / 2)), 1.638 m.
        """
        return self.airflow.reach or 20 * self.arm_length / math.sqrt(2)

    @property
    def envelope(self) -> AirflowEnvelope:
        """Airflow envelope: l_air + r_air + dr_air = reach."""
        return AirflowEnvelope.of(self.start_radius, self.airflow.spread_angle_deg, self.reach)

    @property
    def region_airflow(self) -> FilledAirflow | None:
        """`airflow.regions` with all lengths filled in; None if it is not given."""
        regions = self.airflow.regions
        if regions is None:
            return None
        start = regions.start_radius or self.arm_length + self.body.rotor_radius
        return FilledAirflow(start, regions.spread_angle_deg, regions.reach or self.reach)

    @property
    def region_envelope(self) -> AirflowEnvelope:
        """Airflow envelope that stays out of target regions.

        Raises:
            ValueError: `airflow.speed` has not been replaced by its cone-sphere (`topo_search.compose`).
        """
        if self.airflow.speed is not None:
            raise ValueError("`airflow.speed` must have been replaced by its cone-sphere")
        regions = self.region_airflow
        return self.envelope if regions is None else AirflowEnvelope.of(*regions)

    def hover_input(self, gravity: float) -> float:
        """Return the squared rotor speed at which the module carries its own weight [rad^2/s^2]."""
        return self.mass * gravity / (4 * self.thrust_coefficient)

    def thrust_over_weight(self, at: Thrust) -> float:
        """Return the thrust over the module's weight for `hover`, `full` or a number."""
        return {"hover": 1.0, "full": self.max_thrust_to_weight}[at] if isinstance(at, str) else at

    def max_input(self, gravity: float) -> float:
        """u_max: the largest squared rotor speed [rad^2/s^2]."""
        return self.max_thrust_to_weight * self.hover_input(gravity)

    def tip_speed(self, u: float) -> float:
        """Return the tip speed of a rotor at the squared speed u [m/s]."""
        return math.sqrt(u) * self.body.rotor_radius

    def figure_of_merit(self, density: float) -> float:
        """Return FM, ideal power over shaft power, for an air density [kg/m^3].

        >>> round(Module().figure_of_merit(1.2), 3)
        0.566
        """
        return self.ideal_power(density) / self.torque_coefficient

    @property
    def jet_momentum(self) -> float:
        """Momentum flux of the jet far below over the thrust; near 1 if `airflow.jet` fits the module.

        >>> round(Module().jet_momentum, 3)
        0.968
        """
        jet, L_over_R = self.airflow.jet, 2 * self.arm_length / self.body.rotor_radius
        return (jet.decay * jet.half_width * L_over_R) ** 2 / (24 * (math.sqrt(2) - 1))

    def ideal_power(self, density: float) -> float:
        """Return the power of an ideal rotor with the thrust of a rotor at 1 rad/s, for an air density [W]."""
        k_f, disc = self.thrust_coefficient, math.pi * self.body.rotor_radius**2
        return k_f * math.sqrt(k_f / (2 * density * disc))

    def propeller_coefficient(self, density: float) -> float:
        """Return C_T for an air density [kg/m^3]."""
        return (2 * math.pi) ** 2 * self.thrust_coefficient / (density * (2 * self.body.rotor_radius) ** 4)

    @property
    def bracket_sizes(self) -> Bracket:
        """Sizes of the brackets, given or default."""
        return self.bracket or Bracket()

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Ixx, Iyy, Izz about the module's centre [kg m^2]."""
        return self.body.inertia or _inertia_of_shapes(self)

    def resolve(self) -> Module:
        """Return the module with every default filled in, each quantity in a single form."""
        lengths: dict[str, Any] = {"start_radius": self.start_radius, "reach": self.reach}
        if (filled := self.region_airflow) is not None:
            lengths["regions"] = RegionAirflow(**filled._asdict())
        return self.model_copy(
            update={
                "max_thrust": None,
                "torque_to_thrust": None,
                "airflow": self.airflow.model_copy(update=lengths),
                "body": self.body.model_copy(update={"inertia": self.inertia}),
            }
        )


def _inertia_of_shapes(module: Module) -> tuple[float, float, float]:
    """Return the diagonal inertia of hub, four arms (each from the centre to a rotor) and four rotor discs.

    All parts have the same density, such that their mass is the module's; overlaps count twice. By the fourfold
    symmetry of arms and rotors only the hub can make Ixx and Iyy differ.
    """
    body, l_arm = module.body, module.arm_length
    hx, hy, hz = body.hub
    w = body.arm_width
    r, h = body.rotor_radius, body.rotor_height
    volumes = (hx * hy * hz, 4 * l_arm * w * w, 4 * math.pi * r * r * h)
    m_hub, m_arms, m_rotors = (module.mass * volume / sum(volumes) for volume in volumes)
    arms_across = m_arms * (w * w / 12 + l_arm * l_arm / 3)  # about an axis through the centre, across the arm
    arms_along = m_arms * w * w / 6
    arms_xy = (arms_across + arms_along) / 2
    rotors_xy = m_rotors * ((3 * r * r + h * h) / 12 + l_arm * l_arm / 2)
    rotors_z = m_rotors * (r * r / 2 + l_arm * l_arm)
    return (
        m_hub * (hy * hy + hz * hz) / 12 + arms_xy + rotors_xy,
        m_hub * (hx * hx + hz * hz) / 12 + arms_xy + rotors_xy,
        m_hub * (hx * hx + hy * hy) / 12 + arms_across + rotors_z,
    )
