"""Air speed by a jet model: what rotors blow at points, over regions and at each other."""

from verify.air.measured import air, case_jets, speed_residuals

__all__ = ["air", "case_jets", "speed_residuals"]
