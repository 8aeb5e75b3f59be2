"""What users read is written in the standard terms of the field: no phrase of `docs/phrases.txt` is left."""

import ast
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from documented import PAGES, ROOT

from topo_search.cli import main

PHRASES = dict(
    line.split(" -> ")
    for line in (ROOT / "docs/phrases.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
)


def pages() -> Iterator[tuple[str, str]]:
    """Yield what is read as it stands, by its name."""
    for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "topo_search/report/templates/page.html.j2"):
        yield name, (ROOT / name).read_text(encoding="utf-8")
    for path in sorted(PAGES.rglob("*.md")):
        yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
    for name, command in main.commands.items():
        yield f"{name} --help", command.get_help(click.Context(command, info_name=name))


def messages() -> Iterator[tuple[str, str]]:
    """Yield the texts in the code that are not docstrings: messages, answers, headings."""
    for room in ("topo_search", "nlp", "verify"):
        for path in sorted((ROOT / room).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            statements = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
            texts = [
                node.value
                for node in ast.walk(tree)
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in statements
            ]
            yield str(path.relative_to(ROOT)), "\n".join(texts)


def docstrings_and_comments() -> Iterator[tuple[str, str]]:
    """Yield every docstring and comment of the code, with the name of its file."""
    for room in ("topo_search", "nlp", "verify"):
        for path in sorted((ROOT / room).rglob("*.py")):
            source, name = path.read_text(encoding="utf-8"), str(path.relative_to(ROOT))
            for token in tokenize.generate_tokens(iter(source.splitlines(keepends=True)).__next__):
                if token.type == tokenize.COMMENT:
                    yield name, token.string
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                    yield name, str(node.value.value)


@pytest.mark.parametrize("read", [pages, messages, docstrings_and_comments])
def test_no_phrase_of_the_word_list_is_left(read):
    found = [
        f"{name}: {phrase!r}, better: {better}"
        for name, text in read()
        for line in [re.sub(r"\s+", " ", text)]
        for phrase, better in PHRASES.items()
        if phrase.lower() in line.lower() and re.search(rf"\b{re.escape(phrase)}(?!\w)", line, re.IGNORECASE)
    ]
    assert found == []


def test_docstrings_say_what_they_are_of():
    assert [name for name, text in docstrings_and_comments() if text.startswith("Of ")] == []


def test_every_page_has_one_title():
    for path in sorted(Path(PAGES).rglob("*.md")):
        text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        assert len(re.findall(r"^# ", text, re.MULTILINE)) == 1, path
