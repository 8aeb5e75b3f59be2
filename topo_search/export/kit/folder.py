"""The folder of a kit: what is in it, and how it is written again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from topo_search.export.allocation import Allocation, allocation
from topo_search.export.kit.px4 import px4_parameters, too_many
from topo_search.export.mjcf import mjcf
from topo_search.model.bad_input import BadInput, Fault
from topo_search.model.design import Design
from topo_search.model.files import to_json, write_atomically

DESIGN, ALLOCATION, PARAMETERS = "design.json", "allocation.json", "platform.params"
FILES = (DESIGN, ALLOCATION, "allocation.csv", "rotors.csv", PARAMETERS, "platform.xml")
"""What a kit may hold."""


@dataclass(frozen=True)
class Kit:
    """What was written."""

    files: tuple[str, ...]
    """Names in the folder, in the order of writing."""
    notes: tuple[str, ...]
    """What was left out, and why."""


def write_kit(design: Design, folder: Path) -> Kit:
    """Write the kit of a design.

    What an older kit left in the folder goes; `design.json` comes last, so that a folder that has it is whole.

    Raises:
        BadInput: the folder holds something else, or a number is beyond what PX4 takes.
    """
    require_kit_folder(folder)
    acts = allocation(design)
    left_out = too_many(acts)
    notes = () if left_out is None else (f"{PARAMETERS} is left out: {left_out}",)
    contents = dict(_contents(design, acts))
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    names = []
    for name, content in contents.items():
        write_atomically(folder / name, content)
        names.append(name)
    return Kit(tuple(names), notes)


def require_kit_folder(folder: Path) -> None:
    """Refuse a folder whose files are not those of a kit."""
    if folder.exists() and not folder.is_dir():
        raise BadInput("--out", [Fault("", f"must be a folder for --format kit, but got the file {folder}")])
    if not folder.exists():
        return
    if others := sorted(path.name for path in folder.iterdir() if path.name not in FILES):
        rule = f"must be a new or empty folder, or that of a kit, but {folder} holds {others[0]}"
        raise BadInput("--out", [Fault("", rule)])


def _contents(design: Design, acts: Allocation) -> Iterator[tuple[str, str | bytes]]:
    yield ALLOCATION, to_json(acts)
    yield "allocation.csv", acts.csv()
    yield "rotors.csv", acts.rotor_csv()
    if too_many(acts) is None:
        yield PARAMETERS, px4_parameters(acts)
    yield "platform.xml", mjcf(design)
    yield DESIGN, to_json(design)
