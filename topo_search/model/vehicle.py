"""Any vehicle with fixed rotors, as its table of rotors describes it, and what it can do.

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

from topo_search.limits import LIMITS
from topo_search.model.bad_input import BadInput
from topo_search.model.files import load_text, validate
from topo_search.model.flight import Flight, Size
from topo_search.model.text import NotParsed, toml_data
from topo_search.model.value import (
    Broken,
    Index,
    NonEmpty,
    NonNegative,
    Number,
    Omitted,
    Positive,
    Value,
    Vector,
    at_most,
)


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
    try:
        data = toml_data(load_text(path, most_bytes=LIMITS.task_bytes))
    except NotParsed as error:
        raise BadInput(str(path), str(error)) from None
    if isinstance(name := data.get("rotors"), str):
        data = {**data, "rotors": _rows(path.parent / name)}
    return validate(Vehicle, data, str(path))


def _rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table of rotors, with numbers where there are some."""
    of_a_kit = {"axis_x": "ax", "axis_y": "ay", "axis_z": "az", "thrust_coefficient_Ns2": "k_f"}
    of_a_kit |= {"torque_coefficient_Nms2": "k_tau", "largest_thrust_N": "thrust"}
    rows = []
    for row in csv.DictReader(io.StringIO(load_text(path, most_bytes=LIMITS.task_bytes))):
        given = {of_a_kit.get(name, name): _number(cell) for name, cell in row.items() if cell}
        if "thrust" in given and isinstance(given.get("k_f"), float):
            given = {name: given[name] for name in given if name in VehicleRotor.model_fields or name == "thrust"}
            given["u_max"] = given.pop("thrust") / given["k_f"]
        if isinstance(spin := given.get("spin"), float) and spin.is_integer():
            given["spin"] = int(spin)
        rows.append(given)
    return rows


def _number(cell: str) -> Any:
    try:
        return float(cell)
    except ValueError:
        return cell
