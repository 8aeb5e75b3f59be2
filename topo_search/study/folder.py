"""The run folder: the ledger, and files made from it for people and other programs.

A folder belongs to a run if it has its ledger, and to one request alone. Any other must be empty, or it is refused
and left unchanged. In a run's folder only files that the run wrote itself are replaced or removed (`directory`).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

from pydantic import BaseModel, ValidationError

from topo_search.limits import LIMITS
from topo_search.model import Audit, BadInput, Design, Proof, ResolvedTask, Task
from topo_search.model.files import to_toml, validate
from topo_search.model.task import with_older_defaults
from topo_search.model.text import csv_text, decode, toml_data
from topo_search.model.value import faults_of, naming
from topo_search.study.directory import Directory, ReadOnlyFolder, RunFile
from topo_search.study.ledger import COLUMNS, Ledger, Row
from topo_search.study.ledger_file import blank
from topo_search.study.proofs import ProofState, bounded_alike, cells, proof_state
from topo_search.study.request import NOTHING, Own, Request, installed_versions

Model = TypeVar("Model", bound=BaseModel)


def holds_run(directory: Directory) -> bool:
    """Return whether a folder is that of a run; refuse one that has anything else in it, or lost its ledger."""
    names = directory.names()
    if RunFile.LEDGER in names:
        return True
    others = [name for name in names if name not in (RunFile.LOCK, RunFile.PARTIAL)]
    if not others:
        return False
    left = "it is left unchanged"
    shown = ", ".join(others[:3]) + (", ..." if len(others) > 3 else "")
    if any(
        name in (*RunFile.RESULTS, *RunFile.PARTS) or name.startswith((RunFile.LEDGER, "best-n")) for name in others
    ):
        raise refusal(
            directory.path,
            f"has {shown} but no {RunFile.LEDGER}: the ledger was removed, or this is not a run folder; {left}",
        )
    raise refusal(directory.path, f"is not a run folder, and not empty: it has {shown}; {left}")


def last_request(path: Path, directory: Directory, ledger: Ledger) -> Request:
    """Return the request that a ledger was last given."""
    held = ledger.identity()
    starts, trials = ledger.last_request()
    if starts < 1:
        raise BadInput(str(path), "has no run yet")
    try:
        return Request(
            _read_task(path, directory),
            held.symmetry,
            starts,
            held.seed,
            strategy=held.strategy,
            sampler=held.sampler or "moves",
            trials=trials,
            round_size=held.round_size,
            prune=bool(held.prune),
            versions=ledger.versions() or installed_versions(),
            user_inputs=held.own or NOTHING,
        )
    except ValueError as error:
        raise BadInput(str(path), f"holds a run that cannot be asked for: {error}") from None


def require_same(path: Path, request: Request, ledger: Ledger) -> None:
    """Refuse a ledger of another request."""
    held = ledger.identity()
    for name, value in request.identity:
        if (other := getattr(held, name)) != value:
            raise refusal(path, f"holds {_describe_other(name, other, value)}")


def require_versions(path: Path, ledger: Ledger) -> None:
    """Refuse to take up a run whose own functions may have changed since its first result: nobody could tell."""
    user_inputs = ledger.identity().own
    if user_inputs is not None and user_inputs.unversioned and ledger.versions() is not None:
        names = ", ".join(map(repr, user_inputs.unversioned))
        own_code = f"{names} of your own, which has no version"
        raise refusal(path, f"holds a run with {own_code}, so that it cannot be resumed")


def make_folder(path: Path) -> None:
    """Make a folder unless it is there; BadInput if it cannot be."""
    if os.path.lexists(path) and not path.is_dir():
        raise refusal(path, "is a file")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refusal(path, f"cannot be made: {error.strerror}") from None


def refusal(path: Path, what: str) -> BadInput:
    """Return what to raise for a folder that the run cannot have."""
    return BadInput(str(path), f"{what}; choose another folder with --out")


def _read_task(path: Path, directory: Directory) -> Task:
    """Return the task as the run wrote it: it names no other file."""
    content, name = directory.read(RunFile.TASK, most_bytes=LIMITS.task_bytes), str(path / RunFile.TASK)
    if content is None:
        raise BadInput(name, "no such file")
    with naming(name):
        data = toml_data(decode(content))
    return validate(Task, with_older_defaults(data), name)


def _describe_other(name: str, held: Any, requested: Any) -> str:
    """Say what a folder holds in place of what was requested."""
    if name == "task":
        return "another task"
    if name != "own":
        return f"a run with {name} {held}, not {requested}"
    held, requested = held or NOTHING, requested or NOTHING
    other = [part for part in Own.model_fields if getattr(held, part) != getattr(requested, part)]
    return f"a run with other {' and other '.join(other)}"


class RunFolder:
    """The folder of one request, held by this process alone."""

    def __init__(self, path: Path, request: Request, ledger: Ledger, directory: Directory, level: str = "") -> None:
        """Take a folder whose ledger is open; `level` is its part for one level of the goals, `levels/0/`."""
        self.path = path
        self.request = request
        self.ledger = ledger.of(context for n in request.task.sizes for context in request.contexts(n))
        self._directory = directory
        self._files = ledger.files_in(directory)
        self._level = level

    @classmethod
    @contextmanager
    def open(cls, path: Path, request: Request) -> Iterator[Self]:
        """Make a run's folder, or take it up again.

        Raises:
            ReadOnlyFolder: it is there, but cannot be written to.
            BadInput: it holds another run or something else, or another process works in it; it is left unchanged.
        """
        make_folder(path)
        with Directory.open(path) as directory:
            if not holds_run(directory):
                with directory.lock():
                    if not holds_run(directory):  # else another process was faster
                        identity = request.identity.model_dump_json(exclude_defaults=True)
                        directory.write(RunFile.LEDGER, blank(identity))
        with cls.load(path, request, writes=True) as folder:
            folder._directory.tidy()
            folder._files.require((*RunFile.RESULTS, *(f"best-n{n}.json" for n in request.task.sizes)))
            folder.ledger.ask(request.starts, request.trials)
            folder.keep(RunFile.TASK, to_toml(request.task))
            yield folder

    @classmethod
    @contextmanager
    def load(cls, path: Path, request: Request | None = None, *, writes: bool = False) -> Iterator[Self]:
        """Open the folder of any run to read it.

        Args:
            path: the folder.
            request: what it must be the folder of; None: the request that it was last given.
            writes: whether a file is to be kept there; then no other process may work in it.

        Raises:
            ReadOnlyFolder: it cannot be written to, but should be.
            BadInput: it is not a run folder, or another process works in it.
        """
        with Directory.open(path) as directory:
            if RunFile.LEDGER not in directory.names():
                raise BadInput(str(path), f"is not a run folder: it has no {RunFile.LEDGER}")
            if writes and not os.access(path / RunFile.LEDGER, os.W_OK):
                raise ReadOnlyFolder(path, f"{RunFile.LEDGER} is read-only")
            with ExitStack() as stack:
                if writes:
                    stack.enter_context(directory.lock())
                ledger = stack.enter_context(Ledger.open(path / RunFile.LEDGER, read_only=not writes))
                if request is None:
                    request = last_request(path, directory, ledger)
                else:
                    require_versions(path, ledger)
                require_same(path, request, ledger)
                yield cls(path, request, ledger, directory)

    @cached_property
    def levels(self) -> tuple[RunFolder, ...]:
        """The folder of each level of the goals; that of a run without goals is this one."""
        if not self.request.task.goals.names:
            return (self,)
        return tuple(
            RunFolder(self.path / level, request, self.ledger, self._directory, level)
            for level, request in ((f"levels/{k}/", request) for k, request in enumerate(self.request.levels))
        )

    def keep(self, name: str, content: str | None) -> None:
        """Write a file of the run's own, unless it holds that already; None: remove it, if it is there.

        Raises:
            BadInput: it is there, but the run did not write it.
            OSError: it cannot be written.
        """
        if content is None:
            self._files.remove([self._level + name])
        else:
            self._files.keep([(self._level + name, content.encode())])

    def keep_table(self, name: str, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
        """Write a file of the run's own as CSV; errors as of `keep`."""
        self.keep(name, csv_text(columns, rows))

    def page_mark(self) -> str:
        """Return the last line of a page that is written now: a digest of all that it shows."""
        return f"<!-- {self.ledger.fingerprint(but=RunFile.REPORT)} -->\n"

    def page_is_current(self) -> bool:
        """Return whether the page is there, as the run wrote it, and nothing that it shows has changed since."""
        page = self._directory.read(RunFile.REPORT)
        return (
            page is not None
            and page.endswith(self.page_mark().encode())
            and not self._files.is_changed(RunFile.REPORT, page)
        )

    def journal(self, name: str) -> Path:
        """Return where a library may keep a journal, which it makes anew and locks.

        Raises:
            BadInput: a file is there that the run did not make.
        """
        if self._level:
            self._directory.make(self._level.rstrip("/"))
        self._files.adopt(self._level + name, f"{self._level}{name}.lock")
        return self.path / name

    def write(self) -> None:
        """Bring all files of the folder up to the ledger.

        Raises:
            BadInput: files are in the way that the run did not write; all others are written.
        """
        self.keep_table("candidates.csv", COLUMNS, (row for n in self.request.task.sizes for row in self.cells(n)))
        self._write_best()
        for part in RunFile.PARTS:
            self._directory.make(self._level + part)
        valid = set[str]()

        def contents() -> Iterator[tuple[str, bytes]]:
            for n in self.request.task.sizes:
                for key, *texts in self.ledger.texts(n):
                    for part, text in zip(RunFile.PARTS, texts, strict=True):
                        if text is not None:
                            valid.add(name := f"{self._level}{part}/{key}.json")
                            yield name, text.encode()

        self._files.keep(contents(), lasting=False)
        for part in RunFile.PARTS:
            self._files.remove(name for name in self._files.names_in(self._level + part) if name not in valid)

    def candidates(self, n: int) -> Iterator[tuple[Row, ProofState, Audit | None]]:
        """Yield every candidate of n modules, least control effort first, with its proof and its audit."""
        proofs, best, contexts = self.proofs(n), self.ledger.best_clear(n), self.request.contexts(n)
        for row in self.ledger.ranking(n):
            state = proof_state(row, proofs.get(row.key), None if best is None else best.objective)
            yield row, state, self.ledger.audit(contexts[row.step], row.key) if row.audit else None

    def result_of(self, row: Row) -> tuple[Design | None, Audit | None]:
        """Return the design and the audit of a candidate, as far as it has them."""
        context = self.request.contexts(row.modules)[row.step]
        result = self.ledger.result(context, row.key)
        return result if isinstance(result, Design) else None, self.ledger.audit(context, row.key)

    def cells(self, n: int) -> Iterator[list[object]]:
        """Yield the row of every ranked candidate of n modules in `candidates.csv`."""
        return (cells(*candidate) for candidate in self.candidates(n))

    def changed_files(self) -> list[str]:
        """Return the names of all files whose content is not what the run wrote."""
        return self._files.find_changed()

    def proofs(self, n: int) -> dict[str, Proof]:
        """Return the proofs of candidates of n modules by key: those of this very task.

        Raises:
            BadInput: one of them is damaged, or contradicts a design.
        """
        task = self.request.contexts(n)[0].task
        return {proof.topology_key: proof for proof in self._sound_proofs(n) if proof.task == task}

    def proofs_for(self, task: ResolvedTask) -> dict[str, Proof]:
        """Return the complete proofs that hold for a task of another run as well, as that run's own, by key.

        Raises:
            BadInput: one of them is damaged, or contradicts a design.
        """
        held = [proof for proof in self._sound_proofs(task.n) if proof.complete and bounded_alike(proof.task, task)]
        return {proof.topology_key: proof.model_copy(update={"task": task}) for proof in held}

    def _sound_proofs(self, n: int) -> Iterator[Proof]:
        """Yield all proofs of the folder; none of n modules may exclude a design whose audit is clear."""
        if not (proofs := self.read_within(RunFile.PROOFS, Proof)):
            return
        clear = {row.key: row.objective for row in self.ledger.ranking(n) if row.clear}
        for name, proof in proofs.items():
            design = clear.get(proof.topology_key)
            if proof.task.n == n and proof.complete and design is not None and design < proof.cut:
                rule = (
                    f"proves J >= {proof.cut!r} rad^4/s^4 of a tree with an audited design of {design!r}: "
                    "remove it, and run `topo-search prove` again"
                )
                raise BadInput(str(self._directory.path / RunFile.PROOFS / name), rule)
            yield proof

    def read_within(self, part: str, model: type[Model]) -> dict[str, Model]:
        """Return the values that the run wrote into one of its folders, by the names of their files.

        Raises:
            BadInput: one of them is damaged.
        """
        names = (path.rsplit("/", 1)[1] for path in self._files.names_in(f"{self._level}{part}"))
        values = ((name, self.read_own(f"{part}/{name}", model)) for name in names)
        return {name: value for name, value in values if value is not None}

    def read_own(self, name: str, model: type[Model]) -> Model | None:
        """Return the value that the run wrote into one of its files; None if the file is not there.

        Raises:
            BadInput: it is damaged.
        """
        path = f"{self._level}{name}"
        if (content := self._files.read(path)) is None:
            return None
        try:
            return model.model_validate_json(content)
        except ValidationError as error:
            raise BadInput(str(self._directory.path / path), faults_of(error, model)) from None

    def drop_within(self, part: str) -> None:
        """Remove what the run wrote into one of its folders."""
        self._files.remove(self._files.names_in(f"{self._level}{part}"))

    def _write_best(self) -> None:
        """Write `best.json`, and `best-nN.json` of every size where there are several."""
        sizes = self.request.task.sizes
        best: dict[int, Row | None] = {n: self.ledger.best_clear(n) for n in sizes}
        files = {f"best-n{n}.json": row for n, row in best.items()} if len(sizes) > 1 else {}
        files["best.json"] = next((row for row in best.values() if row is not None), None)
        for name, row in files.items():
            self.keep(name, None if row is None else self.text(row))

    def text(self, row: Row) -> str | None:
        """Return the design of a row as JSON text."""
        return self.ledger.design(self.request.contexts(row.modules)[row.step], row.key)
