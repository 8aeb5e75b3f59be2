"""Air speed by a jet model: what rotors blow at points, over regions and at each other."""

from verify.air.bound import air, case_jets, speed_residuals
from verify.air.envelope import Unreached, enclose, envelope_air

__all__ = ["Unreached", "air", "case_jets", "enclose", "envelope_air", "speed_residuals"]
