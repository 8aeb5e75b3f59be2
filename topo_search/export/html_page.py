"""Self-contained HTML pages to print."""

from collections.abc import Iterable
from html import escape


def html_page(title: str, style: str, lines: Iterable[str]) -> str:
    """Return a self-contained HTML page with its title as the first heading."""
    head = f'<html lang="en"><head><meta charset="utf-8"/><title>{escape(title)}</title>'
    body = (f"<style>{style}</style></head><body>", f"<h1>{escape(title)}</h1>", *lines, "</body></html>")
    return "\n".join(("<!doctype html>", head, *body)) + "\n"
