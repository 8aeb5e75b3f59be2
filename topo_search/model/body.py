"""Rigid parts of a module: shapes or a mesh, and where frames that are bolted together may touch."""

from typing import Annotated, Any

from pydantic import ConfigDict, ValidationInfo, model_validator

from topo_search.limits import LIMITS
from topo_search.model.kinds import NonEmpty, NonNegative, Omitted, Positive, PositiveVector, at_most, omit_if
from topo_search.model.mesh_file import ConvexPiece, frame_of, mesh_schema, take_mesh
from topo_search.model.value import Broken, Value, refuse

INWARDS = 0.2
"""Depth behind the connector's plane to which bolted frames may touch [l_c]: 30 mm for the default module.

A frame as high as the default hub at its connector needs 20 mm when folded by 90 degrees.
"""
OUTWARDS = 0.05
"""The same in front of that plane [l_c]: room for a fitting, 7.5 mm for the default module."""


class Body(Value):
    """Rigid parts of a module: hub and arms as boxes, rotor discs as cylinders."""

    model_config = ConfigDict(json_schema_extra=mesh_schema)

    rotor_radius: Positive = 0.05
    """Radius of a rotor disc [m]."""
    rotor_height: Positive = 0.02
    """Height of a rotor disc [m]."""
    arm_width: Positive = 0.02
    """Width and height of an arm [m]."""
    hub: PositiveVector = (0.08, 0.08, 0.04)
    """Edges of the hub along x, y, z [m]."""
    frame: Omitted[Annotated[tuple[ConvexPiece, ...], at_most(LIMITS.frame_pieces, "pieces"), NonEmpty]] = None
    """Convex pieces that replace hub and arms; a task file may name a `mesh` instead."""
    frame_excess: Annotated[NonNegative, omit_if(0.0)] = 0.0
    """Upper bound for the excess of the pieces over their source mesh [m]."""
    inertia: PositiveVector | None = None
    """Ixx, Iyy, Izz about the module's centre [kg m^2]; default: from the shapes at uniform density."""

    @model_validator(mode="before")
    @classmethod
    def _frame_of_a_mesh(cls, data: Any, info: ValidationInfo) -> Any:
        """Fill in the pieces of a mesh."""
        if not isinstance(data, dict):
            return data
        frame, data = data.get("frame"), dict(data)
        mesh = take_mesh(data, "frame", info.context, frame_of)
        if mesh is None:
            return data
        if frame is not None:
            refuse(("mesh", "must be left out if `frame` is given"))
        pieces, excess = mesh
        return {**data, "frame": pieces, "frame_excess": excess}

    def _broken_rules(self) -> Broken:
        if (triangles := sum(len(piece.triangles) for piece in self.frame or ())) > LIMITS.frame_triangles:
            yield "frame", f"must have at most {LIMITS.frame_triangles:,} triangles in all, but got {triangles:,}"
        if self.frame is not None and self.inertia is None:
            yield "inertia", "must be given with a custom `frame` or `mesh`, but is missing"
        if self.inertia is not None and 2 * max(self.inertia) > sum(self.inertia) * (1 + 1e-12):
            yield "inertia", f"no moment may exceed the sum of the other two, but got {list(self.inertia)}"
