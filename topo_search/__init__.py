"""Best topology of a modular aerial manipulator for a task, with an exact audit of every airflow clearance.

Everything that a script needs is here: functions (`search`, `solve`, `audit`, ...), the classes of tasks, designs
and answers, and the interfaces for your own code (`OwnConstraint`, `OwnSampler`, `OwnFormat`).
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

for _name in ("nlp", "verify"):  # common names, of which a script's folder may have a file
    _found = getattr(find_spec(_name), "origin", None)
    if _found != str(Path(__file__).parents[1] / _name / "__init__.py"):
        raise ImportError(f"{_found} is in the way of topo_search's own package {_name}: rename it", path=_found)


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the solver and the audit load only if needed (PEP 562)."""
    if name == "__all__":
        return __dir__()
    if name in _defining_modules():
        return getattr(import_module(_defining_modules()[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@cache
def _defining_modules() -> dict[str, str]:
    """Return the module that defines each public name, from the stub that type checkers read."""
    import ast  # here, since the first process of a command loads this file and little else

    nodes = ast.parse(Path(__file__).with_suffix(".pyi").read_bytes()).body
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


def __dir__() -> list[str]:
    return sorted(_defining_modules())
