"""The assembly sheet of a design: what to bolt to what, at which angle, and the end-effector's rod."""

from __future__ import annotations

from topo_search.model.csv_text import csv_text
from topo_search.model.design import Mount
from topo_search.model.value import Index, Number, Value, Vector


class BoltedJoint(Value):
    """One joint between two modules."""

    module: Index
    """The module that is already there."""
    port: Index
    """Its port: 0..3 for +x, +y, -x, -y."""
    child: Index
    """The module that is bolted to it."""
    child_port: Index
    """The child's port."""
    angle_deg: Number
    """The hinge angle [deg]."""


class Obstacle(Value):
    """What a straight rod would touch."""

    module: Index
    part: str
    """`hub`, `arm 0`, ..., `rotor 3`."""


class FreeConnector(Value):
    """A connector without a joint, as a mount for the end-effector's rod."""

    module: Index
    port: Index
    length_m: Number
    """From the connector to the end-effector [m]."""
    blocked_by: tuple[Obstacle, ...]
    """What is in the way of a straight rod; nothing if it is available."""
    in_airflow_of: tuple[Index, ...] = ()
    """Modules whose airflow a straight rod would pass through."""


class Rod(Value):
    """A straight rod from its mount to the end-effector."""

    length_m: Number
    radius_m: Number
    mass_kg: Number
    """At `end_effector.rod_linear_density`; not part of the model's mass."""
    direction: Vector
    """Unit vector from the connector to the end-effector, in W."""
    direction_in_module: Vector
    """The same in the frame of the module that carries it."""


class EndEffectorSheet(Value):
    """Where the end-effector is, and what holds it there."""

    position_m: Vector
    """p'_E in W [m]."""
    from_com_m: Vector
    """p_E [m]."""
    mount: Mount | None = None
    """The connector that carries the rod; None if no straight rod reaches the end-effector."""
    rod: Rod | None = None
    note: str | None = None
    """What is to be said about the mount."""
    connectors: tuple[FreeConnector, ...] = ()
    """Every free connector, nearest to the end-effector first."""

    @property
    def clear_rod(self) -> bool:
        """Whether the mount's straight rod is clear of all parts and of all airflow."""
        return any(
            (one.module, one.port) == (self.mount.module, self.mount.port)
            for one in self.connectors
            if self.mount is not None and not one.blocked_by and not one.in_airflow_of
        )


class Assembly(Value):
    """The joints in bolting order, every first module being there already, and the end-effector."""

    joints: tuple[BoltedJoint, ...] = ()
    end_effector: EndEffectorSheet | None = None

    @property
    def mount(self) -> Mount | None:
        """The connector that carries the end-effector, if any does."""
        return None if self.end_effector is None else self.end_effector.mount

    def csv(self) -> str:
        """Return the sheet as a table: one row per joint, then one for the rod; its child is the end-effector."""
        head = (
            "step",
            "module",
            "port",
            "child",
            "child_port",
            "angle_deg",
            "rod_length_m",
            "rod_x",
            "rod_y",
            "rod_z",
        )
        rows: list[tuple[object, ...]] = [
            (step, joint.module, joint.port, joint.child, joint.child_port, joint.angle_deg, "", "", "", "")
            for step, joint in enumerate(self.joints, start=1)
        ]
        tip = self.end_effector
        if tip is not None and tip.mount is not None and tip.rod is not None:
            mount = (len(self.joints) + 1, tip.mount.module, tip.mount.port, "end-effector", "", "")
            rows.append((*mount, tip.rod.length_m, *tip.rod.direction_in_module))
        return csv_text(head, rows)
