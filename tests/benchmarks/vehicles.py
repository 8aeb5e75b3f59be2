"""Capability of published vehicles against their published figures.

    PYTHONPATH=tests python tests/benchmarks/vehicles.py

Rotors pull 1 N at most, those of the hexacopters 0.41 of the weight. The omnicopter's force is exact for its
published axes, F F^T = 8/3 I, but not stated there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from vehicle_cases import HEXACOPTERS, hexacopter, omnicopter, star

from verify.flight.vehicle import capability

TILTS_DEG = 30.0, 54.735610317245346, 70.0


def rows() -> Iterator[tuple[str, str, float, float]]:
    """Yield vehicle, figure, its published value, and ours."""
    for tilt_deg in TILTS_DEG:
        tilt = math.radians(tilt_deg)
        name = f"star-shaped hexarotor, {tilt_deg:.4g}° (arXiv 2408.12294)"
        volume = 12 * math.sqrt(3) * math.cos(tilt) * math.sin(tilt) ** 2
        yield name, "volume of forces without torque, N³", volume, capability(star(tilt)).zero_torque_volume_N3
    name, ball = "omnicopter without drag (Brescianini and D'Andrea, ICRA 2016)", 2 * math.sqrt(8 / 3)
    yield name, "force in any direction without torque, N", ball, capability(omnicopter(0.0)).zero_torque_ball_N
    for spins, (survived, _) in HEXACOPTERS.items():
        out = capability(hexacopter(spins)).flight.rotors_out_hover
        yield f"hexacopter {spins.upper()} (arXiv 1403.5986)", "survived failures, of 6", survived, out.survive


def main() -> None:
    """Print the table."""
    print("| vehicle | figure | published | `capability` | ratio |")
    print("|---|---|---|---|---|")
    for vehicle, figure, published, ours in rows():
        ratio = f"{ours / published:.7f}" if published else "equal" if ours == 0 else "differs"
        print(f"| {vehicle} | {figure} | {published:.7g} | {ours:.7g} | {ratio} |")


if __name__ == "__main__":
    main()
