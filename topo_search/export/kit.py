"""The folder of a kit: what is in it, and how it is written again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from topo_search.export.allocation import Allocation, allocation
from topo_search.export.allocator_file import allocator_file
from topo_search.export.brackets import Part, brackets, mount, struts
from topo_search.export.mjcf import mjcf
from topo_search.export.px4 import px4_parameters, px4_warnings, reason_against
from topo_search.export.sheet import Row, mass_note, parts_csv, parts_list, sheet
from topo_search.export.simulator_xml import AS_SEARCHED, Physics
from topo_search.model.bad_input import BadInput, Fault
from topo_search.model.design import Design
from topo_search.model.files import to_json, write_atomically

DESIGN, ALLOCATION, PARAMETERS = "design.json", "allocation.json", "platform.params"
ALLOCATOR = "allocator.py"
SHEET, PARTS, BRACKETS = "assembly.html", "parts.csv", "brackets"
FILES = (DESIGN, ALLOCATION, "allocation.csv", "rotors.csv", ALLOCATOR, PARAMETERS, SHEET, PARTS, "platform.xml")
"""Files of a kit, besides the folder of brackets."""


@dataclass(frozen=True)
class Kit:
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
    acts = allocation(design)
    left_out = reason_against(acts)
    parts = brackets(design), mount(design), struts(design)
    rows = parts_list(design, *parts)
    own = px4_warnings(acts) if left_out is None else (f"{PARAMETERS} is left out: {left_out}",)
    own = (*own, mass_note(rows))
    contents = dict(_contents(design, acts, parts, rows, (*notes, *own), physics))
    for old in (*(folder / name for name in FILES), *(folder / BRACKETS).glob("*.stl")):
        old.unlink(missing_ok=True)
    for name, content in contents.items():
        write_atomically(folder / name, content)
    return Kit(tuple(contents), own)


def write_brackets(design: Design, folder: Path) -> tuple[str, ...]:
    """Write the brackets and the rod's mount alone, in place of all STL files of a folder; return their names.

    Raises:
        BadInput: the folder holds something else, or brackets do not fit.
    """
    _require_only(folder, lambda path: path.suffix == ".stl", "a new or empty folder, or one of STL files")
    held = mount(design)
    parts = [*brackets(design), *([] if held is None else [held]), *struts(design)]
    for old in folder.glob("*.stl"):
        old.unlink()
    for part in parts:
        write_atomically(folder / part.file, part.stl())
    return tuple(part.file for part in parts)


def write_part(
    design: Design,
    kind: Literal["allocation", "rotors", "px4", "sheet", "parts"],
    out: Path,
    notes: Sequence[str] = (),
) -> tuple[str, ...]:
    """Write a part of the kit that is one file; an allocation whose name ends in .json as JSON, else as a table.

    A sheet says the notes first. Returns what PX4 cannot do, where that is the part.

    Raises:
        BadInput: there are more rotors than PX4 takes, a number is beyond its range, or brackets do not fit.
    """
    warnings: tuple[str, ...] = ()
    if kind in ("sheet", "parts"):
        joints, held = brackets(design), mount(design)
        rows = parts_list(design, joints, held, struts(design))
        text = parts_csv(rows) if kind == "parts" else sheet(design, joints, held, rows, notes)
    else:
        acts = allocation(design)
        table = px4_parameters if kind == "px4" else Allocation.rotor_csv if kind == "rotors" else Allocation.csv
        text = to_json(acts) if kind == "allocation" and out.suffix.lower() == ".json" else table(acts)
        warnings = px4_warnings(acts) if kind == "px4" else ()
    write_atomically(out, text)
    return warnings


def require_kit_folder(folder: Path) -> None:
    """Refuse a folder whose files are not those of a kit."""
    _require_only(folder, lambda path: path.name in (*FILES, BRACKETS), "a new or empty folder, or that of a kit")


def _require_only(folder: Path, known: Callable[[Path], bool], what: str) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise BadInput("--out", [Fault("", f"must be a folder for this format, but got the file {folder}")])
    if others := sorted(path.name for path in folder.iterdir() if not known(path)):
        raise BadInput("--out", [Fault("", f"must be {what}, but {folder} holds {others[0]}")])


def _contents(
    design: Design,
    acts: Allocation,
    parts: tuple[Sequence[Part], Part | None, Sequence[Part]],
    rows: Sequence[Row],
    notes: Sequence[str],
    physics: Physics,
) -> Iterator[tuple[str, str | bytes]]:
    yield ALLOCATION, to_json(acts)
    yield "allocation.csv", acts.csv()
    yield "rotors.csv", acts.rotor_csv()
    yield ALLOCATOR, allocator_file(design, acts)
    if reason_against(acts) is None:
        yield PARAMETERS, px4_parameters(acts)
    joints, held, arms = parts
    for part in (*joints, *([] if held is None else [held]), *arms):
        yield f"{BRACKETS}/{part.file}", part.stl()
    yield PARTS, parts_csv(rows)
    yield SHEET, sheet(design, joints, held, rows, notes)
    yield "platform.xml", mjcf(design, physics)
    yield DESIGN, to_json(design)
