"""Whose a folder is: whether it is a run's, and of which request; any other is refused and left as it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from topo_search.limits import STARTS, TASK_BYTES, TRIALS
from topo_search.model import BadInput, Fault, Task
from topo_search.model.files import validate
from topo_search.model.parsing import NotParsed, toml_data
from topo_search.model.task import before_requirement
from topo_search.study.identity import Request, installed_versions
from topo_search.study.ledger import Ledger
from topo_search.study.lock import HOLDER, LOCK
from topo_search.study.own import NOTHING, Own
from topo_search.study.place import PARTIAL, Place

LEDGER = "ledger.sqlite"
TASK = "task.toml"
REPORT = "report.html"
FRONT = "front.csv"
RESULTS = ("best.json", "candidates.csv", FRONT, REPORT, TASK)
"""Files that tell of a run; with a range of sizes there is a `best-nN.json` of each besides."""
LEFT = "it is left unchanged"
PARTS = ("designs", "audits")
"""Folders with a file per candidate."""


@contextmanager
def hold(path: Path) -> Iterator[Place]:
    """Hold a run's folder."""
    try:
        with Place.open(path) as place:
            yield place
    except NotADirectoryError:
        raise refusal(path, "is a file") from None


def holds_run(place: Place) -> bool:
    """Return whether a folder is that of a run; refuse one that has anything else in it, or lost its ledger."""
    names = place.names()
    if LEDGER in names:
        return True
    if LOCK in names and not HOLDER.fullmatch(place.read(LOCK) or b""):
        raise refusal(place.path, f"has a {LOCK} of another program; {LEFT}")
    others = [name for name in names if name not in (LOCK, PARTIAL)]
    if not others:
        return False
    shown = ", ".join(others[:3]) + (", ..." if len(others) > 3 else "")
    if any(name in (*RESULTS, *PARTS) or name.startswith((LEDGER, "best-n")) for name in others):
        raise refusal(
            place.path, f"has {shown} but no {LEDGER}: the ledger was removed, or this is not a run folder; {LEFT}"
        )
    raise refusal(place.path, f"is not a run folder, and not empty: it has {shown}; {LEFT}")


def last_request(path: Path, place: Place, ledger: Ledger) -> Request:
    """Return the request that a ledger was last given."""
    held = ledger.identity()
    starts, trials = ledger.last_request()
    if starts < 1 or (trials is not None and trials < 1):
        raise BadInput(str(path), [Fault("", "has no run yet")])
    if starts > STARTS or (trials is not None and trials > TRIALS):
        rule = f"must ask for at most {STARTS:,} starts and {TRIALS:,} trials, but holds a run with more"
        raise BadInput(str(path), [Fault("", rule)])
    return Request(
        _read_task(path, place),
        held.symmetry,
        starts,
        held.seed,
        strategy=held.strategy,
        sampler=held.sampler or "moves",
        trials=trials,
        round_size=held.round_size,
        prune=bool(held.prune),
        versions=ledger.versions() or installed_versions(),
        own=held.own or NOTHING,
    )


def require_same(path: Path, request: Request, ledger: Ledger) -> None:
    """Refuse a ledger of another request."""
    held = ledger.identity()
    for name, value in request.identity:
        if (other := getattr(held, name)) != value:
            raise refusal(path, f"holds {_describe_other(name, other, value)}")


def require_versions(path: Path, ledger: Ledger) -> None:
    """Refuse to take up a run whose own functions may have changed since: nobody could tell."""
    own = ledger.identity().own
    if own is not None and own.unversioned:
        names = ", ".join(map(repr, own.unversioned))
        raise refusal(
            path, f"holds a run with {names} of your own, which has no version, so that it cannot be resumed"
        )


def refusal(path: Path, what: str) -> BadInput:
    """Return what to raise for a folder that the run cannot have."""
    return BadInput(str(path), [Fault("", f"{what}; choose another folder with --out")])


def _read_task(path: Path, place: Place) -> Task:
    """Return the task as the run wrote it: it names no other file."""
    content, name = place.read(TASK, most_bytes=TASK_BYTES), str(path / TASK)
    if content is None:
        raise BadInput(name, [Fault("", "no such file")])
    try:
        data = toml_data(content.decode())
    except UnicodeDecodeError as error:
        rule = f"must be UTF-8 text, but got the byte {content[error.start]:#04x} at offset {error.start}"
        raise BadInput(name, [Fault("", rule)]) from None
    except NotParsed as error:
        raise BadInput(name, [Fault("", str(error))]) from None
    return validate(Task, before_requirement(data), name)


def _describe_other(name: str, held: Any, asked: Any) -> str:
    """Say what a folder holds in place of what was asked."""
    if name == "task":
        return "another task"
    if name != "own":
        return f"a run with {name} {held}, not {asked}"
    held, asked = held or NOTHING, asked or NOTHING
    other = [part for part in Own.model_fields if getattr(held, part) != getattr(asked, part)]
    return f"a run with other {' and other '.join(other)}"
