"""XML as simulators read it: numbers that lose nothing, colours, indented text."""

from __future__ import annotations

from xml.etree import ElementTree


def numbers(*values: float) -> str:
    """Return numbers with blanks between them; reading them again gives the same float64."""
    return " ".join(repr(float(value)) for value in values)


def rgba(colour: str, alpha: float = 1.0) -> str:
    """Return a colour like #d55e00 as shares of red, green, blue and opacity."""
    return numbers(*(int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)), alpha)


def xml_text(root: ElementTree.Element) -> str:
    """Return the text of an XML file; indents `root` in place."""
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text.decode() + "\n"
