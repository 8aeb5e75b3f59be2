"""Air speed by a jet model: what rotors blow at points, over regions and at each other."""

from verify.air.measured import air, speed_residuals

__all__ = ["air", "speed_residuals"]
