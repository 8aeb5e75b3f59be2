"""The folder of a kit: its files, and how they are written and replaced."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from topo_search.export.allocation import allocation, allocator_file, px4_parameters, px4_warnings, reason_against
from topo_search.export.brackets import printed_parts
from topo_search.export.mjcf import AS_SEARCHED, Physics, mjcf
from topo_search.export.sheet import mass_note, parts_csv, parts_list, sheet, strength_note, struts_note
from topo_search.export.sheet_pdf import sheet_pdf
from topo_search.model import BadInput, Design
from topo_search.model.files import to_json, write_atomically

DESIGN, ALLOCATION, PARAMETERS = "design.json", "allocation.json", "platform.params"
SHEET, PRINTED_SHEET, PARTS, BRACKETS = "assembly.html", "assembly.pdf", "parts.csv", "brackets"
FILES = (
    DESIGN,
    ALLOCATION,
    "allocation.csv",
    "rotors.csv",
    "allocator.py",
    PARAMETERS,
    SHEET,
    PRINTED_SHEET,
    PARTS,
    "platform.xml",
)
"""Names of the files of a kit; the folder `BRACKETS` holds the rest."""


class Kit(NamedTuple):
    """Files that were written."""

    files: tuple[str, ...]
    """Names in the folder, in the order of writing."""
    notes: tuple[str, ...]
    """Files that were left out with the reason, limits of PX4, the mass of all parts, and weak brackets."""


def write_kit(design: Design, folder: Path, notes: Sequence[str] = (), physics: Physics = AS_SEARCHED) -> Kit:
    """Write the kit of a design.

    Files of an older kit are deleted first; `design.json` is written last, so a folder that has it is complete.

    Args:
        design: the design.
        folder: the folder to write to.
        notes: sentences at the top of the assembly sheet.
        physics: physics of the MuJoCo model beyond that of the search.

    Raises:
        BadInput: the folder holds other files, a number is out of PX4's range, or brackets do not fit.

    Example:
        >>> from topo_search import read_design, write_kit
        >>> write_kit(read_design("hover-2/best.json"), Path("hover-2-kit")).files[-1]
        'design.json'
    """
    require_kit_folder(folder)
    platform_data, solids = allocation(design), printed_parts(design)
    px4_reason = reason_against(platform_data)
    kit_notes = px4_warnings(platform_data) if px4_reason is None else (f"{PARAMETERS} is left out: {px4_reason}",)
    kit_notes = (*kit_notes, *struts_note(design), mass_note(design.task, parts_list(design, solids)))
    kit_notes = (*kit_notes, *strength_note(design))
    page = sheet(design, solids, (*notes, *kit_notes))
    contents: dict[str, str | bytes] = {
        ALLOCATION: to_json(platform_data),
        "allocation.csv": platform_data.csv(),
        "rotors.csv": platform_data.rotor_csv(),
        "allocator.py": allocator_file(design, platform_data),
        **({} if px4_reason else {PARAMETERS: px4_parameters(platform_data)}),
        **{f"{BRACKETS}/{part.file}": part.stl() for part in solids},
        PARTS: parts_csv(parts_list(design, solids)),
        SHEET: page,
        PRINTED_SHEET: sheet_pdf(page),
        "platform.xml": mjcf(design, physics),
        DESIGN: to_json(design),
    }
    for old in (*(folder / name for name in FILES), *(folder / BRACKETS).glob("*.stl")):
        old.unlink(missing_ok=True)
    for name, content in contents.items():
        write_atomically(folder / name, content)
    return Kit(tuple(contents), kit_notes)


def write_brackets(design: Design, folder: Path) -> tuple[str, ...]:
    """Write only the brackets and the rod's mount, replacing all STL files of a folder, and return their names.

    Raises:
        BadInput: the folder holds other files, or brackets do not fit.
    """
    _require_only(folder, lambda path: path.suffix == ".stl", "a new or empty folder, or one of STL files")
    parts = printed_parts(design)
    for old in folder.glob("*.stl"):
        old.unlink()
    for part in parts:
        write_atomically(folder / part.file, part.stl())
    return tuple(part.file for part in parts)


def allocation_file(design: Design, suffix: str) -> str:
    """Return the allocation as JSON or, with another suffix, as CSV."""
    return to_json(allocation(design)) if suffix == ".json" else allocation(design).csv()


def rotors_file(design: Design) -> str:
    """Return the rotors as CSV."""
    return allocation(design).rotor_csv()


def px4_file(design: Design) -> str:
    """Return the parameters of PX4's control allocation."""
    return px4_parameters(allocation(design))


def sheet_file(design: Design, suffix: str = ".html", notes: Sequence[str] = ()) -> str | bytes:
    """Return the assembly sheet, with notes at its top, as HTML or PDF."""
    page = sheet(design, printed_parts(design), notes)
    return sheet_pdf(page) if suffix == ".pdf" else page


def parts_file(design: Design) -> str:
    """Return the parts list as CSV."""
    return parts_csv(parts_list(design, printed_parts(design)))


def require_kit_folder(folder: Path) -> None:
    """Reject a folder that holds files other than those of a kit."""
    _require_only(folder, lambda path: path.name in (*FILES, BRACKETS), "a new or empty folder, or that of a kit")


def _require_only(folder: Path, is_ours: Callable[[Path], bool], what: str) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise BadInput("--out", f"must be a folder for this format, but got the file {folder}")
    if foreign := sorted(path.name for path in folder.iterdir() if not is_ours(path)):
        raise BadInput("--out", f"must be {what}, but {folder} holds {foreign[0]}")
