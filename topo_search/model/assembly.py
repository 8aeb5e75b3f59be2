"""Assembly sheet of a design: joints in bolting order, and the end-effector with its rod, or a shorter one."""

from topo_search.model.end_effector import Mount
from topo_search.model.kinds import Index, Number, Vector
from topo_search.model.proven import lower_text, upper_text
from topo_search.model.text import csv_text
from topo_search.model.value import Value


class BoltedJoint(Value):
    """Joint between two modules."""

    module: Index
    """Module that is already in place."""
    port: Index
    """Its port: 0..3 for +x, +y, -x, -y."""
    child: Index
    """Module that is bolted to it."""
    child_port: Index
    """The child's port."""
    angle_deg: Number
    """Hinge angle [deg]."""


class Obstacle(Value):
    """Part that a straight rod would touch."""

    module: Index
    part: str
    """`hub`, `arm 0`, ..., `rotor 3`."""


class FreeConnector(Mount):
    """Connector without a joint, a possible mount for the end-effector's rod."""

    length_m: Number
    """From the connector to the end-effector [m]."""
    blocked_by: tuple[Obstacle, ...]
    """Obstacles to a straight rod; empty if it is available."""
    in_airflow_of: tuple[Index, ...] = ()
    """Modules whose airflow a straight rod would pass through."""


class Rod(Value):
    """Straight rod from its mount to the end-effector."""

    length_m: Number
    radius_m: Number
    mass_kg: Number
    """Mass by `end_effector.rod_linear_density` [kg]; part of the platform's mass with `rod_mass = "included"`."""
    direction: Vector
    """Unit vector from the connector to the end-effector, in W."""
    direction_in_module: Vector
    """The same direction in the frame of the module that carries the rod."""


class EndEffectorSheet(Value):
    """Position of the end-effector, and its mount."""

    position_m: Vector
    """p'_E in W [m]."""
    from_com_m: Vector
    """p_E [m]."""
    mount: Mount | None = None
    """Connector that carries the rod; None if no straight rod reaches the end-effector."""
    rod: Rod | None = None
    note: str | None = None
    """Remark on the mount."""
    connectors: tuple[FreeConnector, ...] = ()
    """Every free connector, nearest to the end-effector first."""

    @property
    def clear_rod(self) -> bool:
        """True if the mount's straight rod is clear of all parts and of all airflow."""
        return any(
            (connector.module, connector.port) == (self.mount.module, self.mount.port)
            for connector in self.connectors
            if self.mount is not None and not connector.blocked_by and not connector.in_airflow_of
        )


class ShorterRod(Value):
    """Cost of a rod shorter than that of the design."""

    length_m: Number
    """Length of the shorter rod [m]."""
    cost: Number | None
    """Relative increase of the effort; None if no design with that rod was found from this one."""

    @property
    def words(self) -> str:
        """Cost in words."""
        if self.cost is None:
            return f"no design with a rod of at most {lower_text(self.length_m, 3)} m was reached from this one"
        cost = f"{100 * self.cost:.2g} % control effort"
        return f"a rod of at most {upper_text(self.length_m, 3)} m adds {cost}, solved from this design"


class Assembly(Value):
    """Joints in bolting order, so that `module` is always in place already, and the end-effector."""

    joints: tuple[BoltedJoint, ...] = ()
    end_effector: EndEffectorSheet | None = None

    @property
    def mount(self) -> Mount | None:
        """Connector that carries the end-effector, if any."""
        return None if self.end_effector is None else self.end_effector.mount

    def csv(self) -> str:
        """Return the sheet as CSV: one row per joint, then one for the rod, whose child is the end-effector."""
        joint_columns = ("step", "module", "port", "child", "child_port", "angle_deg")
        rows: list[tuple[object, ...]] = [
            (step, joint.module, joint.port, joint.child, joint.child_port, joint.angle_deg, "", "", "", "")
            for step, joint in enumerate(self.joints, start=1)
        ]
        tip = self.end_effector
        if tip is not None and tip.mount is not None and tip.rod is not None:
            mount = (len(self.joints) + 1, tip.mount.module, tip.mount.port, "end-effector", "", "")
            rows.append((*mount, tip.rod.length_m, *tip.rod.direction_in_module))
        return csv_text((*joint_columns, "rod_length_m", "rod_x", "rod_y", "rod_z"), rows)
