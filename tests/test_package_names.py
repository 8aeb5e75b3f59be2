"""Functions are named by what they do or return: a verb or a noun, never a participle or an adjective alone."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
IRREGULAR = (
    "begun bent born bought broken built caught chosen drawn driven fed felt flown forgotten found frozen "
    "given gone  grown heard held hidden hung kept known laid learnt led left lent lost made meant met paid "
    "proven said seen sent  shown shrunk sold spent spoken stood stuck sunk swept taken taught thought thrown "
    "told torn understood won worn  woven written"
)
"""Those that are spelt like their verbs (`put`, `read`, `set`) or like nouns (`bound`) are left out."""
ADJECTIVES = (
    "alike bad common consistent deep different distinct due empty exhaustive few finite foreign harmless heavy "
    "idle informative long lossy lopsided noisy possible previous printable relevant same short solvable straight "
    "unchanged unseen whole wide wrong"
)
OTHERS = (
    "above across again along always another apart around aside away below beside better between beyond everyone "
    "far inside inwards nothing outside outwards over together towards why within without"
)
"""Adverbs, prepositions and pronouns; `at`, `of` and `to` before what a function is asked for stay."""
NO_PARTICIPLES = ("breed", "embed", "feed", "need", "proceed", "seed", "speed")
PARTICLES = ("again", "as", "at", "by", "from", "here", "in", "of", "on", "out", "to", "with", "within")
TERMS = {
    "rooted_at": "a rooted tree is what graph theory calls it",
    "rooted_of": "the same",
    "settled": "of `Observer`, which users implement: public names stay",
}


def is_participle(word: str) -> bool:
    """Return whether a word is the past participle of a verb."""
    return word in IRREGULAR.split() or (word.endswith("ed") and word not in NO_PARTICIPLES)


def says_neither_verb_nor_noun(name: str) -> bool:
    """Return whether a name is a participle, or an adjective or adverb that nothing follows."""
    first, *rest = name.strip("_").split("_")
    if is_participle(first):
        return not rest or rest[0] in PARTICLES
    return not rest and first in (*ADJECTIVES.split(), *OTHERS.split())


def functions() -> Iterator[tuple[str, str]]:
    """Yield file and name of every function; properties, like fields, may be adjectives."""
    for package in ("nlp", "topo_search", "verify"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    how = {ast.unparse(each).rsplit(".", 1)[-1] for each in node.decorator_list}
                    if not how & {"property", "cached_property"}:
                        yield str(path.relative_to(ROOT)), node.name


def test_functions_are_verbs_or_nouns() -> None:
    wrong = [f"{file}: {name}" for file, name in functions() if says_neither_verb_nor_noun(name)]
    assert [each for each in wrong if each.split(": ")[1] not in TERMS] == []
    assert {each.split(": ")[1] for each in wrong} == TERMS.keys()  # no term is listed that nothing needs
