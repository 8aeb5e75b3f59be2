r"""The module: its mass, rotors, connectors, airflow envelope and real body.

| symbol | field | unit |
|---|---|---|
| m | mass | kg |
| l_arm | arm_length | m |
| l_c | connector_distance | m |
| k_f | thrust_coefficient | N s^2 |
| k_tau | torque_coefficient | N m s^2 |
| u_max | max_thrust_to_weight m g / (r k_f) with r rotors, or max_thrust / k_f | rad^2/s^2 |

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

"""

from __future__ import annotations

import math
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from topo_search.limits import LIMITS
from topo_search.model.airflow import Airflow, AirflowEnvelope, FilledAirflow, RegionAirflow, Thrust
from topo_search.model.arrays import Array
from topo_search.model.body import Body
from topo_search.model.bracket import Bracket
from topo_search.model.kinds import NonNegative, Omitted, Positive, at_most, omit_if
from topo_search.model.rotors import ModuleRotor, RotorTable, table_of, x_quadrotor
from topo_search.model.value import Broken, Location, Value

AIR_DENSITY = 1.2
"""rho [kg/m^3]."""
WIDEST_DEG = 90.0
"""Largest spread of an envelope [deg]."""
PRECISION = 1e-3
"""Relative difference up to which two values of one quantity agree: the precision of a data sheet."""


class Module(Value):
    """Module with rotors and four connectors."""

    mass: Positive = 0.24
    """m [kg]."""
    arm_length: Positive = 0.10
    """l_arm: distance from the module's centre to a rotor, unless `rotors` says otherwise; unit of lengths [m]."""
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
    """Mass of a joint (bracket, struts and bolts), located at its connector [kg]; default of a new task: that of a
    kit's parts."""
    min_input: Annotated[float, Field(strict=True, ge=0, lt=1, exclude_if=lambda given: given == 0.0)] = 0.0
    """Minimum squared speed of a running rotor, as a share of the maximum; a failed rotor is exempt."""
    wake_loss: Annotated[NonNegative, omit_if(0.37)] = 0.37
    """Share of a rotor's thrust lost to a wake as fast as its own induced speed; default: blade-element theory."""
    battery_Wh: Omitted[Positive] = None
    """Energy of a module's battery [Wh], from which the audit bounds the endurance."""
    rotors: Omitted[Annotated[tuple[ModuleRotor, ...], at_most(LIMITS.rotors, "rotors")]] = None
    """Rotors; default: four in an X, one arm length from the centre, which turn in alternate senses; a type of
    module may have none."""
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
            if envelope is not None and self.rotor_table.count and envelope.reach <= envelope.start_radius:
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
        """r_air: radius of the envelope at the module's centre, which holds all centres of rotors [m].

        If each rotor has an envelope of its own, that of the largest rotor.
        """
        return self.airflow.start_radius or self._start()

    def _start(self, beyond: float = 0.0) -> float:
        rotors = self.rotor_table
        return float(self.rotor_radii.max()) if rotors.has_own_jets else self.arm_length * rotors.span + beyond

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
        return AirflowEnvelope.of(self.start_radius, self.spread_deg(self.airflow.spread_angle_deg), self.reach)

    @property
    def envelopes(self) -> tuple[AirflowEnvelope, ...]:
        """Airflow envelopes: that about the module's axis, or one about the axis of each rotor."""
        return self._by_rotor(self.envelope, self.airflow.spread_angle_deg) if self.rotor_table.count else ()

    @property
    def region_envelopes(self) -> tuple[AirflowEnvelope, ...]:
        """Airflow envelopes that stay out of target regions; ValueError as for `region_envelope`."""
        regions = self.airflow.regions or self.airflow
        return self._by_rotor(self.region_envelope, regions.spread_angle_deg) if self.rotor_table.count else ()

    def _by_rotor(self, whole: AirflowEnvelope, spread_deg: float) -> tuple[AirflowEnvelope, ...]:
        if not self.rotor_table.has_own_jets:
            return (whole,)
        sizes = whole.start_radius, spread_deg, whole.start_radius + whole.length + whole.growth
        places = (self.arm_length * self.rotor_table.positions).tolist(), self.rotor_table.axes.tolist()
        return tuple(AirflowEnvelope.of(*sizes, origin=o, upstream=axis) for o, axis in zip(*places, strict=True))

    def spread_deg(self, angle_deg: float) -> float:
        """Return the full spreading angle of an envelope that also holds the jets of tilted rotors [deg]."""
        return min(angle_deg + 2 * math.degrees(self.rotor_table.tilt), WIDEST_DEG)

    @property
    def region_airflow(self) -> FilledAirflow | None:
        """`airflow.regions` with all lengths filled in; None if it is not given."""
        regions = self.airflow.regions
        if regions is None:
            return None
        start = regions.start_radius or self._start(float(self.rotor_radii.max(initial=0.0)))
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
        if regions is None:
            return self.envelope
        return AirflowEnvelope.of(regions.start_radius, self.spread_deg(regions.spread_angle_deg), regions.reach)

    @property
    def rotor_table(self) -> RotorTable:
        """The module's rotors."""
        if self.rotors is None:
            return x_quadrotor()
        sizes = self.arm_length, self.thrust_coefficient, self.torque_coefficient, self.body.rotor_radius
        return table_of(self.rotors, *sizes)

    @property
    def rotor_radii(self) -> Array:
        """Radii of the rotors, shape (r,) [m]."""
        return self.body.rotor_radius * self.rotor_table.sizes

    def hover_input(self, gravity: float) -> float:
        """Return the squared rotor speed at which thrusts add up to the module's weight [rad^2/s^2]."""
        return self.mass * gravity / (max(1, self.rotor_table.count) * self.thrust_coefficient)

    def thrust_to_weight(self, thrust: float, gravity: float) -> float:
        """Return the thrust of the module over its weight, if every rotor has a given thrust [N]."""
        return self.rotor_table.count * thrust / (self.mass * gravity)

    def with_thrust_to_weight(self, gravity: float) -> Self:
        """Return the module with `max_thrust_to_weight` filled in from `max_thrust`, unless it is given."""
        if self.max_thrust is None or "max_thrust_to_weight" in self.model_fields_set or not self.rotor_table.count:
            return self
        return self.replace(max_thrust_to_weight=self.thrust_to_weight(self.max_thrust, gravity))

    def thrust_over_weight(self, at: Thrust) -> float:
        """Return the thrust over the module's weight for `hover`, `full` or a number."""
        return {"hover": 1.0, "full": self.max_thrust_to_weight}[at] if isinstance(at, str) else at

    def max_input(self, gravity: float) -> float:
        """u_max: the largest squared rotor speed [rad^2/s^2]."""
        return self.max_thrust_to_weight * self.hover_input(gravity)

    def max_inputs(self, gravity: float) -> Array:
        """Return the largest squared speed of each rotor, shape (r,) [rad^2/s^2]."""
        return self.max_input(gravity) * self.input_shares(gravity)

    def input_shares(self, gravity: float) -> Array:
        """Return the largest squared speeds of the rotors over u_max, shape (r,)."""
        rotors, thrust = self.rotor_table, self.thrust_coefficient * self.max_input(gravity)
        return np.where(rotors.limits, rotors.limits / thrust, 1.0) / rotors.gains

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
        jet, rotors, radii = self.airflow.jet, self.rotor_table, self.rotor_radii / self.arm_length
        L, area = 2 * rotors.jet_radii(radii)[0], radii[0] ** 2 if rotors.has_own_jets else (radii**2).sum()
        return float((jet.decay * jet.half_width * L) ** 2 / area / (6 * (math.sqrt(2) - 1)))

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
        return self.bracket or Bracket.of_module(self.connector_distance, self.mass)

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Ixx, Iyy, Izz about the module's centre [kg m^2]."""
        return self.body.inertia or _inertia_of_shapes(self)

    def resolve(self) -> Self:
        """Return the module with every default filled in, each quantity in a single form."""
        if self.rotors and self.rotor_table.is_same_as(x_quadrotor()):
            return self.model_copy(update={"rotors": None}).resolve()
        lengths: dict[str, Any] = {"start_radius": self.start_radius or None, "reach": self.reach}
        if (filled := self.region_airflow) is not None:
            lengths["regions"] = RegionAirflow(**filled._asdict())
        resolved = {
            "max_thrust": None,
            "torque_to_thrust": None,
            "airflow": self.airflow.model_copy(update=lengths),
            "body": self.body.model_copy(update={"inertia": self.inertia}),
        }
        return self.model_copy(update=resolved)


def _inertia_of_shapes(module: Module) -> tuple[float, float, float]:
    """Return the diagonal inertia of hub, arms (each from the centre to a rotor) and rotor discs.

    All parts have the same density, such that their mass is the module's; overlaps count twice. By the fourfold
    symmetry of arms and rotors only the hub can make Ixx and Iyy differ.
    """
    if module.rotors is not None:
        return _inertia_of_table(module)
    body, l_arm, rotors = module.body, module.arm_length, module.rotor_table.count
    hx, hy, hz = body.hub
    w = body.arm_width
    r, h = body.rotor_radius, body.rotor_height
    volumes = (hx * hy * hz, rotors * l_arm * w * w, rotors * math.pi * r * r * h)
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


def _inertia_of_table(module: Module) -> tuple[float, float, float]:
    """Return the same for a table of rotors: their products of inertia are left out."""
    body, rotors = module.body, module.rotor_table
    hx, hy, hz = body.hub
    w, r, h = body.arm_width, body.rotor_radius, body.rotor_height
    lengths, positions = module.arm_length * rotors.distances, module.arm_length * rotors.positions
    disc = math.pi * r * r * h
    density = module.mass / (hx * hy * hz + float(lengths.sum()) * w * w + rotors.count * disc)
    moments = density * hx * hy * hz * np.array([hy * hy + hz * hz, hx * hx + hz * hz, hx * hx + hy * hy]) / 12
    for length, along, position, axis in zip(lengths, rotors.directions, positions, rotors.axes, strict=True):
        bar, square = density * length * w * w, position**2
        moments += bar * (w * w / 6 * along**2 + (w * w + length * length) / 12 * (1 - along**2))
        moments += (bar / 4 + density * disc) * (square.sum() - square)
        moments += density * disc * (r * r / 2 * axis**2 + (3 * r * r + h * h) / 12 * (1 - axis**2))
    x, y, z = moments.tolist()
    return x, y, z
