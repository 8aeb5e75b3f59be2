"""File formats of designs: built in, registered by a script, or provided by other packages.

A package provides one with an entry point in the group `topo_search.formats` that names an `OwnFormat`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from topo_search.model.design import Design
from topo_search.model.files import write_atomically
from topo_search.model.value import BadInput
from topo_search.protocols import DesignWriter, OwnFormat

GROUP = "topo_search.formats"
"""Group of entry points of other packages."""


def _lazy(module: str, function: str, *arguments: str) -> DesignWriter:
    """Return a writer that imports its module only when a design is written."""

    def write(design: Design, **options: Any) -> str | bytes:
        writer: Callable[..., str | bytes] = getattr(import_module(f"topo_search.export.{module}"), function)
        return writer(design, *arguments, **options)

    return write


BUILT_IN = (
    OwnFormat("glb", _lazy("solids", "glb"), (".glb",), "a scene for viewers and Blender"),
    OwnFormat("stl", _lazy("solids", "stl"), (".stl",), "solids in millimetres for CAD and printing"),
    OwnFormat("mjcf", _lazy("mjcf", "mjcf"), (".mjcf", ".xml"), "a model for the simulator MuJoCo"),
    OwnFormat("urdf", _lazy("urdf", "urdf"), (".urdf",), "a robot description"),
    OwnFormat("png", _lazy("picture", "picture", "png"), (".png",), "a picture"),
    OwnFormat("svg", _lazy("picture", "picture", "svg"), (".svg",), "a picture"),
)
"""Built-in formats that write a single file."""


_registered: dict[str, OwnFormat] = {file_format.name: file_format for file_format in BUILT_IN}


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
    if not isinstance(own, OwnFormat):
        raise ValueError(f"must be an OwnFormat, but got {type(own).__name__}")
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]*", own.name):
        raise ValueError(f"name must consist of lower-case letters, digits and dashes, but got {own.name!r}")
    reserved = "air allocation assembly brackets csv kit parquet parts px4 rotors sheet"  # of the command line
    if own.name in _registered or own.name in reserved.split():
        raise ValueError(f"name must be new, but a format {own.name!r} exists")
    for suffix in own.suffixes:
        if not re.fullmatch(r"\.[A-Za-z0-9]+", suffix):
            raise ValueError(f"a suffix must be a dot and letters or digits, but got {suffix!r}")
        if (other := find_by_suffix(suffix)) is not None:
            raise ValueError(f"a suffix must be new, but format {other.name} has {suffix}")
    _registered[own.name] = own


def formats() -> dict[str, OwnFormat]:
    """Return all formats by name, including those of installed packages.

    Raises:
        BadInput: an entry point is not a format, or its name or suffix is taken.
    """
    for entry in metadata.entry_points(group=GROUP):
        if entry.name in _registered:
            continue
        source = f"{GROUP}: {entry.name} = {entry.value}"
        try:
            file_format = entry.load()
        except Exception as error:
            rule = f"cannot be loaded: {type(error).__name__}: {error}"
            raise BadInput(source, rule) from error
        if not isinstance(file_format, OwnFormat) or file_format.name != entry.name:
            rule = f"must be an OwnFormat of this name, but is {type(file_format).__name__}"
            raise BadInput(source, rule)
        try:
            register_format(file_format)
        except ValueError as error:
            raise BadInput(source, str(error)) from None
    return dict(_registered)


def find_format(name: str) -> OwnFormat:
    """Return an existing format; entry points are loaded only if it is not registered yet."""
    return _registered[name] if name in _registered else formats()[name]


def export_design(design: Design, out: str | Path, *, format: str | None = None) -> Path:
    """Write a design in one of the formats, and return the path.

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
    if not isinstance(design, Design):
        raise BadInput("design", f"must be a Design, but got {type(design).__name__}")
    path, by_name = Path(out), formats()
    chosen = find_by_suffix(path.suffix) if format is None else by_name.get(format)
    if chosen is None and format is None:
        suffixes = ", ".join(sorted(suffix for file_format in by_name.values() for suffix in file_format.suffixes))
        raise BadInput(str(out), f"must end in {suffixes}, unless a format is given")
    if chosen is None:
        raise BadInput("format", f"must be one of {', '.join(sorted(by_name))}, but got {format!r}")
    write_atomically(path, content(design, chosen))
    return path


def content(design: Design, file_format: OwnFormat, **options: Any) -> bytes:
    """Return the content of a design's file; only built-in formats take options.

    Raises:
        BadInput: the format cannot represent this design, or its writer failed.
    """
    try:
        writer: Callable[..., str | bytes] = file_format.write
        written = writer(design, **options)
        if not isinstance(written, str | bytes) or not written:
            kind = type(written).__name__ if written else "nothing"
            raise ValueError(f"must write text or bytes, but wrote {kind}")
        return written if isinstance(written, bytes) else written.encode()
    except ValueError as error:
        raise BadInput(file_format.name, str(error)) from error
    except Exception as error:
        if file_format in BUILT_IN:
            raise
        rule = f"cannot write {design.topology.key}: {type(error).__name__}: {error}"
        raise BadInput(file_format.name, rule) from error


def find_by_suffix(suffix: str) -> OwnFormat | None:
    """Return the registered format with this suffix; None if there is none."""
    return next((known for known in _registered.values() if suffix.lower() in map(str.lower, known.suffixes)), None)
