"""Best topology of a modular aerial manipulator for a task, with an exact audit of every airflow clearance.

Everything that a script needs is here: functions (`search`, `solve`, `audit`, ...), the classes of tasks, designs
and answers, and the interfaces for your own code (`OwnConstraint`, `OwnSampler`, `OwnFormat`).
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from topo_search.compose import (
        audit,
        compare,
        figure,
        plot_platform,
        prove,
        read_design,
        search,
        solve,
        write_report,
    )
    from topo_search.engine import WorkersLost
    from topo_search.engine.own_sampler import OwnSampler, TopologySampler
    from topo_search.engine.strategy import Candidates, Tried
    from topo_search.export.audits import clearances, residuals
    from topo_search.export.formats import export_design, register_format
    from topo_search.export.own_format import OwnFormat
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
    from topo_search.model.design import Stated, StatedCheck
    from topo_search.model.end_effector import CountedRod
    from topo_search.model.exposure import Allowed, Directional, Exterior, Local, Plane
    from topo_search.model.files import read_json, to_json, to_toml
    from topo_search.model.goals import Goals
    from topo_search.model.load_case import ForceCone
    from topo_search.model.mesh_file import ConvexPiece
    from topo_search.model.reserves import AskedFlight
    from topo_search.model.rotors import ModuleRotor
    from topo_search.model.task_file import read_task
    from topo_search.own_constraint import OwnConstraint, SymbolicPlatform
    from topo_search.report.charts import plot_candidates, plot_front, plot_history
    from topo_search.report.progress import Lines
    from topo_search.study import Answer, LedgerLost, Observer, Row, SizeAnswer, Solved, read_answer

__all__ = [
    "Airflow", "Allowed", "Answer", "AskedFlight", "Audit", "BadInput", "Body", "Bracket", "Candidates",
    "Clearance", "ConvexPiece", "CountedRod", "Design", "Directional", "EndEffector", "Exterior", "Fault",
    "Flight", "ForceCone", "Geometry", "Goals", "Infeasible", "Jet", "LedgerLost", "Lines", "LoadCase", "Local",
    "Module", "ModuleRotor", "Observer", "OwnConstraint", "OwnFormat", "OwnSampler", "Plane", "RegionAirflow",
    "ResolvedTask", "Row", "Search", "SizeAnswer", "Solved", "Stated", "StatedCheck", "Status",
    "SymbolicPlatform", "Task", "Tolerances", "Topology", "TopologySampler", "Tried", "WorkersLost", "Wrench",
    "audit", "clearances", "compare", "export_design", "figure", "plot_candidates", "plot_front", "plot_history",
    "plot_platform", "prove", "read_answer", "read_design", "read_json", "read_task", "register_format",
    "residuals", "search", "solve", "to_json", "to_toml", "write_report",
]  # fmt: skip


for _name in ("nlp", "verify"):  # common names, of which a script's folder may have a file
    _found = getattr(find_spec(_name), "origin", None)
    if _found != str(Path(__file__).parents[1] / _name / "__init__.py"):
        raise ImportError(f"{_found} is in the way of topo_search's own package {_name}: rename it", path=_found)


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the solver and the audit load only if needed (PEP 562)."""
    if name in __all__:
        return getattr(import_module(_defining_modules()[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@cache
def _defining_modules() -> dict[str, str]:
    """Return the module that defines each public name, read from the imports above for type checkers."""
    import ast  # here, since the first process of a command loads this file and little else

    with open(__file__, "rb") as source:
        imports = [node for node in ast.walk(ast.parse(source.read())) if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


def __dir__() -> list[str]:
    return list(__all__)
