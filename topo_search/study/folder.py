"""The run folder: the ledger, and files made from it for people and other programs."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from topo_search.model import BadInput, Fault
from topo_search.model.csv_text import harmless
from topo_search.model.files import read_task, to_toml, write_atomically
from topo_search.study.identity import Identity, Request, installed
from topo_search.study.ledger import Ledger
from topo_search.study.lock import ReadOnlyFolder, locked
from topo_search.study.row import COLUMNS, Row

LEDGER = "ledger.sqlite"


class RunFolder:
    """The folder of one request, held by this process alone."""

    def __init__(self, path: Path, request: Request, ledger: Ledger) -> None:
        self.path = path
        self.request = request
        self.ledger = ledger

    @classmethod
    @contextmanager
    def opened(cls, path: Path, request: Request) -> Iterator[Self]:
        """Make a run's folder, or take it up again.

        Raises:
            ReadOnlyFolder: it is there, but cannot be written to.
            BadInput: it holds another run or something else, or another process works in it; it is left as it is.
        """
        try:
            _check(path)
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _refused(path, f"cannot be made: {error.strerror}") from None
        ledger_path = path / LEDGER
        if ledger_path.exists() and not os.access(ledger_path, os.W_OK):
            raise ReadOnlyFolder(path, f"{LEDGER} is read-only")
        with locked(path), Ledger.opened(ledger_path) as ledger:
            ledger.claim(request.identity)
            folder = cls._of_ledger(path, request, ledger)
            ledger.ask(request.starts, request.trials)
            _write(path / "task.toml", to_toml(request.task))
            yield folder

    @classmethod
    @contextmanager
    def read(cls, path: Path, request: Request) -> Iterator[Self]:
        """Open a folder that cannot be written to; errors as of `opened`."""
        with Ledger.opened(path / LEDGER, read_only=True) as ledger:
            yield cls._of_ledger(path, request, ledger)

    @classmethod
    @contextmanager
    def found(cls, path: Path) -> Iterator[Self]:
        """Open the folder of any run to read it, with the request that it was last given.

        Raises:
            BadInput: it is no run's folder.
        """
        if not (path / LEDGER).is_file():
            raise BadInput(str(path), [Fault("", f"is no run's folder: it has no {LEDGER}")])
        task = read_task(path / "task.toml", names_files=False)
        with Ledger.opened(path / LEDGER, read_only=True) as ledger:
            held = _held(path, ledger)
            starts, trials = ledger.asked()
            request = Request(
                task,
                held.symmetry,
                starts,
                held.seed,
                strategy=held.strategy,
                sampler=held.sampler or "moves",
                trials=trials,
                prune=bool(held.prune),
                versions=ledger.versions() or installed(),
            )
            yield cls._of_ledger(path, request, ledger)

    @classmethod
    def _of_ledger(cls, path: Path, request: Request, ledger: Ledger) -> Self:
        """Make sure that a ledger holds this request, and consider the rows that answer it."""
        held = _held(path, ledger)
        for name, value in request.identity:
            if (other := getattr(held, name)) != value:
                shown = "another task" if name == "task" else f"a run with {name} {other}, not {value}"
                raise _refused(path, f"holds {shown}")
        ledger.consider([context for n in request.task.sizes for context in request.contexts(n)])
        return cls(path, request, ledger)

    def levels(self) -> Iterator[RunFolder]:
        """Yield the folder of each level of the goals in turn, while the ledger ranks its rows.

        That of a run without goals is this one.
        """
        for number, request in enumerate(self.request.levels):
            self.ledger.consider([context for n in request.task.sizes for context in request.contexts(n)])
            yield self if request.level is None else RunFolder(self.path / f"levels/{number}", request, self.ledger)

    def write(self) -> None:
        """Bring all files of the folder up to the ledger."""
        for folder in ("designs", "audits"):
            (self.path / folder).mkdir(parents=True, exist_ok=True)
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(COLUMNS)
        valid: set[Path] = set()
        for n in self.request.task.sizes:
            for row in self.ledger.ranked(n):
                writer.writerow([harmless(getattr(row, name)) for name in COLUMNS])
            for key, design, audit in self.ledger.texts(n):
                valid |= self._write_texts(key, designs=design, audits=audit)
        write_atomically(self.path / "candidates.csv", table.getvalue())
        for path in (*self.path.glob("designs/*.json"), *self.path.glob("audits/*.json")):
            if path not in valid:
                path.unlink()
        self._write_best()

    def _write_best(self) -> None:
        """Write `best.json`, and `best-nN.json` of every size where there are several."""
        sizes = self.request.task.sizes
        best: dict[int, Row | None] = {n: self.ledger.best_clear(n) for n in sizes}
        files = {f"best-n{n}.json": row for n, row in best.items()} if len(sizes) > 1 else {}
        files["best.json"] = next((row for row in best.values() if row is not None), None)
        for name, row in files.items():
            if row is None:
                (self.path / name).unlink(missing_ok=True)
                continue
            text = self.ledger.design(self.request.contexts(row.modules)[row.step], row.key)
            _write(self.path / name, text or "")

    def _write_texts(self, key: str, **texts: str | None) -> set[Path]:
        """Write a candidate's file into each folder that there is a text for; return their paths."""
        paths = {self.path / folder / f"{key}.json": text for folder, text in texts.items() if text is not None}
        for path, text in paths.items():
            _write(path, text, lasting=False)
        return set(paths)


def _held(path: Path, ledger: Ledger) -> Identity:
    """Return the identity of the run that a ledger holds."""
    held = ledger.identity()
    if held is None:
        raise BadInput(str(path), [Fault("", "holds no run yet")])
    return held


def _write(path: Path, text: str, *, lasting: bool = True) -> None:
    """Write a file unless it holds the text already; `lasting` as of `write_atomically`."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_atomically(path, text, lasting=lasting)


def _check(path: Path) -> None:
    """Refuse a place that is not for a run."""
    if path.exists() and not path.is_dir():
        raise _refused(path, "is a file")
    if (path / LEDGER).exists():
        return
    for name in ("task.toml", "candidates.csv", "best.json"):
        if (path / name).exists():
            raise _refused(path, f"has a {name} but no {LEDGER}: it is no run's folder, and would be overwritten")


def _refused(path: Path, what: str) -> BadInput:
    return BadInput(str(path), [Fault("", f"{what}; choose another folder with --out")])
