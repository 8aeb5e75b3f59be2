"""The file `allocator.py` of a kit: the source of `topo_search.export.allocator` with the data of a platform."""

from __future__ import annotations

import re
from pathlib import Path
from pprint import pformat

from topo_search.export import allocator
from topo_search.export.allocation import Allocation
from topo_search.model.design import Design

TORQUE_FIRST = 10.0
"""Weight of a missing torque, per l_arm, beside that of a missing force: who turns away loses forces as well."""


def allocator_file(design: Design, acts: Allocation) -> str:
    """Return the text of the file.

    Args:
        design: the design.
        acts: how its rotors act on it.
    """
    module, weight = design.task.module, acts.mass_kg * design.task.gravity
    data = {
        "PLATFORM": f"{design.task.name}, {design.topology.key}",
        "NAMES": tuple(rotor.name for rotor in acts.rotors),
        "MATRIX": acts.thrust_matrix,
        "LEAST": tuple(rotor.thrust_coefficient * acts.least_input for rotor in acts.rotors),
        "LARGEST": tuple(rotor.largest_thrust_N for rotor in acts.rotors),
        "SCALE": (1 / weight,) * 3 + (TORQUE_FIRST / (module.arm_length * weight),) * 3,
        "FULL": module.thrust_coefficient * acts.largest_input,
        "WEIGHT": weight,
        "THRUST_COEFFICIENT": module.thrust_coefficient,
    }

    def value(line: re.Match[str]) -> str:
        return f"{line[1]} = {pformat(data[line[2]], width=110, compact=True)}"

    source = Path(allocator.__file__).read_text(encoding="utf-8")
    return re.sub(rf"^(({'|'.join(data)}): [^=\n]+) = .*$", value, source, flags=re.MULTILINE)
