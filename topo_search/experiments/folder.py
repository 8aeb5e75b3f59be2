"""The folder of an experiment: `results.csv`, a row a cell, and `about.json`, which says what made it."""

from __future__ import annotations

import csv
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from topo_search.experiments.cell import IDENTITY, Cell
from topo_search.experiments.measured import COLUMNS, Measured
from topo_search.limits import RESULT_BYTES
from topo_search.model import BadInput, Fault
from topo_search.model.csv_text import harmless
from topo_search.model.files import load_json, write_atomically
from topo_search.model.regular_file import NotReadable, read_regular
from topo_search.study.identity import installed
from topo_search.study.lock import locked

RESULTS, ABOUT = "results.csv", "about.json"
FORMAT = "topo-search/experiment"

Identity = tuple[str, ...]


class Results:
    """The rows of one experiment, held by this process alone."""

    def __init__(self, path: Path, done: set[Identity]) -> None:
        self._path = path
        self._done = done

    @classmethod
    @contextmanager
    def opened(cls, folder: Path, about: dict[str, Any]) -> Iterator[Self]:
        """Make an experiment's folder, or take it up again.

        Args:
            folder: where.
            about: what fixes the rows; a folder that holds rows of anything else is refused.

        Raises:
            BadInput: the folder cannot be used; it is left as it is.
        """
        if folder.exists() and not folder.is_dir():
            raise _refused(folder, "is a file")
        if (folder / RESULTS).exists() and not (folder / ABOUT).exists():
            raise _refused(folder, f"has a {RESULTS} but no {ABOUT}: it is no experiment's folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _refused(folder, f"cannot be made: {error.strerror}") from None
        with locked(folder):
            if (folder / ABOUT).exists():
                _compare(folder, load_json(folder / ABOUT), about)
            else:
                text = json.dumps({**about, **_circumstances()}, indent=1)
                write_atomically(folder / ABOUT, text + "\n")
            yield cls(folder / RESULTS, _mend(folder / RESULTS))

    def has(self, cell: Cell) -> bool:
        """Return whether a cell has its row."""
        return _identity(cell.identity) in self._done

    def add(self, row: Measured) -> None:
        """Append a row; it is on the disk when this returns."""
        with self._path.open("a", encoding="utf-8", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerow(map(harmless, astuple(row)))
            stream.flush()
            os.fsync(stream.fileno())
        self._done.add(_identity({name: getattr(row, name) for name in IDENTITY}))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._done)


def about(name: str, settings: dict[str, Any], command: str) -> dict[str, Any]:
    """Return what fixes the rows of an experiment, and the command that asks for them."""
    return {
        "format": FORMAT,
        "version": 1,
        "experiment": name,
        "command": command,
        "settings": settings,
        "versions": installed(),
    }


def _circumstances() -> dict[str, Any]:
    """Return what may have a part in the measured times."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
    }


def _compare(folder: Path, held: dict[str, Any], asked: dict[str, Any]) -> None:
    """Refuse a folder that holds another experiment."""
    if held.get("format") != FORMAT or held.get("version") != asked["version"]:
        raise _refused(folder, f"has an {ABOUT} of another program or version")
    if held["experiment"] != asked["experiment"]:
        raise _refused(folder, f"holds the experiment {held['experiment']}, not {asked['experiment']}")
    for group in ("settings", "versions"):
        for name, value in asked[group].items():
            if held[group].get(name) != value:
                kind = "results of version" if group == "versions" else "an experiment with"
                was, now = (json.dumps(one) for one in (held[group].get(name), value))
                raise _refused(folder, f"holds {kind} {name} {was}, not {now}")


def _mend(path: Path) -> set[Identity]:
    """Return whose rows a file holds; begin one where there is none, and cut off a row that a kill tore."""
    if not path.exists():
        write_atomically(path, ",".join(COLUMNS) + "\n")
    try:
        content = read_regular(path, most_bytes=RESULT_BYTES)
    except NotReadable as error:
        raise BadInput(str(path), [Fault("", str(error))]) from None
    whole = content[: content.rfind(b"\n") + 1]
    lines = list(csv.reader(whole.decode("utf-8").splitlines()))
    if not lines or tuple(lines[0]) != COLUMNS:
        raise _refused(path.parent, f"has a {RESULTS} with other columns")
    if len(whole) < len(content):
        os.truncate(path, len(whole))
    places = [COLUMNS.index(name) for name in IDENTITY]
    return {tuple(line[place] for place in places) for line in lines[1:]}


def _identity(values: dict[str, Any]) -> Identity:
    """Return values as the file has them."""
    return tuple("" if values[name] is None else str(harmless(values[name])) for name in IDENTITY)


def _refused(path: Path, what: str) -> BadInput:
    return BadInput(str(path), [Fault("", f"{what}; choose another folder with --out")])
