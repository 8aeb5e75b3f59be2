"""The run folder: the ledger, and the files derived from it for people and other programs.

A folder with a ledger belongs to that ledger's run and request. Any other folder must be empty, or it is refused
and left unchanged. Only files that the run itself wrote are replaced or removed (`directory`).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from topo_search.limits import LIMITS
from topo_search.model import Audit, BadInput, Design, Task
from topo_search.model.features import with_older_defaults
from topo_search.model.files import load_text, to_toml, validate, write_atomically
from topo_search.model.text import csv_text, toml_data
from topo_search.model.value import as_bad_input, faults_of
from topo_search.study.directory import ReadOnlyFolder, RunFile, lock
from topo_search.study.ledger import Ledger, Row, best_of
from topo_search.study.ledger_file import blank
from topo_search.study.request import NO_INPUTS, Request, UserInputs, installed_versions

Model = TypeVar("Model", bound=BaseModel)


def is_run_folder(folder: Path) -> bool:
    """Return whether a folder has a ledger, False if it is empty; refuse any other."""
    names = sorted(os.listdir(folder))
    if RunFile.LEDGER in names:
        return True
    # a run that was killed as it began leaves its lock, and a part of its ledger
    files = [name for name in names if name != RunFile.LOCK and not name.startswith(f".{RunFile.LEDGER}.")]
    if not files:
        return False
    shown = ", ".join(files[:3]) + (", ..." if len(files) > 3 else "")
    what = f"has {shown} but no {RunFile.LEDGER}: the ledger was removed, or this is not a run folder"
    raise refusal(folder, f"{what}; it is left unchanged")


def stored_request(path: Path, ledger: Ledger) -> Request:
    """Return the latest request of a ledger's run."""
    identity = ledger.identity()
    starts, trials = ledger.last_request()
    if starts < 1:
        raise BadInput(str(path), "has no run yet")
    options: dict[str, Any] = {name: getattr(identity, name) for name in ("strategy", "round_size")}
    options |= {"sampler": identity.sampler or "moves", "trials": trials, "prune": bool(identity.prune)}
    options |= {"versions": ledger.versions() or installed_versions(), "user_inputs": identity.own or NO_INPUTS}
    return Request(_read_task(path), identity.symmetry, starts, identity.seed, **options)


def require_same(path: Path, request: Request, ledger: Ledger) -> None:
    """Refuse the ledger of another request."""
    identity = ledger.identity()
    for name, value in request.identity:
        if (stored := getattr(identity, name)) != value:
            raise refusal(path, f"holds {_describe_stored(name, stored, value)}")


def require_versions(path: Path, ledger: Ledger) -> None:
    """Refuse to resume a run with functions of the user that have no version, once it has results.

    The functions may have changed since.
    """
    user_inputs = ledger.identity().own
    if user_inputs is not None and user_inputs.unversioned and ledger.versions() is not None:
        names = ", ".join(map(repr, user_inputs.unversioned))
        own_code = f"{names} of your own, which has no version"
        raise refusal(path, f"holds a run with {own_code}, so that it cannot be resumed")


def make_folder(path: Path) -> None:
    """Create a folder unless it exists; BadInput if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refusal(path, f"cannot be created: {error.strerror}") from None


def refusal(path: Path, what: str) -> BadInput:
    """Return the error for a folder that the run cannot use."""
    return BadInput(str(path), f"{what}; choose another folder with --out")


def _read_task(path: Path) -> Task:
    """Return the task as the run wrote it; it refers to no other file."""
    name = str(path / RunFile.TASK)
    text = load_text(name, most_bytes=LIMITS.task_bytes)
    with as_bad_input(name):
        data = toml_data(text)
    return validate(Task, with_older_defaults(data), name)


def _describe_stored(name: str, stored: Any, requested: Any) -> str:
    """Say what a folder holds instead of what was requested."""
    if name == "task":
        return "another task"
    if name != "own":
        return f"a run with {name} {stored}, not {requested}"
    stored, requested = stored or NO_INPUTS, requested or NO_INPUTS
    different = [part for part in UserInputs.model_fields if getattr(stored, part) != getattr(requested, part)]
    return f"a run with other {' and other '.join(different)}"


class RunFolder:
    """The folder of one request."""

    def __init__(self, path: Path, request: Request, ledger: Ledger, level: str = "") -> None:
        """Wrap a folder whose ledger is open; `level`: subfolder of one level of the goals, such as `levels/0/`."""
        self.path = path / level
        self.request = request
        self.ledger = ledger.ranking_only(context for n in request.task.sizes for context in request.contexts(n))
        self._files = ledger.files_in(path)
        self._level = level

    @classmethod
    @contextmanager
    def open(cls, path: Path, request: Request) -> Iterator[RunFolder]:
        """Create a run's folder, or open it to resume the run.

        Raises:
            ReadOnlyFolder: the folder exists but cannot be written to.
            BadInput: it holds another run or other files, or another process uses it; it is left unchanged.
        """
        make_folder(path)
        if not is_run_folder(path):
            with lock(path):
                if not is_run_folder(path):  # another process may have been faster
                    write_atomically(
                        path / RunFile.LEDGER, blank(request.identity.model_dump_json(exclude_defaults=True))
                    )
        with cls.load(path, request, writes=True) as folder:
            folder = cls(path, request, folder.ledger)
            folder._files.require((*RunFile.RESULTS, *(f"best-n{n}.json" for n in request.task.sizes)))
            folder.ledger.set_request(request.starts, request.trials)
            folder.write_file(RunFile.TASK, to_toml(request.task))
            yield folder

    @classmethod
    @contextmanager
    def load(cls, path: Path, request: Request | None = None, *, writes: bool = False) -> Iterator[RunFolder]:
        """Open the folder of an existing run.

        Args:
            path: the folder.
            request: the request that it must belong to; None: its own latest request.
            writes: whether files will be written; then no other process may use the folder.

        Raises:
            ReadOnlyFolder: files are to be written, but cannot be.
            BadInput: it is not a run folder, or another process uses it.
        """
        if not (path / RunFile.LEDGER).exists():
            raise BadInput(str(path), f"is not a run folder: it has no {RunFile.LEDGER}")
        if writes and not os.access(path / RunFile.LEDGER, os.W_OK):
            raise ReadOnlyFolder(path, f"{RunFile.LEDGER} is read-only")
        with (
            lock(path) if writes else nullcontext(),
            Ledger.open(path / RunFile.LEDGER, read_only=not writes) as ledger,
        ):
            if request is None:
                request = stored_request(path, ledger)
            else:
                require_versions(path, ledger)
            require_same(path, request, ledger)
            yield cls(path, request, ledger).answering

    @property
    def asked(self) -> RunFolder | None:
        """The folder of the same run with the defaults of flying tasks, if it went on without them."""
        return None if self.request.asked is None else RunFolder(self.path, self.request.asked, self.ledger)

    @property
    def fallback(self) -> RunFolder:
        """The folder of the run that follows if no design holds the defaults of flying tasks."""
        return RunFolder(self.path, self.request.fallback, self.ledger)

    @property
    def answering(self) -> RunFolder:
        """This folder, or `fallback` if no design holds the defaults and the run has gone on without them."""
        if not self.request.task.flight.filled or self.has_clear:
            return self
        other = self.fallback
        contexts = (level.request.contexts(n)[0] for level in other.levels for n in level.request.task.sizes)
        return other if any(map(self.ledger.bound, contexts)) else self

    @property
    def has_clear(self) -> bool:
        """True if a design has a clear audit."""
        sizes = self.request.task.sizes
        return any(level.ledger.best_clear(n) is not None for level in self.levels for n in sizes)

    @cached_property
    def levels(self) -> tuple[RunFolder, ...]:
        """The folder of each level of the goals; without goals, this folder alone."""
        if not self.request.task.goals.names:
            return (self,)
        return tuple(
            RunFolder(self.path, request, self.ledger, f"levels/{k}/")
            for k, request in enumerate(self.request.levels)
        )

    def write_file(self, name: str, content: str | None) -> None:
        """Write one of the run's files unless it is up to date; None: remove it if it exists.

        Raises:
            BadInput: a file of this name exists that the run did not write.
            OSError: it cannot be written.
        """
        if content is None:
            self._files.remove([self._level + name])
        else:
            self._files.write([(self._level + name, content.encode())])

    def write_table(self, name: str, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
        """Write one of the run's files as CSV; same errors as `write_file`."""
        self.write_file(name, csv_text(columns, rows))

    def page_mark(self) -> str:
        """Return the last line of an up-to-date page: a digest of everything that it shows."""
        return f"<!-- {self.ledger.fingerprint(but=RunFile.REPORT)} -->\n"

    def page_is_current(self) -> bool:
        """Return whether the page exists, is unmodified, and shows the ledger's latest state."""
        with suppress(BadInput):
            page = self._files.read(RunFile.REPORT)
            return page is not None and page.endswith(self.page_mark().encode())
        return False

    def journal(self, name: str) -> Path:
        """Return the path for a journal that a library creates, appends to and locks."""
        self.path.mkdir(parents=True, exist_ok=True)
        return self.path / name

    def write(self) -> None:
        """Write the designs and audits of the ledger, and the best designs.

        Raises:
            BadInput: files of these names exist that the run did not write; all others are written.
        """
        self._write_best()
        for part in RunFile.PARTS:
            (self.path / part).mkdir(parents=True, exist_ok=True)
        valid = set[str]()

        def contents() -> Iterator[tuple[str, bytes]]:
            for n in self.request.task.sizes:
                for key, *texts in self.ledger.texts(n):
                    for part, text in zip(RunFile.PARTS, texts, strict=True):
                        if text is not None:
                            valid.add(name := f"{self._level}{part}/{key}.json")
                            yield name, text.encode()

        self._files.write(contents(), durable=False)
        for part in RunFile.PARTS:
            self._files.remove(name for name in self._files.names_in(self._level + part) if name not in valid)

    def result_of(self, row: Row) -> tuple[Design | None, Audit | None]:
        """Return the design and the audit of a candidate; None for what it lacks."""
        context = self.request.contexts(row.modules)[row.step]
        result = self.ledger.result(context, row.key)
        return result if isinstance(result, Design) else None, self.ledger.audit(context, row.key)

    def changed_files(self) -> list[str]:
        """Return the names of all files that were modified since the run wrote them."""
        return self._files.find_changed()

    def read_files(self, part: str, model: type[Model]) -> dict[str, Model]:
        """Return the values in all of the run's files of one folder, by file name.

        Raises:
            BadInput: one of them is damaged.
        """
        names = (path.rsplit("/", 1)[1] for path in self._files.names_in(f"{self._level}{part}"))
        values = ((name, self.read_file(f"{part}/{name}", model)) for name in names)
        return {name: value for name, value in values if value is not None}

    def read_file(self, name: str, model: type[Model]) -> Model | None:
        """Return the value in one of the run's files; None if the file does not exist.

        Raises:
            BadInput: it is damaged.
        """
        path = f"{self._level}{name}"
        if (content := self._files.read(path)) is None:
            return None
        try:
            return model.model_validate_json(content)
        except ValidationError as error:
            raise BadInput(str(self.path / name), faults_of(error, model)) from None

    def remove_files(self, part: str) -> None:
        """Remove the run's files from one of its folders."""
        self._files.remove(self._files.names_in(f"{self._level}{part}"))

    def _write_best(self) -> None:
        """Write `best.json`, and `best-nN.json` for each of several sizes."""
        sizes = self.request.task.sizes
        best: dict[int, Row | None] = {n: self.ledger.best_clear(n) for n in sizes}
        files = {f"best-n{n}.json": row for n, row in best.items()} if len(sizes) > 1 else {}
        files["best.json"] = best_of(best.values())
        for name, row in files.items():
            self.write_file(name, None if row is None else self.design_text(row))

    def design_text(self, row: Row) -> str | None:
        """Return the design of a row as JSON text."""
        return self.ledger.result_text(self.request.contexts(row.modules)[row.step], row.key)
