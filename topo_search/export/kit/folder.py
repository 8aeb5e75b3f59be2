"""The folder of a kit: what is in it, and how it is written again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from topo_search.export.allocation import allocation
from topo_search.export.mjcf import mjcf
from topo_search.model.bad_input import BadInput, Fault
from topo_search.model.design import Design
from topo_search.model.files import to_json, write_atomically

DESIGN, ALLOCATION = "design.json", "allocation.json"
FILES = (DESIGN, ALLOCATION, "allocation.csv", "rotors.csv", "platform.xml")
"""What a kit may hold."""


def write_kit(design: Design, folder: Path) -> tuple[str, ...]:
    """Write the kit of a design and return the names of its files, in the order of writing.

    What an older kit left in the folder goes; `design.json` comes last, so that a folder that has it is whole.

    Raises:
        BadInput: the folder holds something else.
    """
    require_kit_folder(folder)
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    names = []
    for name, content in _contents(design):
        write_atomically(folder / name, content)
        names.append(name)
    return tuple(names)


def require_kit_folder(folder: Path) -> None:
    """Refuse a folder whose files are not those of a kit."""
    if folder.exists() and not folder.is_dir():
        raise BadInput("--out", [Fault("", f"must be a folder for --format kit, but got the file {folder}")])
    if not folder.exists():
        return
    if others := sorted(path.name for path in folder.iterdir() if path.name not in FILES):
        rule = f"must be a new or empty folder, or that of a kit, but {folder} holds {others[0]}"
        raise BadInput("--out", [Fault("", rule)])


def _contents(design: Design) -> Iterator[tuple[str, str | bytes]]:
    acts = allocation(design)
    yield ALLOCATION, to_json(acts)
    yield "allocation.csv", acts.csv()
    yield "rotors.csv", acts.rotor_csv()
    yield "platform.xml", mjcf(design)
    yield DESIGN, to_json(design)
