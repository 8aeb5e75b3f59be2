"""Files made wrong in every way that comes to mind, and a watch on what reading them does."""

import json
import os
import random
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any

LIMIT = 60
"""Seconds after which a command counts as hanging; the machine may be busy."""

NUMBERS = (
    *("nan", "inf", "-inf", "NaN", "Infinity", "-Infinity", "1e308", "-1e308", "1e400", "5e-324", "1e-320"),
    *("-0.0", "-0"),
    *("0", "-1", "1e15", "1e16", "1e-15", "1e-16", "2", "1000000000"),
    *("9" * 30, "9" * 5000, "0x" + "f" * 5000, "1_0", "\u0663", "1e", "--1", "true", "'1'", "[]", "{}", "[1, 2"),
    *("1.5", "3.0", "2**63", str(2**63), str(-(2**63) - 1)),
)
"""Literals that take the place of a number."""

VALUES: tuple[Any, ...] = (
    *(float("nan"), float("inf"), -float("inf"), 1e308, 1e150, 1e15, 1e-15, 1e-150, 5e-324, -1e308, -0.0),
    *(0, -1, 1, 2),
    *(2**63, -(2**63), 10**30, 10**400, 200, 201, 10_000, True, False, "", "com", "free"),
    *("\u0000", "\ud800", "\U0001f600", "../../x", "/dev/zero", "=1+1", "a" * 100_000),
    *([], {}, [[]], [0.0, 0.0, 0.0], [1e308, 1e308, 1e308], [1e-300] * 3),
    *([1.0] * 4, ["a", "b", "c"], {"a": {"a": {"a": {}}}}, [[0.0, 0.0, 0.0]] * 150, [0.0] * 5000, {"force": 1}),
)
"""What takes the place of any value."""


def places(data: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value below some data."""
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*above, key)
        yield from places(data[key], (*above, key))


def restructured(rng: random.Random, data: Any) -> Any:
    """Return data with a few values replaced, taken away, repeated, nested, renamed or moved."""
    data = deepcopy(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        paths = list(places(data))
        if not paths:
            break
        path = rng.choice(paths)
        owner = data
        for key in path[:-1]:
            owner = owner[key]
        key = path[-1]
        match rng.randrange(8):
            case 0:
                del owner[key]
            case 1 if isinstance(owner[key], list):
                owner[key] = owner[key] * rng.choice((0, 2, 30, 300))
            case 2:
                for _ in range(rng.choice((1, 3, 60))):
                    owner[key] = rng.choice(([owner[key]], {"a": owner[key]}))
            case 3 if isinstance(owner, dict):
                owner[rng.choice(("", "x" * 1000, "\u202e", "kind", "mesh", "a.b", "\u0000"))] = owner.pop(key)
            case 4:
                owner[key] = deepcopy(rng.choice([value_at(data, other) for other in paths]))
            case 5 if isinstance(owner[key], int | float):
                owner[key] = owner[key] * rng.choice((-1, 1e-9, 1e9, 1e300, 0.5, 1 + 1e-9))
            case _:
                owner[key] = deepcopy(rng.choice(VALUES))
    return data


def value_at(data: Any, path: tuple[Any, ...]) -> Any:
    """Return what is at a path."""
    for key in path:
        data = data[key]
    return data


def renumbered(rng: random.Random, content: bytes) -> bytes:
    """Return a text with one of its numbers replaced."""
    found = list(re.finditer(rb"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", content))
    if not found:
        return content
    one = rng.choice(found)
    return content[: one.start()] + rng.choice(NUMBERS).encode() + content[one.end() :]


def garbled(rng: random.Random, content: bytes) -> bytes:
    """Return a content with a few bytes changed, put in, taken out, repeated or cut off."""
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 50))):
        if not changed:
            break
        at = rng.randrange(len(changed))
        to = min(len(changed), at + rng.choice((1, 1, 4, 40, 400)))
        match rng.randrange(6):
            case 0:
                changed[at] ^= 1 << rng.randrange(8)
            case 1:
                changed[at:at] = rng.randbytes(rng.choice((1, 3, 30)))
            case 2:
                del changed[at:to]
            case 3:
                changed[at:at] = changed[at:to] * rng.choice((1, 20))
            case 4:
                del changed[at:]
            case _:
                changed[at:to] = rng.choice(
                    (b"\0", b"\xff", b"\xed\xa0\x80", b"[" * 500, b'"""', b"=", b"\r", b"\xe2\x80\xae")
                )
    return bytes(changed)


def mutated_text(
    rng: random.Random, content: bytes, read: Callable[[str], Any], write: Callable[[Any], str]
) -> bytes:
    """Return a text of some format, wrong in its bytes, its numbers or its structure."""
    kind = rng.randrange(4)
    if kind == 0:
        return garbled(rng, content)
    if kind == 1:
        return renumbered(rng, content)
    try:
        return write(restructured(rng, read(content.decode()))).encode("utf-8", "surrogatepass")
    except (TypeError, ValueError):  # what the format cannot hold
        return renumbered(rng, garbled(rng, content))


def as_json(data: Any) -> str:
    """Return data as JSON, with what JSON does not have."""
    sys.set_int_max_str_digits(0)
    try:
        return json.dumps(data, indent=1)
    finally:
        sys.set_int_max_str_digits(4300)


class Hang(BaseException):
    """A command that does not end; no handler of errors takes it for one of its own."""


@contextmanager
def ended_in_time() -> Iterator[None]:
    """Raise Hang where the work inside does not end."""

    def hang(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, hang)
    signal.alarm(LIMIT)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


class Watch:
    """What this process writes, makes, removes or starts outside a folder, while it is watched."""

    WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
    EVENTS = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod")
    PROGRAMS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.connect")

    def __init__(self, folder: Path) -> None:
        self.folder = str(folder.resolve())
        self.seen: list[tuple[str, str]] = []
        self.watching = False
        sys.addaudithook(self._hook)  # for good: nothing takes a hook away

    @contextmanager
    def on(self) -> Iterator[None]:
        """Watch the work inside."""
        self.watching = True
        try:
            yield
        finally:
            self.watching = False

    def _hook(self, event: str, given: tuple[Any, ...]) -> None:
        if not self.watching:
            return
        if event == "open":
            if isinstance(given[0], int) or not (given[2] or 0) & self.WRITING:
                return
        elif event not in self.EVENTS:
            if event in self.PROGRAMS:
                self.seen.append((event, str(given[0])))
            return
        place = os.path.abspath(os.fsdecode(given[0])) if isinstance(given[0], str | bytes | os.PathLike) else ""
        if not place.startswith(self.folder) and place != os.devnull:
            self.seen.append((event, place))
