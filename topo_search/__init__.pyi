"""Public names of topo_search and the modules that define them."""

from topo_search.compose import (
    airflow,
    audit,
    capability,
    check,
    compare,
    figure,
    fly,
    plot_platform,
    prove,
    read_design,
    round_angles,
    search,
    solve,
    view,
    write_report,
)
from topo_search.compose.drawer import kit
from topo_search.engine import WorkersLost
from topo_search.engine.own_sampler import OwnSampler, TopologySampler
from topo_search.engine.strategy import Candidates, Tried
from topo_search.export import palette
from topo_search.export.audits import clearances, residuals
from topo_search.export.formats import export_design, register_format
from topo_search.export.kit import write_kit
from topo_search.export.own_format import OwnFormat
from topo_search.export.tree_drawing import draw_tree
from topo_search.model import (
    Audit,
    BadInput,
    Clearance,
    Design,
    EndEffector,
    Fault,
    Flight,
    Geometry,
    Infeasible,
    LoadCase,
    Module,
    ResolvedTask,
    Search,
    Status,
    Task,
    Tolerances,
    Topology,
    Wrench,
)
from topo_search.model.airflow import Airflow, Jet, RegionAirflow
from topo_search.model.body import Body
from topo_search.model.bracket import Bracket
from topo_search.model.end_effector import CountedRod
from topo_search.model.exposure import Allowed, Directional, Exterior, Local, Plane
from topo_search.model.files import read_json, to_json, to_toml
from topo_search.model.goals import Goals
from topo_search.model.load_case import ForceCone
from topo_search.model.mesh_file import ConvexPiece
from topo_search.model.module_types import ModuleType
from topo_search.model.reserves import AskedFlight
from topo_search.model.rotors import ModuleRotor
from topo_search.model.stated import Stated, StatedCheck
from topo_search.own_constraint import OwnConstraint, SymbolicPlatform
from topo_search.report.cell import Picture, View
from topo_search.report.charts import plot_candidates, plot_front, plot_history
from topo_search.report.on_axes import draw
from topo_search.report.progress import Lines
from topo_search.report.task_warnings import SuspiciousTask, read_task
from topo_search.study import Answer, LedgerLost, Observer, Row, SilentObserver, SizeAnswer, Solved, read_answer
from verify.kinematics import platform

__all__ = [
    "Airflow", "Allowed", "Answer", "AskedFlight", "Audit", "BadInput", "Body", "Bracket", "Candidates",
    "Clearance", "ConvexPiece", "CountedRod", "Design", "Directional", "EndEffector", "Exterior", "Fault",
    "Flight", "ForceCone", "Geometry", "Goals", "Infeasible", "Jet", "LedgerLost", "Lines", "LoadCase",
    "Local", "Module", "ModuleRotor", "ModuleType", "Observer", "OwnConstraint", "OwnFormat", "OwnSampler",
    "Picture", "Plane", "RegionAirflow", "ResolvedTask", "Row", "Search", "SilentObserver", "SizeAnswer",
    "Solved", "Stated", "StatedCheck", "Status", "SuspiciousTask", "SymbolicPlatform", "Task", "Tolerances",
    "Topology", "TopologySampler", "Tried", "View", "WorkersLost", "Wrench", "airflow", "audit", "capability",
    "check", "clearances", "compare", "draw", "draw_tree", "export_design", "figure", "fly", "kit", "palette",
    "platform", "plot_candidates", "plot_front", "plot_history", "plot_platform", "prove", "read_answer",
    "read_design", "read_json", "read_task", "register_format", "residuals", "round_angles", "search", "solve",
    "to_json", "to_toml", "view", "write_kit", "write_report",
]  # fmt: skip
