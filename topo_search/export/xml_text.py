"""XML as simulators read it: numbers that lose nothing, indented text."""

from __future__ import annotations

from xml.etree import ElementTree


def numbers(*values: float) -> str:
    """Return numbers with blanks between them; reading them again gives the same float64."""
    return " ".join(repr(float(value)) for value in values)


def xml_text(root: ElementTree.Element) -> str:
    """Return the text of an XML file; indents `root` in place."""
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text.decode() + "\n"
