"""Interface for a user's own file formats.

A function is enough; no base class is needed. An `OwnFormat` is passed to `register_format`, or named by an entry
point of the group `topo_search.formats`.
"""

from collections.abc import Callable
from dataclasses import dataclass

from topo_search.model import Design

DesignWriter = Callable[[Design], str | bytes]
"""Function that returns the file content for a design; the message of a ValueError is shown to the user."""


@dataclass(frozen=True)
class OwnFormat:
    """File format for designs."""

    name: str
    """Value of `--format`: small letters, digits and dashes."""
    write: DesignWriter
    """Function that writes a design."""
    suffixes: tuple[str, ...] = ()
    """File name suffixes of this format, such as `.step`."""
    says: str = ""
    """Short description for `export --help`."""
