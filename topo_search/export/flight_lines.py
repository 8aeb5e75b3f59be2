"""What a design can do beyond its task, a line each: the same wherever a person reads it."""

from __future__ import annotations

from collections.abc import Iterator

from topo_search.model import Flight, RotorsOut
from topo_search.model.flight import direction
from topo_search.model.proven import lower_text, upper_text

NAMED = 8
"""Most rotors that are named one by one."""


def flight_lines(found: Flight) -> Iterator[str]:
    """Yield the lines, the weakest point first; what is proven is rounded to the safe side."""
    yield found.weakest_point
    hover = found.hover
    if hover.torque_reserve_Nm is not None and hover.torque_weakest is not None:
        least = f"{lower_text(hover.torque_reserve_Nm, 3)} N m about {direction(hover.torque_weakest)}"
        yield f"least torque that can be added in hover: {least}"
    factors = [(case.load_factor, case.name) for case in found.cases if case.load_factor is not None]
    if factors:
        factor, name = min(factors)
        yield f"load factor until a rotor saturates: {lower_text(factor, 4)}, in {name}"
    yield f"hover with one rotor dead: {_rotors_out(found.rotors_out_hover)}"
    yield f"hover and all load cases with one rotor dead: {_rotors_out(found.rotors_out_all)}"
    stated = [load for load in found.joints if load.case != hover.name]
    if stated:
        worst = max(stated, key=lambda load: load.moment_Nm)
        size = f"{upper_text(worst.moment_Nm, 3)} N m and {upper_text(worst.force_N, 3)} N"
        yield f"largest moment in a joint: {size}, between modules {worst.module} and {worst.child} in {worst.case}"
    if found.hover_input is not None and found.hover_power_ratio is not None:
        yield (
            f"hover takes {100 * found.hover_input:.3g} % of the largest input on average, and "
            f"{found.hover_power_ratio:.3g} times the power of rotors that all pull straight up"
        )
    yield f"the platform spans {found.span_m:.3g} m"


def _rotors_out(out: RotorsOut) -> str:
    told = f"survives {out.survive} of {out.of}"
    if 0 < len(out.lost) <= NAMED:
        told += f", not {_rotors(out.lost)}"
    return f"{told}, undecided {_rotors(out.undecided)}" if out.undecided else told


def _rotors(which: tuple[tuple[int, int], ...]) -> str:
    """Name rotors by module and number."""
    if len(which) > NAMED:
        return f"{len(which)} rotors"
    return ", ".join(f"rotor {rotor} of module {module}" for module, rotor in which)
