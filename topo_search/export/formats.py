"""File formats: one table for `export`, its help and `export_design`, extended by scripts and other packages.

A package provides a format with an entry point in the group `topo_search.formats` that names an `OwnFormat`.
`export --help` loads this file, so it imports little.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from topo_search.export.own_format import OwnFormat
    from topo_search.model import Design

GROUP = "topo_search.formats"
"""Group of entry points of other packages."""


@dataclass(frozen=True)
class Format:
    """One file format."""

    name: str
    writer: str | Callable[..., str | bytes]
    """Function of the design or table that returns the content; of this package, `MODULE.FUNCTION`."""
    suffixes: tuple[str, ...]
    says: str
    reads: Literal["design", "table", "folder"] = "design"
    """What it is made of: a design, or a run, an audit or a design as a table; `folder`: a design, written as a
    folder."""
    takes: tuple[str, ...] = ()
    """Options of `export` that apply; `suffix` and `notes` are further arguments of the writer."""
    noun: str = "design"
    """Name of the file in messages."""
    own: bool = False
    """True for a format of the user or another package."""


PHYSICS = ("--motor-lag", "--rod-mass", "--contacts")
AIR = ("--air-speed", "--load-case")
ANGLES = ("--angle-step",)
BUILT_IN = (
    Format("png", "picture.png", (".png",), "a picture: platform, airflow, tree", takes=AIR, noun="picture"),
    Format("svg", "picture.svg", (".svg",), "the same as vectors", takes=AIR, noun="picture"),
    Format("pdf", "picture.pdf", (), "the same for a paper, with --format pdf", takes=AIR, noun="picture"),
    Format("glb", "solids.glb", (".glb",), "a scene for viewers and Blender", takes=("--parts", *AIR)),
    Format("stl", "solids.stl", (".stl",), "solids in millimetres for CAD and printing", takes=("--parts",)),
    Format("mjcf", "mjcf.mjcf", (".mjcf", ".xml"), "a model for MuJoCo, a keyframe per load case", takes=PHYSICS),
    Format("urdf", "urdf.urdf", (".urdf",), "a robot description with a frame at every rotor"),
    Format("air", "air_field.air_file", (".npz", ".vti"), "air speeds on a grid per load case", takes=("suffix",)),
    Format("csv", "audits.csv", (".csv",), "candidates of a run, clearances of an audit", "table", noun="table"),
    Format("parquet", "audits.parquet", (".parquet",), "the same table", "table", noun="table"),
    Format("assembly", lambda sheet: sheet.csv(), (), "CSV: what to bolt to what, in order", "table", noun="table"),
    Format("kit", "", (), "a folder for the lab: the following, and models", "folder", (*ANGLES, *PHYSICS)),
    Format("allocation", "kit.allocation_file", (), "the matrix from rotor inputs to force and torque, "
           ".json or .csv", takes=("suffix", *ANGLES), noun="table"),
    Format("rotors", "kit.rotors_file", (), "CSV: position, axis, spin, coefficients", takes=ANGLES, noun="table"),
    Format("px4", "kit.px4_file", (".params",), "PX4's parameters, at most 12 rotors", takes=ANGLES, noun="table"),
    Format("brackets", "", (), "a folder of STL files [mm]: brackets of all joints, rod mount", "folder", ANGLES),
    Format("sheet", "kit.sheet_file", (".html", ".pdf"), "the assembly sheet", takes=("suffix", "notes", *ANGLES),
           noun="sheet"),
    Format("parts", "kit.parts_file", (), "the parts list as CSV", takes=ANGLES, noun="table"),
)  # fmt: skip
"""All formats of this package, in the order of `export --help`."""
_registered: dict[str, Format] = {file_format.name: file_format for file_format in BUILT_IN}


def register_format(own: OwnFormat) -> None:
    """Register a file format in this process, by its name and suffixes.

    Raises:
        ValueError: the name or a suffix is not allowed or already taken.

    Example:
        >>> from topo_search import OwnFormat, export_design, read_design, register_format
        >>> register_format(OwnFormat("tree", lambda design: design.topology.key, suffixes=(".tree",)))
        >>> export_design(read_design("hover-2/best.json"), "hover-2.tree").read_text()
        'a10'
    """
    from topo_search.export.own_format import OwnFormat

    if not isinstance(own, OwnFormat):
        raise ValueError(f"must be an OwnFormat, but got {type(own).__name__}")
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]*", own.name):
        raise ValueError(f"name must consist of lower-case letters, digits and dashes, but got {own.name!r}")
    if own.name in _registered:
        raise ValueError(f"name must be new, but a format {own.name!r} exists")
    for suffix in own.suffixes:
        if not re.fullmatch(r"\.[A-Za-z0-9]+", suffix):
            raise ValueError(f"a suffix must be a dot and letters or digits, but got {suffix!r}")
        if (other := _with_suffix(suffix, _registered)) is not None:
            raise ValueError(f"a suffix must be new, but format {other.name} has {suffix}")
    _registered[own.name] = Format(own.name, own.write, own.suffixes, own.says, own=True)


def formats() -> dict[str, Format]:
    """Return all formats by name, including those of installed packages.

    Raises:
        BadInput: an entry point is not a format, or its name or suffix is taken.
    """
    from topo_search.model import BadInput

    for entry in metadata.entry_points(group=GROUP):
        if entry.name in _registered:
            continue
        source = f"{GROUP}: {entry.name} = {entry.value}"
        try:
            register_format(entry.load())
        except ValueError as error:
            raise BadInput(source, str(error)) from None
        except Exception as error:
            raise BadInput(source, f"cannot be loaded: {type(error).__name__}: {error}") from error
        if entry.name not in _registered:
            raise BadInput(source, "must be an OwnFormat of this name")
    return dict(_registered)


def choose(name: str | None, out: Path, known: dict[str, Format]) -> Format:
    """Return the format with a name, else with a file's suffix; BadInput if no format has it."""
    from topo_search.model import BadInput

    if name is not None and name not in known:
        raise BadInput("format", f"must be one of {', '.join(sorted(known))}, but got {name!r}")
    chosen = _with_suffix(out.suffix, known) if name is None else known[name]
    if chosen is None:
        suffixes = ", ".join(sorted(suffix for each in known.values() for suffix in each.suffixes))
        raise BadInput(str(out), f"must end in {suffixes}, unless a format is given")
    return chosen


def export_design(design: Design, out: str | Path, *, format: str | None = None) -> Path:
    """Write a design in one of the formats that are a single file, and return the path.

    Args:
        design: any design, audited or not.
        out: the file; its folder is created if necessary, and an existing file is replaced.
        format: name of the format; default: by the suffix.

    Raises:
        BadInput: the format is unknown, or it cannot represent this design.

    Example:
        >>> from topo_search import export_design, read_design
        >>> print(export_design(read_design("hover-2/best.json"), "hover-2.urdf"))
        hover-2.urdf
    """
    path = Path(out)
    known = {name: file_format for name, file_format in formats().items() if file_format.reads == "design"}
    write(choose(format, path, known), design, path)
    return path


def write(file_format: Format, source: Any, out: Path, **options: Any) -> None:
    """Write a file in a format.

    Args:
        file_format: the format, which is not a folder.
        source: the design, or the table.
        out: the file.
        options: keyword arguments of the format's writer.

    Raises:
        BadInput: the format cannot represent this design, or its writer failed.
    """
    from topo_search.model import BadInput
    from topo_search.model.files import write_atomically

    writer = file_format.writer
    if isinstance(writer, str):
        module, function = writer.split(".")
        writer = getattr(import_module(f"topo_search.export.{module}"), function)
    if "suffix" in file_format.takes:
        options["suffix"] = out.suffix.lower()
    try:
        written = writer(source, **options)
        content = written if isinstance(written, bytes) else written.encode()
    except ValueError as error:
        raise BadInput(file_format.name, str(error)) from error
    except Exception as error:
        if not file_format.own:
            raise
        rule = f"cannot write {source.topology.key}: {type(error).__name__}: {error}"
        raise BadInput(file_format.name, rule) from error
    write_atomically(out, content)


def _with_suffix(suffix: str, known: dict[str, Format]) -> Format | None:
    return next((each for each in known.values() if suffix.lower() in map(str.lower, each.suffixes)), None)
