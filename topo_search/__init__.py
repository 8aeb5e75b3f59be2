"""Best topology of a modular aerial manipulator for a task, with an exact audit of every airflow clearance."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from topo_search.compose import audit, figure, search, solve, write_report
    from topo_search.export.tables import clearances, residuals
    from topo_search.model import Design, Task, Topology
    from topo_search.model.files import read_json, read_task

__all__ = [
    "Design",
    "Task",
    "Topology",
    "audit",
    "clearances",
    "figure",
    "read_json",
    "read_task",
    "residuals",
    "search",
    "solve",
    "write_report",
]

_HOMES = {
    "Design": "topo_search.model",
    "Task": "topo_search.model",
    "Topology": "topo_search.model",
    "audit": "topo_search.compose",
    "clearances": "topo_search.export.tables",
    "figure": "topo_search.compose",
    "read_json": "topo_search.model.files",
    "read_task": "topo_search.model.files",
    "residuals": "topo_search.export.tables",
    "search": "topo_search.compose",
    "solve": "topo_search.compose",
    "write_report": "topo_search.compose",
}


def __getattr__(name: str) -> Any:
    """Load the solver and the audit when they are first asked for (PEP 562)."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
