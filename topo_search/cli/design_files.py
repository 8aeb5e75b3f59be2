"""The designs that the words of a command line stand for: files, and folders of them, whoever wrote them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from topo_search.limits import DESIGN_BYTES
from topo_search.model import BadInput, Geometry
from topo_search.model.bad_input import to_printable
from topo_search.model.files import load_json, stated_format, to_geometry

AUDIT = "topo-search/audit"
"""`format` of an audit's file."""


@dataclass(frozen=True)
class DesignFile:
    """A file that is to hold a design."""

    path: str
    listed: bool = False
    """True if it was found in a folder, where it may be an audit that a run keeps beside its designs."""
    fault: str | None = None
    """Fault that was found before it was opened."""

    @property
    def name(self) -> str:
        """The path as it can be printed: Unicode without control characters."""
        return to_printable(self.path)

    def read(self) -> Geometry | None:
        """Return the design, or its geometry; None for an audit in a folder.

        Raises:
            BadInput: it is no design; names every fault.
        """
        if self.fault is not None:
            raise BadInput(self.name, self.fault)
        data = load_json(self.path, most_bytes=DESIGN_BYTES)
        if self.listed and stated_format(data) == AUDIT:
            return None
        return to_geometry(data, self.name)


class Reading:
    """Designs as they are read from files, and what became of the other files."""

    def __init__(self, files: Sequence[DesignFile], *, tell: Callable[[str], None]) -> None:
        self.files = files
        self.tell = tell
        self.read: list[tuple[str, Geometry]] = []
        """Every design with the name of its file, in order."""
        self.refused: list[tuple[str, str]] = []
        """Every other file, with its faults."""
        self.passed_over = 0
        """Number of audits that were found in folders."""

    def designs(self) -> Iterator[Geometry]:
        """Yield the designs as they are read, and tell the faults of the other files."""
        for file in self.files:
            try:
                design = file.read()
            except BadInput as error:
                self.refused.append((file.name, "; ".join(map(str, error.faults))))
                self.tell("\n".join(f"{file.name}: {fault}" for fault in error.faults))
                continue
            if design is None:
                self.passed_over += 1
            else:
                self.read.append((file.name, design))
                yield design


def design_files(words: Sequence[str]) -> list[DesignFile]:
    """Return the files of a command line in its order; of a folder all `*.json` below it, sorted.

    Links to folders are followed when they are given, not when they are met.
    """
    return [file for word in words for file in (_find_files(word) if Path(word).is_dir() else [DesignFile(word)])]


def _find_files(folder: str) -> Iterator[DesignFile]:
    unread: list[OSError] = []
    empty = True
    for parent, folders, files in os.walk(folder, onerror=unread.append):
        folders.sort()
        for name in sorted(files):
            if name.endswith(".json"):
                empty = False
                yield DesignFile(str(Path(parent) / name), listed=True)
    for error in unread:
        yield DesignFile(str(error.filename), fault=f"cannot be read: {error.strerror}")
    if empty and not unread:
        yield DesignFile(folder, fault="must contain designs, but no file below it ends in .json")
