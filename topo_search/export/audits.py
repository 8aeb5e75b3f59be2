"""Audits to share: lines for a reader, and data frames with their CSV and Parquet files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from pydantic import BaseModel

from topo_search.model import Audit, Capability, Clearance, Flight, Residual, RotorsOut, Status
from topo_search.model.flight import direction
from topo_search.model.proven import lower_text, upper_text

if TYPE_CHECKING:
    import pandas as pd

NAMED_ROTORS = 8
"""Largest number of rotors listed by name; of more only the count is given."""


def broken_lines(audit: Audit) -> Iterator[str]:
    """Yield a line for each requirement that is not clear, with the shortfall in its unit."""
    for pair in audit.pairs:
        if pair.status != Status.CLEAR:
            yield f"{pair.name}: {pair.status}, {lower_text(1000 * pair.analytic_m, 3)} mm"
            yield from (f"  {line}" for line in pair.evidence)
    for row in audit.residuals:
        if row.status != Status.CLEAR:
            yield f"{row.words}: {row.status}, off by {upper_text(row.value, 3)} {row.unit}"


def summary_lines(audit: Audit) -> Iterator[str]:
    """Yield the closest pair, the side force, tilt and rotor failures in hover, and the load, one per line."""
    if audit.pairs:
        nearest = min(audit.pairs, key=lambda pair: pair.analytic_m)
        yield f"closest pair: {nearest.name}, {lower_text(1000 * nearest.analytic_m, 3)} mm"
    if (flight := audit.flight) is None:
        return
    hover = flight.hover
    if not hover.possible:
        yield flight.weakest_point
        return
    if (at_tip := hover.horizontal_reserve_N) is not None:
        towards = "" if hover.horizontal_weakest is None else f" towards {direction(hover.horizontal_weakest)}"
        yield f"side force in hover: {lower_text(at_tip, 3)} N at the tip{towards}"
    if hover.tilt_deg is not None:
        yield f"tilt in hover: up to {lower_text(hover.tilt_deg, 3)} degrees"
    yield f"rotor failures in hover: {_rotors_out(flight.rotors_out_hover, 'can only hover', named=False)}"
    factors = [(case.load_factor, case.name) for case in flight.cases if case.load_factor is not None]
    if factors:
        factor, name = min(factors)
        yield f"load until a rotor saturates: {lower_text(factor, 3)} times {name}"


def flight_lines(flight: Flight) -> Iterator[str]:
    """Yield lines on a design in flight, the weakest point first; proven figures are rounded to the safe side."""
    yield flight.weakest_point
    hover = flight.hover
    if hover.torque_reserve_Nm is not None and hover.torque_weakest is not None:
        weakest = f"{lower_text(hover.torque_reserve_Nm, 3)} N m about {direction(hover.torque_weakest)}"
        yield f"torque reserve in hover, any axis: {weakest}"
    if hover.force_reserve_com_N is not None and hover.force_weakest_com is not None:
        weakest = f"{lower_text(hover.force_reserve_com_N, 3)} N towards {direction(hover.force_weakest_com)}"
        yield f"force reserve at the centre of mass in hover, any direction: {weakest}"
    if hover.tilt_deg is not None:
        yield f"hover can be held at any tilt up to {lower_text(hover.tilt_deg, 3)} degrees"
    if hover.com_error_m is not None:
        error = lower_text(1e3 * hover.com_error_m, 3)
        yield f"hover can be held with the centre of mass off by up to {error} mm along each axis"
    if hover.angular_acceleration_rad_s2 is not None:
        sizes = ", ".join(lower_text(a, 3) for a in hover.angular_acceleration_rad_s2)
        yield f"angular acceleration in hover, about x, y and z: {sizes} rad/s²"
    if (at_com := hover.horizontal_reserve_com_N_pseudo_inverse) is not None:
        at_tip, tilt = hover.horizontal_reserve_N_pseudo_inverse or 0.0, hover.tilt_deg_pseudo_inverse or 0.0
        yield (
            f"by the pseudo-inverse alone, in hover: side force of {lower_text(at_tip, 3)} N at the tip and "
            f"{lower_text(at_com, 3)} N at the centre of mass, tilt of {lower_text(tilt, 3)} degrees"
        )
    factors = [(case.load_factor, case.name) for case in flight.cases if case.load_factor is not None]
    if factors:
        factor, name = min(factors)
        yield f"load factor until a rotor saturates: {lower_text(factor, 4)}, in {name}"
    dead = "with one rotor known to be dead"
    yield f"hover {dead}: {_rotors_out(flight.rotors_out_hover, 'can only hover')}"
    yield f"hover and all load cases {dead}: {_rotors_out(flight.rotors_out_all, 'without control')}"
    loads = [load for load in flight.joints if load.case != hover.name]
    if loads:
        worst = max(loads, key=lambda load: load.moment_Nm)
        size = f"{upper_text(worst.moment_Nm, 3)} N m and {upper_text(worst.force_N, 3)} N"
        yield f"largest moment in a joint: {size}, between modules {worst.module} and {worst.child} in {worst.case}"
    if count := flight.joints_in_cycles:
        yield f"moments in the {count} joints of cycles are statically indeterminate, and not computed"
    if flight.hover_input is not None and flight.hover_power_excess is not None:
        yield (
            f"hover takes {100 * flight.hover_input:.3g} % of the largest input on average, and "
            f"{flight.hover_power_excess:.3g} % more power than with all rotors pointing straight up"
        )
    yield f"the platform spans {flight.span_m:.3g} m"


def forces_without_torque(capability: Capability) -> Iterator[str]:
    """Yield a line on the forces that a vehicle can exert without torque, if there is such a set."""
    ball, volume = capability.zero_torque_ball_N, capability.zero_torque_volume_N3
    if volume:
        size = f"any of {lower_text(ball, 5)} N, and a set" if ball else "a set"
        yield f"forces without torque: {size} of {lower_text(volume, 5)} N³"


def _rotors_out(out: RotorsOut, uncontrolled: str, *, named: bool = True) -> str:
    words = f"survives {out.survive} of {out.of}"
    if named and 0 < len(out.lost) <= NAMED_ROTORS:
        words += f", not {_rotors(out.lost)}"
    words += f", undecided {_rotors(out.undecided)}" if out.undecided else ""
    return f"{words}; {uncontrolled}: {out.hover_only}" if out.hover_only else words


def _rotors(rotors: tuple[tuple[int, int], ...]) -> str:
    if len(rotors) > NAMED_ROTORS:
        return f"{len(rotors)} rotors"
    return ", ".join(f"rotor {rotor} of module {module}" for module, rotor in rotors)


def clearances(audit: Audit) -> pd.DataFrame:
    """Return a data frame with a row for every clearance of an audit [m]; columns are the fields of `Clearance`.

    The fields `evidence` and `closest_m` are left out: they are not single values.

    Example:
        >>> from topo_search import clearances, read_answer
        >>> frame = clearances(read_answer("hover-2").audit)
        >>> list(frame["kind"].unique()[:2])
        ['airflow', 'exclusion']
    """
    return clearances_of([("", audit)]).drop(columns="design")


def clearances_of(audits: Sequence[tuple[str, Audit]]) -> pd.DataFrame:
    """Return the clearances of several named audits; the column `design` holds the name, `rotor` is the last."""
    numbers = dict.fromkeys(("lower_m", "upper_m", "analytic_m", "percent"), "float64")
    frame = _frame(Clearance, (pair for _, audit in audits for pair in audit.pairs))
    frame = frame.astype({**numbers, "segment": "Int64", "rotor": "Int64"})
    rotor = frame.pop("rotor")
    frame = frame.drop(columns=["contact", "evidence", "closest_m"])
    return frame.assign(design=[name for name, audit in audits for _ in audit.pairs], rotor=rotor)


def residuals(audit: Audit) -> pd.DataFrame:
    """Return a data frame with a row for every number that an audit checked; columns are the fields of `Residual`.

    Example:
        >>> from topo_search import read_answer, residuals
        >>> residuals(read_answer("hover-2").audit)["name"][0]
        'load case 0, force'
    """
    return _frame(Residual, audit.residuals).astype({"stated": "float64", "derived": "float64"})


def csv(frame: pd.DataFrame) -> str:
    """Return a data frame as the text of a CSV file; unknown values are empty."""
    return frame.to_csv(index=False, lineterminator="\n")


def parquet(frame: pd.DataFrame) -> bytes:
    """Return a data frame as the content of a Parquet file; columns without numbers are texts, even if empty.

    Raises:
        ModuleNotFoundError: pyarrow is not installed.
    """
    import pyarrow  # noqa: F401 (pandas would raise another exception if it is missing)

    texts = frame.select_dtypes(exclude="number").columns
    return frame.astype(dict.fromkeys(texts, "string")).to_parquet(None, engine="pyarrow", index=False)


def _frame(kind: type[BaseModel], values: Iterable[BaseModel]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame([value.model_dump(mode="json") for value in values], columns=list(kind.model_fields))
