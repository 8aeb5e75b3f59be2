"""The folder of a kit: what is in it, and how it is written again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from topo_search.export.allocation import allocation, allocator_file, px4_parameters, px4_warnings, reason_against
from topo_search.export.brackets import printed_parts
from topo_search.export.mjcf import AS_SEARCHED, Physics, mjcf
from topo_search.export.sheet import mass_note, parts_csv, parts_list, sheet
from topo_search.model.design import Design
from topo_search.model.files import to_json, write_atomically
from topo_search.model.value import BadInput

DESIGN, ALLOCATION, PARAMETERS = "design.json", "allocation.json", "platform.params"
SHEET, PARTS, BRACKETS = "assembly.html", "parts.csv", "brackets"
FILES = (
    DESIGN,
    ALLOCATION,
    "allocation.csv",
    "rotors.csv",
    "allocator.py",
    PARAMETERS,
    SHEET,
    PARTS,
    "platform.xml",
)
"""Files of a kit, besides the folder of brackets."""


class Kit(NamedTuple):
    """Files that were written."""

    files: tuple[str, ...]
    """Names in the folder, in the order of writing."""
    notes: tuple[str, ...]
    """Files that were left out, with the reasons, what PX4 cannot do, and the mass of all parts."""


def write_kit(design: Design, folder: Path, notes: Sequence[str] = (), physics: Physics = AS_SEARCHED) -> Kit:
    """Write the kit of a design.

    What an older kit left in the folder goes; `design.json` comes last, so that a folder that has it is whole.

    Args:
        design: the design.
        folder: where to.
        notes: what the assembly sheet says first.
        physics: what the model for MuJoCo has beyond that of the search.

    Raises:
        BadInput: the folder holds something else, a number is beyond what PX4 takes, or brackets do not fit.
    """
    require_kit_folder(folder)
    acts, solids = allocation(design), printed_parts(design)
    left_out = reason_against(acts)
    kit_notes = px4_warnings(acts) if left_out is None else (f"{PARAMETERS} is left out: {left_out}",)
    kit_notes = (*kit_notes, mass_note(design.task, parts_list(design, solids)))
    contents: dict[str, str | bytes] = {
        ALLOCATION: to_json(acts),
        "allocation.csv": acts.csv(),
        "rotors.csv": acts.rotor_csv(),
        "allocator.py": allocator_file(design, acts),
        **({} if left_out else {PARAMETERS: px4_parameters(acts)}),
        **{f"{BRACKETS}/{part.file}": part.stl() for part in solids},
        PARTS: parts_csv(parts_list(design, solids)),
        SHEET: sheet(design, solids, (*notes, *kit_notes)),
        "platform.xml": mjcf(design, physics),
        DESIGN: to_json(design),
    }
    for old in (*(folder / name for name in FILES), *(folder / BRACKETS).glob("*.stl")):
        old.unlink(missing_ok=True)
    for name, content in contents.items():
        write_atomically(folder / name, content)
    return Kit(tuple(contents), kit_notes)


def write_brackets(design: Design, folder: Path) -> tuple[str, ...]:
    """Write the brackets and the rod's mount alone, in place of all STL files of a folder; return their names.

    Raises:
        BadInput: the folder holds something else, or brackets do not fit.
    """
    _require_only(folder, lambda path: path.suffix == ".stl", "a new or empty folder, or one of STL files")
    parts = printed_parts(design)
    for old in folder.glob("*.stl"):
        old.unlink()
    for part in parts:
        write_atomically(folder / part.file, part.stl())
    return tuple(part.file for part in parts)


PIECES: dict[str, Callable[[Design, Sequence[str]], str]] = {
    "allocation": lambda design, _: allocation(design).csv(),
    "rotors": lambda design, _: allocation(design).rotor_csv(),
    "px4": lambda design, _: px4_parameters(allocation(design)),
    "sheet": lambda design, notes: sheet(design, printed_parts(design), notes),
    "parts": lambda design, _: parts_csv(parts_list(design, printed_parts(design))),
}
"""Parts of a kit that are one file of a design, with notes that a sheet says first."""


def require_kit_folder(folder: Path) -> None:
    """Refuse a folder whose files are not those of a kit."""
    _require_only(folder, lambda path: path.name in (*FILES, BRACKETS), "a new or empty folder, or that of a kit")


def _require_only(folder: Path, known: Callable[[Path], bool], what: str) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise BadInput("--out", f"must be a folder for this format, but got the file {folder}")
    if others := sorted(path.name for path in folder.iterdir() if not known(path)):
        raise BadInput("--out", f"must be {what}, but {folder} holds {others[0]}")
