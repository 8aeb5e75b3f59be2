"""Build errors that a task names, and those that all clearances of a design tolerate."""

from topo_search.model.clearance import Pair, Status
from topo_search.model.kinds import Angle, NonNegative, Number
from topo_search.model.value import Value

WITHIN_TOLERANCES = "least clearance within the tolerances"
"""Name of the residual of a task that requires its tolerances."""


class Tolerances(Value):
    """Largest build errors of a platform."""

    hinge_angle_deg: Angle = 0.0
    """Error of every hinge angle, in the frame of the module that carries the rod [deg]."""
    position: NonNegative = 0.0
    """Error of the position of every module's centre and the end-effector, in addition to the hinge errors [m]."""
    envelope: NonNegative = 0.0
    """Largest reach of airflow beyond its envelope, in any direction [m]."""


class Limit(Pair):
    """Largest tolerated error of one kind, and the pair that larger errors violate first."""

    tolerated: NonNegative
    """Proven: no error up to this size violates any pair."""
    violated_at: NonNegative | None
    """Shown by an example: some error of this size violates a pair; None if none was found."""


class WorstCase(Pair):
    """Effect of all errors within the task's tolerances, combined, on the most critical pair."""

    status: Status
    """Clear if no such error violates any pair, violated if a known one does, otherwise undecided."""
    lower_m: Number
    """Proven lower bound of the clearance [m]."""
    attained_m: Number
    """Clearance in an example of such errors [m]; the bound is too low by at most the difference."""
    factor: Limit | None
    """Factor by which all tolerances may grow together; None if no factor is too large."""


class Sensitivity(Value):
    """Errors that all clearances of a design tolerate, one kind at a time; None if no size violates any.

    Errors are in the frame of the module that carries the rod.
    """

    hinge_angle_deg: Limit | None
    """Error of every hinge angle [deg]; the end-effector and its regions keep their place at the rod's module."""
    position_m: Limit | None
    """Error of the position of every module's centre and the end-effector [m]."""
    envelope_m: Limit | None
    """Reach of airflow beyond its envelope [m]."""
    tolerances: WorstCase | None = None
    """Effect of the task's tolerances, if it has any."""
