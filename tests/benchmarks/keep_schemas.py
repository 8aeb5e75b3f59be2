"""Update the JSON schemas of input and output files, which the package ships and the site shows.

    python tests/benchmarks/keep_schemas.py

Writes `topo_search/schemas/NAME.json` from the models that read and write the files.
"""

from __future__ import annotations

import json
from pathlib import Path

from topo_search.compose.shared_kit import SharedKit
from topo_search.export.allocation import Allocation
from topo_search.model import Audit, Design, Task
from topo_search.model.files import write_atomically
from topo_search.model.relaxed import Relaxed
from topo_search.model.vehicle import Capability
from topo_search.simulation.result import FlightResult

FOLDER = Path(__file__).parents[2] / "topo_search/schemas"
MODELS = {
    "task": Task,
    "design": Design,
    "audit": Audit,
    "relaxed": Relaxed,
    "allocation": Allocation,
    "flight": FlightResult,
    "capability": Capability,
    "kit": SharedKit,
}


def schemas() -> dict[str, str]:
    """Return the text of every schema by name."""
    return {name: json.dumps(model.model_json_schema(), indent=1) + "\n" for name, model in MODELS.items()}


def main() -> None:
    """Write all schemas."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in schemas().items():
        write_atomically(FOLDER / f"{name}.json", text)


if __name__ == "__main__":
    main()
