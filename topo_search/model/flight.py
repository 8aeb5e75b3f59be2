"""Capabilities of a design beyond its task, as in `flight` and `power` of `audit.json`.

All numbers are proven: a reserve is a lower bound, `..._at_most` an upper bound. None: no reserve, or no proof.
Rotors may use their full range of inputs; `search.peak_input` limits the load cases only.
"""

import math
from typing import Annotated

from topo_search.model.kinds import Index, Number, Omitted, Size, Vector, omit_if
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.value import Value


class CaseFlight(Value):
    """Reserves around the wrench of a load case, or of hover; the other part of the wrench stays unchanged.

    Reserves, tilt and accelerations hold with the centre of mass anywhere within `flight.com_error`.
    """

    name: str
    """`hover` (the weight, carried at the COM) or the name of the load case."""
    possible: bool | None
    """True if the rotors can produce it; None: undecided."""
    force_reserve_N: Size | None = None
    """Any force of this size can be added at the end-effector [N]."""
    force_reserve_at_most_N: Size | None = None
    force_weakest: Vector | None = None
    """Direction in which the force reserve is exhausted first."""
    horizontal_reserve_N: Size | None = None
    """The same for horizontal forces [N]."""
    horizontal_reserve_at_most_N: Size | None = None
    horizontal_weakest: Vector | None = None
    force_reserve_com_N: Omitted[Size] = None
    """Any force of this size can be added at the centre of mass [N]; None in older files."""
    force_reserve_com_at_most_N: Omitted[Size] = None
    force_weakest_com: Omitted[Vector] = None
    horizontal_reserve_com_N: Omitted[Size] = None
    """The same for horizontal forces [N]."""
    horizontal_reserve_com_at_most_N: Omitted[Size] = None
    horizontal_weakest_com: Omitted[Vector] = None
    torque_reserve_Nm: Size | None = None
    """Any torque of this size can be added [N m]."""
    torque_reserve_at_most_Nm: Size | None = None
    torque_weakest: Vector | None = None
    com_error_m: Omitted[Size] = None
    """Largest tolerated offset of the centre of mass along all axes at once [m]; None if no force acts there."""
    com_error_at_most_m: Omitted[Size] = None
    tilt_deg: Omitted[Size] = None
    """Hover is possible at any tilt up to this, in every direction, without torque [deg]; None for load cases."""
    tilt_at_most_deg: Omitted[Size] = None
    tilt_weakest: Omitted[Vector] = None
    """Direction in which rotors lack force at a larger tilt, in the axes of the body."""
    angular_acceleration_rad_s2: Omitted[tuple[Size, Size, Size]] = None
    """Angular acceleration a about x, y and z of the body, one at a time, in both senses: the torque J e a can be
    added, with the platform's inertia J about its centre of mass [rad/s^2]."""
    angular_acceleration_at_most_rad_s2: Omitted[tuple[Size, Size, Size]] = None
    force_reserve_N_pseudo_inverse: Omitted[Size] = None
    """The same for an allocator that multiplies the whole wrench by the pseudo-inverse of the allocation matrix,
    without desaturation; likewise the fields below."""
    horizontal_reserve_N_pseudo_inverse: Omitted[Size] = None
    force_reserve_com_N_pseudo_inverse: Omitted[Size] = None
    horizontal_reserve_com_N_pseudo_inverse: Omitted[Size] = None
    torque_reserve_Nm_pseudo_inverse: Omitted[Size] = None
    com_error_m_pseudo_inverse: Omitted[Size] = None
    tilt_deg_pseudo_inverse: Omitted[Size] = None
    angular_acceleration_rad_s2_pseudo_inverse: Omitted[tuple[Size, Size, Size]] = None
    load_factor: Size | None = None
    """Factor by which the load can grow until a rotor saturates. The load is the wrench, without the weight if the
    case carries that at the COM."""
    load_factor_at_most: Size | None = None
    largest_input: Number | None = None
    """Largest input over u_max, from the design or for the hover of least effort."""
    least_input: Number | None = None
    """Smallest input over u_max, likewise."""
    inputs_at_limit: Index | None = None
    """Number of inputs within a thousandth of their range from a limit."""


class RotorsOut(Value):
    """Single rotor failures, once known.

    One is survived if every wrench remains possible, and any torque of `flight.rotor_out_torque`, or its default,
    can be added to it: less does not control the attitude.
    """

    survive: Index
    """Number of failures proven survivable."""
    hover_only: Index = 0
    """Number of failures that leave every wrench possible, but provably less torque: it can only hover."""
    of: Index
    """Number of rotors."""
    lost: tuple[tuple[Index, Index], ...] = ()
    """Module and rotor (0..3) of each failure proven to make a wrench impossible."""
    undecided: tuple[tuple[Index, Index], ...] = ()
    """Module and rotor of each undecided failure."""
    torque_reserve_Nm: Omitted[Size] = None
    """Any torque of this size can be added after any single rotor failure [N m]; None if not required."""
    torque_reserve_at_most_Nm: Omitted[Size] = None
    weakest: Omitted[tuple[Index, Index]] = None
    """Module and rotor whose failure leaves the smallest torque reserve."""


class JointLoad(Value):
    """Loads of a joint in a load case, or in hover.

    Each is the larger of both sides, if the end-effector may be on either.
    """

    case: str
    """`hover` or the name of the load case."""
    module: Index
    """Module nearer to the root."""
    port: Index
    """Its port."""
    child: Index
    """Module farther from the root."""
    force_N: Size
    moment_Nm: Size
    """Moment about the connector [N m]."""
    about_hinge_Nm: Size
    """Its component about the hinge axis [N m]."""
    across_hinge_Nm: Size
    """Its component across the hinge axis [N m]."""


class CasePower(Value):
    """Power of all rotors in hover, or in a load case."""

    name: str
    """`hover` or the name of the load case."""
    ideal_W: Size
    """Power of ideal rotors with the same thrusts and discs [W]."""
    shaft_W: Size
    """Drag torque times speed, summed over all rotors [W]; without losses of motors and wires."""
    figure_of_merit: Size
    """Ratio of ideal to shaft power."""
    endurance_min: Omitted[Size] = None
    """Upper bound for the time that all batteries last, by the inputs of least power [min]; None without
    `module.battery_Wh`."""


class Flight(Value):
    """Capabilities of a design beyond its task."""

    cases: tuple[CaseFlight, ...]
    """Hover, then every load case."""
    rotors_out_hover: RotorsOut
    """Rotor failures that hover survives."""
    rotors_out_all: RotorsOut
    """Rotor failures that hover and every load case survive."""
    rotors_out_asked: Omitted[RotorsOut] = None
    """Rotor failures by the cases of `flight.rotor_out`; None if not required."""
    joints: tuple[JointLoad, ...]
    """Loads of all joints outside of cycles in hover, then in every load case."""
    joints_in_cycles: Annotated[Index, omit_if(0)] = 0
    """Number of joints in cycles of a lattice, whose loads are statically indeterminate and not computed."""
    hinge_tolerance_deg: Size | None
    """Proven: hinge errors of this size, in the frame of the rod's module, violate no clearance [deg]; None without
    clearances."""
    hover_input: Size | None
    """Mean input in hover over u_max."""
    hover_power_ratio: Size | None
    """Sum of u^1.5 in hover over that of rotors that all point straight up."""
    rod_length_m: Size | None
    """Length of the rod [m]; None without a straight rod."""
    rod_mass_share: Size | None
    """Mass of the rod over that of the platform (with the rod if `rod_mass = "included"`)."""
    rod_moment_Nm: Omitted[Size] = None
    """Moment about the centre of mass of a required rod whose mass is ignored [N m]; None without such a rod."""
    span_m: Size
    """Largest distance of two rotor centres plus a rotor diameter [m]."""

    @property
    def hover_power_excess(self) -> float | None:
        """Excess of the hover power over that of rotors that all point straight up [%]; None without hover."""
        return None if self.hover_power_ratio is None else round(100.0 * self.hover_power_ratio - 100.0, 9) + 0.0

    @property
    def hover(self) -> CaseFlight:
        """Reserves of hover."""
        return self.cases[0]

    @property
    def load_factor(self) -> float | None:
        """Smallest load factor of hover and all load cases."""
        return min((case.load_factor for case in self.cases if case.load_factor is not None), default=None)

    @property
    def joint_moment_Nm(self) -> float | None:
        """Largest joint moment of all load cases [N m]; None without joints."""
        moments = (load.moment_Nm for load in self.joints if load.case != self.hover.name)
        return max(moments, default=None)

    @property
    def weakest_point(self) -> str:
        """Most important facts for a pilot, in one line."""
        hover, out = self.hover, self.rotors_out_hover
        if not hover.possible:
            return "cannot hover" if hover.possible is False else "leaves undecided whether it can hover"
        facts = ["hovers"]
        if hover.horizontal_reserve_N is not None:
            towards = "" if hover.horizontal_weakest is None else f" towards {direction(hover.horizontal_weakest)}"
            facts.append(f"weakest side force at the tip {lower_text(hover.horizontal_reserve_N, 3)} N{towards}")
        undecided = f" ({len(out.undecided)} undecided)" if out.undecided else ""
        facts.append(f"survives {out.survive} of {out.of} single rotor failures, once known{undecided}")
        facts += [f"can only hover: {out.hover_only}"] if out.hover_only else []
        if self.rod_moment_Nm is not None and hover.torque_reserve_Nm is not None:
            moment, left = upper_text(self.rod_moment_Nm, 3), lower_text(hover.torque_reserve_Nm, 3)
            facts.append(f"the rod, whose mass is ignored, takes {moment} N m of {left} N m of torque left")
        return "; ".join(facts)


def direction(v: Vector) -> str:
    """Return a direction in words: an axis, or the components of a unit vector."""
    length, straight = math.hypot(*v), math.cos(math.radians(1.0))  # within 1 deg of an axis
    for name, component in zip("xyz", v, strict=True):
        if abs(component) >= straight * length:
            return f"{'-' if component < 0 else '+'}{name}"
    return f"[{', '.join(f'{component / length:.2f}' for component in v)}]"
