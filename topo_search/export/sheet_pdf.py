"""The assembly sheet as a PDF: the HTML page's own headings, paragraphs, tables and pictures, on A4."""

import io
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.sax.saxutils import escape

from reportlab.graphics.shapes import Circle, Drawing, Line, Polygon, Shape, String
from reportlab.lib.colors import HexColor
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import Flowable, Paragraph, SimpleDocTemplate, Table

MARGIN, WIDE, NARROW = 12 * mm, 75 * mm, 40 * mm
"""Margin of a page; widths of pictures, those of steps and of the whole platform being wide."""
TEXT = ParagraphStyle(
    "p", fontName="Helvetica", fontSize=10, leading=13, spaceAfter=5, allowWidows=0, allowOrphans=0
)
INTRODUCTION = ParagraphStyle("introduction", TEXT, keepWithNext=1)
HEADINGS = {
    "h1": ParagraphStyle("h1", TEXT, fontName="Helvetica-Bold", fontSize=16, leading=20),
    "h2": ParagraphStyle(
        "h2", TEXT, fontName="Helvetica-Bold", fontSize=12, leading=16, spaceBefore=8, keepWithNext=1
    ),
}
CELL = ParagraphStyle("td", TEXT, fontSize=8, leading=10, spaceAfter=0)
HEAD = ParagraphStyle("th", CELL, fontName="Helvetica-Bold")
PADDING = 4.0
"""Distance of a cell's text from its sides [pt]."""
INK, RULE = HexColor("#111111"), HexColor("#999999")


def sheet_pdf(page: str) -> bytes:
    """Return a sheet, an HTML page as `sheet` makes it, as the content of a PDF file."""
    root = ElementTree.fromstring(page.split("\n", 1)[1])
    content, title = io.BytesIO(), root.findtext("head/title") or ""
    margins = dict.fromkeys(("leftMargin", "rightMargin", "topMargin", "bottomMargin"), MARGIN)
    document = SimpleDocTemplate(content, pagesize=A4, title=title, invariant=1, **margins)

    def number(canvas: Canvas, _: SimpleDocTemplate) -> None:
        canvas.setFont("Helvetica", 8)
        canvas.drawRightString(A4[0] - MARGIN, MARGIN / 2, f"{title}, page {canvas.getPageNumber()}")

    body = root.find("body")
    assert body is not None
    document.build([*_flowables(body, document.width)], onFirstPage=number, onLaterPages=number)
    return content.getvalue()


def _flowables(parent: Element, width: float) -> Iterator[Flowable]:
    """Yield what an element holds, laid out in a width [pt]."""
    elements = [*parent]
    for element, below in zip(elements, [*elements[1:], None], strict=True):
        kind = _tag(element)
        if kind in HEADINGS:
            yield Paragraph(_text(element), HEADINGS[kind])
        elif kind == "p":
            belongs_below = below is not None and _tag(below) in ("table", "section")
            yield Paragraph(_text(element), INTRODUCTION if belongs_below else TEXT)
        elif kind == "table":
            yield _table(element, width)
        elif kind == "svg":
            yield _drawing(element, NARROW)
        elif kind == "section":
            yield _section(element, width)


def _section(section: Element, width: float) -> Table:
    """Return the pictures and texts of a section, side by side, on one page."""
    cells, widths = list[list[Flowable]](), list[float]()
    for element in section:
        kind = _tag(element)
        if kind == "svg":
            is_wide = "step" in element.get("class", "") or section.get("class") == "convention"
            cells.append([_drawing(element, WIDE if is_wide else NARROW)])
            widths.append((WIDE if is_wide else NARROW) + 4 * mm)
        else:
            rest = width - sum(widths)
            cells.append([*_flowables(element, rest)] if kind == "div" else [Paragraph(_text(element), TEXT)])
            widths.append(rest)
    style = [("VALIGN", (0, 0), (-1, -1), "MIDDLE"), ("LINEABOVE", (0, 0), (-1, 0), 0.5, RULE)]
    style += [("LEFTPADDING", (0, 0), (-1, -1), 0), ("RIGHTPADDING", (0, 0), (-1, -1), 0)]
    return Table([cells], widths, style=style, hAlign="LEFT")


def _table(table: Element, width: float) -> Table:
    """Return a table whose columns are as wide as their words, or narrower in proportion to fit."""
    rows = [[_text(cell) for cell in row] for row in table.iter("tr")]
    natural = [
        max(stringWidth(cell, "Helvetica-Bold", CELL.fontSize) for cell in column) + 2 * PADDING + 1
        for column in zip(*rows, strict=True)
    ]
    share = min(1.0, width / sum(natural))
    head, *body = rows
    cells = [[Paragraph(cell, HEAD) for cell in head], *([Paragraph(cell, CELL) for cell in row] for row in body)]
    style = [("GRID", (0, 0), (-1, -1), 0.5, RULE), ("VALIGN", (0, 0), (-1, -1), "TOP")]
    style += [("LEFTPADDING", (0, 0), (-1, -1), PADDING), ("RIGHTPADDING", (0, 0), (-1, -1), PADDING)]
    style += [("TOPPADDING", (0, 0), (-1, -1), 1.5), ("BOTTOMPADDING", (0, 0), (-1, -1), 2.5)]
    return Table(
        cells, [share * x for x in natural], style=style, repeatRows=1, hAlign="LEFT", spaceBefore=2, spaceAfter=6
    )


def _text(element: Element) -> str:
    """Return an element's text as markup, in the characters that every PDF reader has a font for."""
    words = " ".join("".join(element.itertext()).split()).replace("\u2212", "-")
    return escape(words.encode("cp1252", "replace").decode("cp1252"))


def _drawing(svg: Element, width: float) -> Drawing:
    """Return an SVG picture of the sheet, which has polygons, lines, circles and texts only."""
    left, top, across, down = map(float, svg.get("viewBox", "").split())
    scale = width / across
    return Drawing(width, scale * down, *(_shape(element, scale, left, top + down) for element in svg))


def _shape(element: Element, scale: float, left: float, bottom: float) -> Shape:
    """Return a shape of a picture, in points from its lower left corner."""
    given = element.attrib

    def at(x: str | None, y: str | None) -> tuple[float, float]:
        return scale * (float(x or 0) - left), scale * (bottom - float(y or 0))

    stroke = given.get("stroke")
    line = {
        "strokeColor": stroke and _colour(stroke),
        "strokeWidth": scale * float(given.get("stroke-width", 1)),
        "strokeDashArray": [scale * float(x) for x in given.get("stroke-dasharray", "").split()] or None,
    }
    fill = {"fillColor": _colour(given.get("fill", "#000")), "fillOpacity": float(given.get("fill-opacity", 1))}
    match _tag(element):
        case "line":
            ends = at(given.get("x1"), given.get("y1")), at(given.get("x2"), given.get("y2"))
            return Line(*ends[0], *ends[1], **line)
        case "circle":
            return Circle(*at(given.get("cx"), given.get("cy")), scale * float(given["r"]), **line, **fill)
        case "text":
            font = "Helvetica-Bold" if given.get("font-weight") == "bold" else "Helvetica"
            size = scale * float(given["font-size"])
            place = at(given.get("x"), given.get("y"))
            return String(*place, element.text, textAnchor="middle", fontName=font, fontSize=size, **fill)
        case _:
            corners = [number for corner in given["points"].split() for number in at(*corner.split(","))]
            return Polygon(corners, strokeLineJoin=1, **line, **fill)


def _colour(name: str) -> HexColor:
    """Return a colour, `#rgb` or `#rrggbb`."""
    return HexColor(name if len(name) == 7 else "#" + "".join(2 * digit for digit in name[1:]))


def _tag(element: Element) -> str:
    """Return an element's tag without its namespace."""
    return element.tag.rpartition("}")[2]
