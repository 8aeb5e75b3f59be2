"""Failures of a rotor that no platform survives, whatever its angles.

| symbol | meaning | unit |
|---|---|---|
| W | weight of the platform | N |
| s_q | share of rotor q in the thrust of one module | |
| k | drag torque of a rotor over its thrust and the arm, k_tau / (k_f l_arm) | |
"""

from __future__ import annotations

from nlp.bounds.refutation import Refutation, modules
from topo_search.model import ResolvedTask
from topo_search.model.proven import excess_texts
from topo_search.model.tolerances import TOLERANCE

WEAKEST_DRAG = 1e-3
"""Least k with which the argument about one module is made: its shares are then known to a hundredth."""


def failures(task: ResolvedTask) -> Refutation | None:
    """Return why no platform of the task's size hovers with any one rotor dead, if that is asked for.

    With one rotor dead all others pull with (4 n - 1) k_f u_max at most; `peak_input` does not bind them. One
    module pulls along one axis, about which only the drag of rotors turns it. With rotor q dead that is balanced if
    the one across has half of the thrust, s = s' + s'': so the centre of mass is half an arm away from the middle,
    to the side across. With that rotor dead instead it would have to be as far to the other side.
    """
    if task.flight.rotor_out == "none":
        return None
    module, W, n = task.module, task.force_unit(task.n), task.n
    name = "hover, any rotor dead"
    most = (4 * n - 1) * module.thrust_coefficient * module.max_input(task.gravity)
    if most * (1 + 2 * TOLERANCE) < W * (1 - 2 * TOLERANCE):
        weight, pull = excess_texts(W, most)
        return Refutation(
            name,
            W - most,
            "N",
            f"flight.rotor_out: {modules(task)} cannot hover with a rotor dead: all others at their limit pull "
            f"with {pull} N at most, the weight is {weight} N",
        )
    if n == 1 and module.torque_coefficient >= WEAKEST_DRAG * module.thrust_coefficient * module.arm_length:
        return Refutation(
            name,
            1.0,
            "rotors",
            "flight.rotor_out: one module cannot hover with any of its rotors dead: the centre of mass would have "
            "to be half an arm away from its middle, towards the rotor across from the dead one, whichever it is",
        )
    return None
