"""Any vehicle with fixed rotors, and its capabilities.

A vehicle is a table of rotors:

| symbol | meaning | unit |
|---|---|---|
| r, a | position of a rotor; its thrust axis, a unit vector | m |
| s | spin: 1 counter-clockwise seen against the thrust axis, -1 clockwise | |
| u | its input: squared speed, negative where a reversible rotor turns the other way | rad^2/s^2 |

A rotor exerts the force k_f u a and the torque k_f u r x a - s k_tau u a.
"""

import csv
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from topo_search.limits import LIMITS
from topo_search.model.files import load_text, validate
from topo_search.model.flight import Flight
from topo_search.model.kinds import Index, NonEmpty, NonNegative, Number, Omitted, Positive, Size, Vector, at_most
from topo_search.model.text import toml_data
from topo_search.model.value import BadInput, Broken, Fault, Value, as_bad_input, show


class VehicleRotor(Value):
    """Rotor: a row of `rotors.csv`."""

    x_m: Number
    """r, in the axes of the vehicle, z up [m]."""
    y_m: Number
    z_m: Number
    ax: Number
    """a, of any length."""
    ay: Number
    az: Number
    spin: Literal[-1, 1]
    """s: spin."""
    k_f: Positive
    """Thrust coefficient [N s^2]."""
    k_tau: NonNegative
    """Torque coefficient [N m s^2]."""
    u_max: Positive
    """Largest squared speed [rad^2/s^2]."""
    u_min: Number = 0.0
    """Smallest squared speed [rad^2/s^2]; negative for a reversible rotor."""

    def _broken_rules(self) -> Broken:
        if not math.hypot(self.ax, self.ay, self.az) > 1e-12:
            yield "ax", "must be part of an axis with a direction, but got the zero vector"
        if not -1e15 <= self.u_min < self.u_max:
            yield "u_min", f"must be less than u_max, {self.u_max:g}, but got {self.u_min:g}"


class Vehicle(Value):
    """Vehicle, as in `VEHICLE.toml` with its table of rotors."""

    mass: Positive = 1.0
    """Mass [kg]."""
    inertia: tuple[Vector, Vector, Vector] | Vector | None = None
    """Inertia tensor about the centre of mass, or its diagonal [kg m^2]; None: unknown."""
    com: Vector = (0.0, 0.0, 0.0)
    """Centre of mass in the frame of the rotor positions [m]."""
    end_effector: Vector | None = None
    """Point of action of a task's loads, in the same frame [m]; default: the task's fixed position, or the COM."""
    gravity: Positive = 9.81
    """g [m/s^2]."""
    rotors: Annotated[tuple[VehicleRotor, ...], at_most(400, "rotors"), NonEmpty]
    """Rotors."""


class Capability(Value):
    """Capability of a vehicle, the output of `topo-search capability --json`."""

    format: Literal["topo-search/capability"] = "topo-search/capability"
    version: Literal[1] = 1
    rank: Index
    """Rank of the map from inputs to wrenches: 6 if the vehicle is fully actuated."""
    zero_torque_volume_N3: Size
    """Volume of the set of forces without torque about the centre of mass [N^3]."""
    zero_torque_ball_N: Size
    """Any force of this size can be exerted without torque [N]."""
    flight: Flight
    """As in `audit.json`; all rotors belong to module 0 and are numbered from 0."""
    met: Omitted[bool] = None
    """True if every wrench of the task is proven possible; None without a task."""


def read_vehicle(path: str | Path) -> Vehicle:
    """Read a vehicle from a `.toml` file, or from a `.csv` table of rotors; BadInput names every fault."""
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return validate(Vehicle, {"rotors": _rows(path)}, str(path))
    with as_bad_input(str(path)):
        data = toml_data(load_text(path, most_bytes=LIMITS.task_bytes))
    if isinstance(name := data.get("rotors"), str):
        data = {**data, "rotors": _rows(path.parent / name)}
    return validate(Vehicle, data, str(path))


OF_A_KIT = {"axis_x": "ax", "axis_y": "ay", "axis_z": "az", "thrust_coefficient_Ns2": "k_f"}
OF_A_KIT |= {"torque_coefficient_Nms2": "k_tau", "largest_thrust_N": "thrust"}
"""Columns of a kit's table of rotors, and their names here."""


def _rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table of rotors, with cells that hold numbers converted.

    Columns may be separated by semicolons or tabs, with decimal commas or points. Columns without a name, such as
    an index that pandas writes, and rows without a value are left out.
    """
    head, _, body = load_text(path, most_bytes=LIMITS.task_bytes).partition("\n")
    mark = next((mark for mark in ";\t" if mark in head), ",")
    if mark != "," and "." not in body:
        body = body.replace(",", ".")
    table = csv.DictReader(
        [head, *body.splitlines()], delimiter=mark, skipinitialspace=True, restkey="", restval=""
    )
    heads = [name.strip() for name in table.fieldnames or ()]
    table.fieldnames = names = [OF_A_KIT.get(name, name) for name in heads]
    if not {"x_m", "y_m", "z_m"} <= set(names):
        rule = f"must be a CSV table with columns x_m, y_m, z_m, ..., but its first line is {show(','.join(heads))}"
        raise BadInput(str(path), [Fault("rotors", rule)])
    if twice := [text for text, name in zip(heads, names, strict=True) if name and names.count(name) > 1]:
        rule = f"must have one column per quantity, but has {show(', '.join(twice))}"
        raise BadInput(str(path), [Fault("rotors", rule)])
    rows = list[dict[str, Any]]()
    for line in table:
        if isinstance(beyond := line.pop("", ""), list) and any(beyond):
            rule = f"must have at most {len(names)} cells, one per column, but has {len(names) + len(beyond)}"
            raise BadInput(str(path), [Fault(f"rotors[{len(rows)}]", rule)])
        row = {name: _number(x.strip()) for name, x in line.items() if x and not name.startswith("Unnamed: ")}
        if "thrust" in row:
            thrust, k_f = row["thrust"], row.get("k_f")
            both = isinstance(thrust, int | float) and isinstance(k_f, int | float) and k_f > 0
            row["u_max"] = thrust / k_f if both else thrust  # `validate` refuses the latter
            row = {name: row[name] for name in row if name in VehicleRotor.model_fields}
        rows += [row] if row else []
    return rows


def _number(cell: str) -> Any:
    """Return a table's cell as a number; the cell itself if it is no number."""
    try:
        number = float(cell)
    except ValueError:
        return cell
    return int(number) if number in (-1, 1) else number
