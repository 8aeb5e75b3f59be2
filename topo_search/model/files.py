"""Reading and writing of files: TOML for tasks, JSON for results. A round trip changes nothing."""

import errno
import os
import secrets
from pathlib import Path
from typing import Any, TypeVar

import tomli_w
from pydantic import BaseModel, ValidationError

from topo_search.limits import LIMITS
from topo_search.model.audit import Audit
from topo_search.model.design import Design, Geometry
from topo_search.model.task import Task
from topo_search.model.text import Folder, NotReadable, json_data, read_text
from topo_search.model.value import BadInput, as_bad_input, every_field, faults_of

Model = TypeVar("Model", bound=BaseModel)


def validate(model: type[Model], data: Any, source: str, folder: Folder | None = None) -> Model:
    """Return `data` as a model; BadInput names every fault, `source` first.

    Args:
        model: class of the value.
        data: content of a file.
        source: name of the file in messages.
        folder: folder of the files that the data may name; None: it may not name any.
    """
    try:
        return model.model_validate(data, context=folder)
    except ValidationError as error:
        raise BadInput(source, faults_of(error, model)) from None


def read_json(model: type[Model], path: str | Path) -> Model:
    """Read a value from a JSON file; BadInput names every fault.

    Example:
        >>> from topo_search import Audit, read_json
        >>> read_json(Audit, "hover-2/audits/a10.json").verdict.value
        'clear'
    """
    most_bytes = LIMITS.design_bytes if issubclass(model, Design) else LIMITS.result_bytes
    return validate(model, load_json(path, most_bytes=most_bytes), str(path))


def to_geometry(data: Any, source: str) -> Geometry:
    """Return the design in a file's data, or its geometry if there are no inputs; raises like `validate`."""
    no_inputs = isinstance(data, dict) and "rotor_speeds_squared" not in data
    return validate(Geometry if no_inputs else Design, data, source)


def is_audit(data: Any) -> bool:
    """True if a JSON file's data are those of an audit."""
    return isinstance(data, dict) and data.get("format") == Audit.model_fields["format"].default


def load_json(path: str | Path, *, most_bytes: int = LIMITS.result_bytes) -> Any:
    """Return the data of a JSON file.

    Args:
        path: file to read.
        most_bytes: largest size that is read.

    Raises:
        BadInput: unreadable, too large, not a regular file, or invalid JSON.
    """
    text = load_text(path, most_bytes=most_bytes)
    with as_bad_input(str(path)):
        return json_data(text)


def to_toml(task: Task) -> str:
    """Return a task as TOML text with every field, except those that derive from others.

    >>> from topo_search import read_task
    >>> print(to_toml(read_task("push")).splitlines()[0])
    name = "push"
    """
    return tomli_w.dumps(every_field(task, none=False))


def to_json(value: BaseModel) -> str:
    """Return a value as JSON text."""
    return value.model_dump_json(indent=1, ensure_ascii=True) + "\n"


def write_atomically(path: Path, content: str | bytes, *, durable: bool = True) -> None:
    """Write a file so that readers see either the old or the complete new content, even after a crash.

    Args:
        path: file to write.
        content: new content; text is encoded as UTF-8.
        durable: whether it is on disk on return; otherwise a power cut may leave the file empty.

    Raises:
        OSError: names `path`, which cannot be written or is not a regular file.
    """
    try:
        if path.exists() and not path.is_file():
            raise OSError(errno.EEXIST, "exists, but is not a regular file")
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
        try:
            with partial.open("xb") as stream:
                stream.write(content if isinstance(content, bytes) else content.encode("utf-8"))
                stream.flush()
                if durable:
                    os.fsync(stream.fileno())
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def load_text(path: str | Path, *, most_bytes: int, if_missing: str = "no such file") -> str:
    """Return the text of an untrusted file; BadInput if it is unreadable, too large, not regular or not UTF-8."""
    try:
        return read_text(path, most_bytes=most_bytes)
    except FileNotFoundError:
        rule = if_missing
    except NotReadable as error:
        rule = str(error)
    except OSError as error:
        rule = f"cannot be read: {error.strerror}"
    raise BadInput(str(path), rule)
