"""The folder of an experiment: `results.csv`, a row a cell, and `about.json`, which says what made it.

Both are regular files, and no symbolic link is followed to them. Rows are appended to one file, held open; whoever
appended one knows that the file is still there.
"""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import astuple, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from topo_search.experiments.cell import IDENTITY, Cell
from topo_search.experiments.measured import COLUMNS, Measured
from topo_search.limits import RESULT_BYTES
from topo_search.model import BadInput, Fault
from topo_search.model.bad_input import show
from topo_search.model.csv_text import escape_formula
from topo_search.model.files import load_json
from topo_search.model.regular_file import NotReadable, read_regular
from topo_search.study.directory import Directory, hold_lock
from topo_search.study.ledger_file import LedgerLost
from topo_search.study.request import installed_versions

RESULTS, ABOUT = "results.csv", "about.json"
FORMAT = "topo-search/experiment"

Identity = tuple[str, ...]
EMPTY = " | None"
"""End of the kind of a column whose cells may be empty."""
KINDS = {field.name: str(field.type) for field in fields(Measured)}
READ: dict[str, Callable[[str], object]] = {"int": int, "float": float, "str": str}
"""What reads a cell of each kind."""


class ResultsLost(LedgerLost):
    """The rows, or their folder, were removed, moved, replaced or cut off while an experiment worked."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.args = (
            f"{path}: was removed, moved, replaced or truncated while the experiment ran; it stopped, and "
            "only the rows still in that file are kept",
        )


class Results:
    """The rows of one experiment, held by this process alone."""

    def __init__(self, path: Path, handle: int, done: set[Identity]) -> None:
        """Take a file of rows that is open for appending, and whose rows it holds."""
        self._path = path
        self._handle = handle
        self._done = done
        self._size = os.fstat(handle).st_size

    @classmethod
    @contextmanager
    def open(cls, folder: Path, about: dict[str, Any]) -> Iterator[Self]:
        """Make an experiment's folder, or take it up again.

        Args:
            folder: where.
            about: what fixes the rows; a folder that holds rows of anything else is refused.

        Raises:
            BadInput: the folder cannot be used; it is left as it is.
        """
        if folder.exists() and not folder.is_dir():
            raise _refusal(folder, "is a file")
        for name in (RESULTS, ABOUT):
            if (folder / name).is_symlink():
                raise _refusal(folder, f"has a symbolic link in place of its {name}")
        if (folder / RESULTS).exists() and not (folder / ABOUT).exists():
            raise _refusal(folder, f"has a {RESULTS} but no {ABOUT}: it is not an experiment folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _refusal(folder, f"cannot be made: {error.strerror}") from None
        with hold_lock(folder), Directory.open(folder) as directory:
            directory.tidy()
            if (folder / ABOUT).exists():
                _compare(folder, load_json(folder / ABOUT), about)
            else:
                text = json.dumps({**about, **_circumstances()}, indent=1)
                directory.write(ABOUT, f"{text}\n".encode())
            if not (folder / RESULTS).exists():
                directory.write(RESULTS, f"{','.join(COLUMNS)}\n".encode())
            path = folder / RESULTS
            size, done = _rows(path)
            handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                os.ftruncate(handle, size)  # a row that a kill tore
                yield cls(path, handle, done)
            finally:
                os.close(handle)

    def has(self, cell: Cell) -> bool:
        """Return whether a cell has its row."""
        return _identity(cell.identity) in self._done

    def add(self, row: Measured) -> None:
        """Append a row; it is on the disk when this returns.

        Raises:
            ResultsLost: it is not: the file is gone.
            OSError: it cannot be written; names the file.
        """
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(map(escape_formula, astuple(row)))
        content = memoryview(line.getvalue().encode())
        self._size += len(content)
        try:
            while content:
                content = content[os.write(self._handle, content) :]
            os.fsync(self._handle)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error
        self.require()
        self._done.add(_identity({name: getattr(row, name) for name in IDENTITY}))

    def require(self) -> None:
        """Make sure that the file is still there with all rows; ResultsLost if not."""
        held = os.fstat(self._handle)
        try:
            there = os.lstat(self._path)
        except OSError:
            raise ResultsLost(self._path) from None
        if not os.path.samestat(held, there) or held.st_size != self._size:
            raise ResultsLost(self._path)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._done)


def identify(name: str, settings: dict[str, Any], command: str) -> dict[str, Any]:
    """Return what fixes the rows of an experiment, and the command that asks for them."""
    return {
        "format": FORMAT,
        "version": 1,
        "experiment": name,
        "command": command,
        "settings": settings,
        "versions": installed_versions(),
    }


def _circumstances() -> dict[str, Any]:
    """Return what may have a part in the measured times."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
    }


def _compare(folder: Path, held: Any, asked: dict[str, Any]) -> None:
    """Refuse a folder that holds another experiment."""
    if not isinstance(held, dict) or held.get("format") != FORMAT or held.get("version") != asked["version"]:
        raise _refusal(folder, f"has an {ABOUT} of another program or version")
    if held.get("experiment") != asked["experiment"]:
        raise _refusal(folder, f"holds the experiment {held.get('experiment')}, not {asked['experiment']}")
    for group in ("settings", "versions"):
        if not isinstance(of := held.get(group), dict):
            raise _refusal(folder, f"has an {ABOUT} whose {group} is not a table")
        for name, value in asked[group].items():
            if of.get(name) != value:
                kind = "results of version" if group == "versions" else "an experiment with"
                was, now = (show(one) for one in (of.get(name), value))
                raise _refusal(folder, f"holds {kind} {name} {was}, not {now}")


def _rows(path: Path) -> tuple[int, set[Identity]]:
    """Return how many bytes of a file are whole rows, and whose rows they are; BadInput names what is none."""
    try:
        content = read_regular(path, most_bytes=RESULT_BYTES)
        size = content.rfind(b"\n") + 1
        text = content[:size].decode("utf-8")
    except NotReadable as error:
        raise BadInput(str(path), [Fault("", str(error))]) from None
    except UnicodeDecodeError as error:
        rule = f"must be UTF-8 text, but got the byte {content[error.start]:#04x} at offset {error.start}"
        raise BadInput(str(path), [Fault("", rule)]) from None
    lines = text.split("\n")[:-1]
    if not lines or tuple(lines[0].split(",")) != COLUMNS:
        raise _refusal(path.parent, f"has a {RESULTS} with other columns")
    done = set()
    for number, line in enumerate(lines[1:], start=2):
        row = _cells(path, number, line)
        done.add(tuple(row[name] for name in IDENTITY))
    return size, done


def _cells(path: Path, number: int, line: str) -> dict[str, str]:
    """Return the cells of a line by their columns; BadInput names the line that is no row, and why."""
    try:
        (cells,) = csv.reader([line], strict=True)
    except (csv.Error, ValueError):  # none or several rows
        cells = []
    if len(cells) != len(COLUMNS):
        rule = f"must have {len(COLUMNS)} cells in each row, but has {len(cells)} in line {number}: it is damaged"
        raise BadInput(str(path), [Fault("", rule)])
    row = dict(zip(COLUMNS, cells, strict=True))
    for name, kind in KINDS.items():
        try:
            READ[kind.removesuffix(EMPTY)](row[name])
        except ValueError:
            if row[name] or not kind.endswith(EMPTY):
                rule = f"must be of kind {kind}, but got {show(row[name])} in line {number}: it is damaged"
                raise BadInput(str(path), [Fault(name, rule)]) from None
    return row


def _identity(values: dict[str, Any]) -> Identity:
    """Return values as the file has them."""
    return tuple("" if values[name] is None else str(escape_formula(values[name])) for name in IDENTITY)


def _refusal(path: Path, what: str) -> BadInput:
    return BadInput(str(path), [Fault("", f"{what}; choose another folder with --out")])
