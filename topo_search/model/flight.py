"""Capabilities of a design beyond its task, as in `flight` of `audit.json`, and of any vehicle with fixed rotors.

Numbers are proven: a reserve is at least what it says, and at most `..._at_most`. None: there is none, or no proof.
Rotors run from their least input up to their largest; `search.peak_input` is asked of the load cases alone.

A vehicle is described by its table of rotors:

| symbol | meaning | unit |
|---|---|---|
| r, a | position of a rotor; its thrust axis, a unit vector | m |
| s | spin: 1 counter-clockwise seen against the thrust axis, -1 clockwise | |
| u | its input: squared speed, negative where a reversible rotor turns the other way | rad^2/s^2 |

A rotor exerts the force k_f u a and the torque k_f u r x a - s k_tau u a.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from topo_search.limits import LIMITS
from topo_search.model.files import load_text, validate
from topo_search.model.proven import lower_text
from topo_search.model.text import toml_data
from topo_search.model.value import (
    BadInput,
    Broken,
    Fault,
    Index,
    NonEmpty,
    NonNegative,
    Number,
    Omitted,
    Positive,
    Value,
    Vector,
    at_most,
    naming,
    show,
)

Size = Annotated[float, Field(strict=True, ge=0)]
"""A measured quantity, however large."""


class CaseFlight(Value):
    """Reserves of a load case, or of hover: around its wrench, with the torque or the force as asked.

    Reserves, tilt and accelerations are those left with the centre of mass anywhere within `flight.com_error`.
    """

    name: str
    """`hover` (the weight carried at the COM) or the load case's."""
    possible: bool | None
    """True if the rotors can produce it; None: undecided."""
    force_reserve_N: Size | None = None
    """Any force of this size can be added at the end-effector [N]."""
    force_reserve_at_most_N: Size | None = None
    force_weakest: Vector | None = None
    """No more than that force can be added this way."""
    horizontal_reserve_N: Size | None = None
    """The same of horizontal forces alone [N]."""
    horizontal_reserve_at_most_N: Size | None = None
    horizontal_weakest: Vector | None = None
    force_reserve_com_N: Omitted[Size] = None
    """Any force of this size can be added at the centre of mass [N]; None in older files."""
    force_reserve_com_at_most_N: Omitted[Size] = None
    force_weakest_com: Omitted[Vector] = None
    horizontal_reserve_com_N: Omitted[Size] = None
    """The same of horizontal forces alone [N]."""
    horizontal_reserve_com_at_most_N: Omitted[Size] = None
    horizontal_weakest_com: Omitted[Vector] = None
    torque_reserve_Nm: Size | None = None
    """Any torque of this size can be added [N m]."""
    torque_reserve_at_most_Nm: Size | None = None
    torque_weakest: Vector | None = None
    com_error_m: Omitted[Size] = None
    """Largest offset of the centre of mass along each axis at once [m]; None where no force acts there."""
    com_error_at_most_m: Omitted[Size] = None
    tilt_deg: Omitted[Size] = None
    """Hover can be held at any tilt up to this, to every side, without torque [deg]; None of load cases."""
    tilt_at_most_deg: Omitted[Size] = None
    tilt_weakest: Omitted[Vector] = None
    """Rotors lack force towards it, in the axes of the body, where more is asked for."""
    angular_acceleration_rad_s2: Omitted[tuple[Size, Size, Size]] = None
    """About x, y and z of the body at the centre of mass, one at a time and either way: torque J e a can be added,
    with the platform's inertia J [rad/s^2]."""
    angular_acceleration_at_most_rad_s2: Omitted[tuple[Size, Size, Size]] = None
    force_reserve_N_pseudo_inverse: Omitted[Size] = None
    """The same by an allocator that only multiplies wrenches, the case's own included, by the pseudo-inverse of the
    map from inputs, and does not desaturate; likewise below."""
    horizontal_reserve_N_pseudo_inverse: Omitted[Size] = None
    force_reserve_com_N_pseudo_inverse: Omitted[Size] = None
    horizontal_reserve_com_N_pseudo_inverse: Omitted[Size] = None
    torque_reserve_Nm_pseudo_inverse: Omitted[Size] = None
    com_error_m_pseudo_inverse: Omitted[Size] = None
    tilt_deg_pseudo_inverse: Omitted[Size] = None
    angular_acceleration_rad_s2_pseudo_inverse: Omitted[tuple[Size, Size, Size]] = None
    load_factor: Size | None = None
    """The load times this can be produced: what is left until a rotor saturates. The load is the whole wrench, or
    what is asked for besides where the weight is carried at the COM."""
    load_factor_at_most: Size | None = None
    largest_input: Number | None = None
    """Largest input, of the design's cases and of the least-effort hover, over the largest input of a rotor."""
    least_input: Number | None = None
    inputs_at_limit: Index | None = None
    """Number of inputs within a thousandth of their range from a limit."""


class RotorsOut(Value):
    """Single rotors that may fail."""

    survive: Index
    """Number of single rotor failures proven to be survivable."""
    of: Index
    lost: tuple[tuple[Index, Index], ...] = ()
    """Module and rotor (0..3) of each whose failure is proven to make a wrench impossible."""
    undecided: tuple[tuple[Index, Index], ...] = ()
    torque_reserve_Nm: Omitted[Size] = None
    """Any torque of this size can be added with any one of the rotors dead [N m]; None if not asked for."""
    torque_reserve_at_most_Nm: Omitted[Size] = None
    weakest: Omitted[tuple[Index, Index]] = None
    """Module and rotor whose failure leaves least."""


class JointLoad(Value):
    """Loads of a joint in a load case, or in hover.

    Each figure is the larger of both sides, if either may carry the end-effector.
    """

    case: str
    module: Index
    """The module that is nearer to the root."""
    port: Index
    """Its port."""
    child: Index
    force_N: Size
    moment_Nm: Size
    """About the connector."""
    about_hinge_Nm: Size
    """The part of it about the hinge's axis."""
    across_hinge_Nm: Size


class CasePower(Value):
    """Power of all rotors in hover, or in a load case."""

    name: str
    """`hover` or the load case's."""
    ideal_W: Size
    """That of ideal rotors with the same thrusts and discs [W]."""
    shaft_W: Size
    """Drag torque times speed, summed over all rotors [W]; motors and wires take more."""
    figure_of_merit: Size
    """Ideal over shaft power."""
    endurance_min: Omitted[Size] = None
    """Longest time that the batteries of all modules can last, where `module.battery_Wh` is given [min]."""


class Flight(Value):
    """Capabilities of a design beyond its task."""

    cases: tuple[CaseFlight, ...]
    """Hover, then every load case."""
    rotors_out_hover: RotorsOut
    """With any one of these rotors dead the platform can still hover."""
    rotors_out_all: RotorsOut
    """And exert every load case."""
    rotors_out_asked: Omitted[RotorsOut] = None
    """In the cases for which the task asks for that; None where it does not."""
    joints: tuple[JointLoad, ...]
    """Joint by joint for hover, then for every load case."""
    hinge_tolerance_deg: Size | None
    """Proven: hinge angles off by as much lose no clearance [deg]; None where there is none to lose."""
    hover_input: Size | None
    """Mean input in hover over the largest input of a rotor."""
    hover_power_ratio: Size | None
    """Sum of u^1.5 in hover over that of rotors which all pull straight up."""
    rod_length_m: Size | None
    """None: no straight rod carries the end-effector."""
    rod_mass_share: Size | None
    """Mass of the rod over that of the platform, which includes it with `rod_mass = "included"`."""
    span_m: Size
    """Largest distance between the centres of two rotors, and the width of one [m]."""

    @property
    def hover_power_excess(self) -> float | None:
        """Percentage of power over that of rotors which all pull straight up, without rounding; None: no hover."""
        return None if self.hover_power_ratio is None else round(100.0 * self.hover_power_ratio - 100.0, 9) + 0.0

    @property
    def hover(self) -> CaseFlight:
        """Reserves of hover."""
        return self.cases[0]

    @property
    def load_factor(self) -> float | None:
        """The least of hover and all load cases."""
        return min((case.load_factor for case in self.cases if case.load_factor is not None), default=None)

    @property
    def joint_moment_Nm(self) -> float | None:
        """The largest of all load cases that the task has [N m]; None without joints."""
        moments = (load.moment_Nm for load in self.joints if load.case != self.hover.name)
        return max(moments, default=None)

    @property
    def weakest_point(self) -> str:
        """Most important fact for a pilot, in one line."""
        hover, out = self.hover, self.rotors_out_hover
        if not hover.possible:
            return "cannot hover" if hover.possible is False else "leaves undecided whether it can hover"
        facts = ["hovers"]
        if hover.horizontal_reserve_N is not None:
            towards = "" if hover.horizontal_weakest is None else f" towards {direction(hover.horizontal_weakest)}"
            facts.append(f"weakest side force at the tip {lower_text(hover.horizontal_reserve_N, 3)} N{towards}")
        open_ = f" ({len(out.undecided)} undecided)" if out.undecided else ""
        facts.append(f"survives {out.survive} of {out.of} single rotor failures, once known{open_}")
        return "; ".join(facts)


def direction(v: Vector) -> str:
    """Return a direction in words: an axis, or the components of a unit vector."""
    length, straight = math.hypot(*v), math.cos(math.radians(1.0))  # so near to an axis it is named after that
    for name, component in zip("xyz", v, strict=True):
        if abs(component) >= straight * length:
            return f"{'-' if component < 0 else '+'}{name}"
    return f"[{', '.join(f'{component / length:.2f}' for component in v)}]"


class VehicleRotor(Value):
    """One rotor: a row of `rotors.csv`."""

    x_m: Number
    """r, in the axes of the vehicle, z up [m]."""
    y_m: Number
    z_m: Number
    ax: Number
    """a, of any length."""
    ay: Number
    az: Number
    spin: Literal[-1, 1]
    """s."""
    k_f: Positive
    """Thrust coefficient [N s^2]."""
    k_tau: NonNegative
    """Torque coefficient [N m s^2]."""
    u_max: Positive
    """Largest squared speed [rad^2/s^2]."""
    u_min: Number = 0.0
    """Least squared speed; below zero the rotor is reversible [rad^2/s^2]."""

    def _broken_rules(self) -> Broken:
        if not math.hypot(self.ax, self.ay, self.az) > 1e-12:
            yield "ax", "must be part of an axis with a direction, but got the zero vector"
        if not -1e15 <= self.u_min < self.u_max:
            yield "u_min", f"must be less than u_max, {self.u_max:g}, but got {self.u_min:g}"


class Vehicle(Value):
    """A vehicle: the tables of `VEHICLE.toml`, its rotors read."""

    mass: Positive = 1.0
    """[kg]"""
    inertia: tuple[Vector, Vector, Vector] | Vector | None = None
    """Tensor about the centre of mass, or its diagonal [kg m^2]; None: unknown."""
    com: Vector = (0.0, 0.0, 0.0)
    """Centre of mass, in the axes and from the origin of the rotors' positions [m]."""
    end_effector: Vector | None = None
    """Point where loads of a task act, likewise [m]; default: where the task fixes it, or the centre of mass."""
    gravity: Positive = 9.81
    """[m/s^2]"""
    rotors: Annotated[tuple[VehicleRotor, ...], at_most(400, "rotors"), NonEmpty]


class Capability(Value):
    """Capability of a vehicle, as `topo-search capability --json` prints it."""

    format: Literal["topo-search/capability"] = "topo-search/capability"
    version: Literal[1] = 1
    rank: Index
    """Rank of the map from inputs to wrenches: 6 if the vehicle is fully actuated."""
    zero_torque_volume_N3: Size
    """Volume of the forces that it can exert without torque about its centre of mass [N^3]."""
    zero_torque_ball_N: Size
    """It can exert any force of this size without torque [N]."""
    flight: Flight
    """As in `audit.json`; single rotors are numbered from 0, all of module 0."""
    met: Omitted[bool] = None
    """True if every wrench of the task is proven possible; None without a task."""


def read_vehicle(path: str | Path) -> Vehicle:
    """Return the vehicle that a `.toml` file or a table of rotors (`.csv`) describes.

    Raises:
        BadInput: one fault for each thing that is wrong.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return validate(Vehicle, {"rotors": _rows(path)}, str(path))
    with naming(str(path)):
        data = toml_data(load_text(path, most_bytes=LIMITS.task_bytes))
    if isinstance(name := data.get("rotors"), str):
        data = {**data, "rotors": _rows(path.parent / name)}
    return validate(Vehicle, data, str(path))


def _rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table of rotors, with cells that hold numbers converted."""
    try:
        reader = csv.DictReader(io.StringIO(load_text(path, most_bytes=LIMITS.task_bytes)))
        table, columns = list(reader), reader.fieldnames or []
    except csv.Error as error:
        raise BadInput(str(path), [Fault("rotors", f"must be a CSV table, but {error}")]) from None
    if not {"x_m", "y_m", "z_m"} <= set(columns):
        rule = (
            f"must be a CSV table with columns x_m, y_m, z_m, ..., but its first line is {show(','.join(columns))}"
        )
        raise BadInput(str(path), [Fault("rotors", rule)])
    if faults := [
        Fault(
            f"rotors[{k}]",
            f"must have at most {len(columns)} cells, one per column, but has {len(columns) + len(row[None])}",
        )
        for k, row in enumerate(table)
        if None in row
    ]:
        raise BadInput(str(path), faults)
    of_a_kit = {"axis_x": "ax", "axis_y": "ay", "axis_z": "az", "thrust_coefficient_Ns2": "k_f"}
    of_a_kit |= {"torque_coefficient_Nms2": "k_tau", "largest_thrust_N": "thrust"}
    rows = []
    for row in table:
        given = {of_a_kit.get(name, name): _number(cell) for name, cell in row.items() if cell}
        if "thrust" in given:
            given = {name: given[name] for name in given if name in VehicleRotor.model_fields or name == "thrust"}
            thrust, k_f = given.pop("thrust"), given.get("k_f")
            both = isinstance(thrust, float) and isinstance(k_f, float) and k_f > 0
            given["u_max"] = thrust / k_f if both else thrust  # `validate` refuses the latter
        if isinstance(spin := given.get("spin"), float) and spin.is_integer():
            given["spin"] = int(spin)
        rows.append(given)
    return rows


def _number(cell: str) -> Any:
    try:
        return float(cell)
    except ValueError:
        return cell
