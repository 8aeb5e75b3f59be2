"""Formats, nouns and help as a user meets them, from outside the package."""

import inspect
import pydoc
from importlib import metadata
from typing import Any, get_args

import pytest
from commands import invoke
from older import older_task
from own_code import TEXT
from pydantic import BaseModel

import topo_search
from topo_search import (
    Audit,
    BadInput,
    Design,
    OwnFormat,
    Topology,
    compose,
    export_design,
    register_format,
    to_json,
)
from topo_search.export import formats
from topo_search.study import Solved


@pytest.fixture(autouse=True)
def only_ours(monkeypatch):
    """Every test begins with the formats of the package."""
    monkeypatch.setattr(formats, "_registered", {one.name: one for one in formats.BUILT_IN})


def test_a_registered_format_is_written_by_name_and_by_suffix(solved_push, tmp_path):
    register_format(TEXT)
    for out, format in ((tmp_path / "design.own", None), (tmp_path / "design.txt", "plain-text")):
        assert export_design(solved_push, out, format=format) == out
        assert out.read_text().startswith("a70010 ")


@pytest.mark.parametrize(
    "one", [one for one in formats.BUILT_IN if one.reads == "design"], ids=lambda one: one.name
)
def test_our_own_formats_go_through_the_same_door(solved_push, tmp_path, one):
    out = tmp_path / f"design{one.suffixes[0] if one.suffixes else '.csv'}"
    if one.name == "px4":
        with pytest.raises(BadInput, match="PX4 takes at most 12 rotors"):
            export_design(solved_push, out)
    else:
        assert export_design(solved_push, out, format=one.name).stat().st_size > 400


def test_help_lists_every_format():
    text = invoke("export", "--help").stdout
    assert all(f"\n  {one.name:<12}" in text for one in formats.BUILT_IN)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (OwnFormat("Text", str), "name must consist of lower-case letters, digits and dashes, but got 'Text'"),
        (OwnFormat("glb", str), "a format 'glb' exists"),
        (OwnFormat("other", str, (".PNG",)), "a suffix must be new, but format png has .PNG"),
        (OwnFormat("other", str, ("own",)), "a suffix must be a dot and letters or digits, but got 'own'"),
    ],
)
def test_a_format_that_cannot_be_registered_is_refused(own, words):
    with pytest.raises(ValueError, match=words):
        register_format(own)


def test_a_format_that_is_none_is_refused():
    with pytest.raises(ValueError, match="must be an OwnFormat, but got type"):
        register_format(str)


def fails(design):
    raise ValueError("needs two modules")


@pytest.mark.parametrize(
    ("own", "words"),
    [
        (OwnFormat("fails", fails), "fails: needs two modules"),
        (OwnFormat("none", lambda design: None), "none: cannot write a70010: AttributeError"),
        (OwnFormat("broken", lambda design: design.nothing), "broken: cannot write a70010: AttributeError"),
    ],
)
def test_what_a_format_cannot_write_is_told(solved_push, tmp_path, monkeypatch, own, words):
    register_format(own)
    with pytest.raises(BadInput, match=words):
        export_design(solved_push, tmp_path / "out", format=own.name)
    assert not (tmp_path / "out").exists()


def test_an_unknown_format_or_suffix_is_named(solved_push, tmp_path):
    with pytest.raises(BadInput, match=r"must end in \.glb, \.html, \.mjcf"):
        export_design(solved_push, tmp_path / "design.own")
    with pytest.raises(BadInput, match=r"must be one of air, allocation, .* urdf, but got 'plain-text'"):
        export_design(solved_push, tmp_path / "design.own", format="plain-text")


def test_an_installed_package_adds_a_format_to_the_command(solved_push, tmp_path, monkeypatch):
    entry = metadata.EntryPoint("plain-text", "own_code:TEXT", formats.GROUP)
    monkeypatch.setattr(formats.metadata, "entry_points", lambda group: [entry] if group == formats.GROUP else [])
    design = tmp_path / "design.json"
    design.write_text(to_json(solved_push))
    for options in (
        ["--format", "plain-text", "--out", str(tmp_path / "a.txt")],
        ["--out", str(tmp_path / "b.own")],
    ):
        invoke("export", design, *options)
        assert (tmp_path / options[-1]).read_text().startswith("a70010 ")


@pytest.mark.parametrize(
    ("name", "place", "words"),
    [
        ("spans", "own_code:spans", "must be an OwnFormat, but got function"),
        ("gone", "no_such_module:GONE", "cannot be loaded: ModuleNotFoundError"),
    ],
)
def test_an_installed_package_without_its_format_is_named(solved_push, tmp_path, monkeypatch, name, place, words):
    entry = metadata.EntryPoint(name, place, formats.GROUP)
    monkeypatch.setattr(formats.metadata, "entry_points", lambda group: [entry])
    with pytest.raises(BadInput, match=f"{place}: {words}"):
        export_design(solved_push, tmp_path / "design.own")


def values_of(annotation):
    """Every class of values that a field is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}.union(*(values_of(field.annotation) for field in annotation.model_fields.values()))
    return set().union(*map(values_of, get_args(annotation)))


def test_every_class_of_a_task_is_at_the_top():
    missing = [one.__name__ for one in values_of(topo_search.Task) if not hasattr(topo_search, one.__name__)]
    assert missing == []


@pytest.mark.parametrize("noun", ["Task", "Module", "Local", "Design", "Audit"])
def test_help_tells_the_fields(noun):
    value = getattr(topo_search, noun)
    told = pydoc.plain(pydoc.render_doc(value)).splitlines()
    assert len(told[2]) < 120
    assert all(any(f" {name}:" in line for line in told) for name in value.model_fields)
    assert "Annotated" not in str(inspect.signature(value))


# ---- Clearances that survive errors of building, from a task to an audited answer.


def solved(**given: Any) -> Solved:
    forces = ([0.5, 0.0, 0.5], [0.0, 0.5, 0.5])
    cases = [*({"end_effector": {"force": force}} for force in forces), {"com": {"force": [0.0, 0.0, 1.0]}}]
    task = {"name": "push", "modules": 5, "load_cases": cases, "tolerances": {"hinge_angle_deg": 0.2}}
    return compose.solve(older_task({**task, **given}), Topology.from_key("a70010"), starts=8, seed=0)


@pytest.mark.slow
def test_a_design_survives_the_tolerances_where_the_task_asks() -> None:
    drawn, built = solved(flight={"tolerances": False}), solved()
    least = []
    for answer in (drawn, built):
        assert isinstance(answer.outcome, Design)
        assert isinstance(answer.audit, Audit)
        assert answer.audit.verdict == "clear"
        assert answer.audit.sensitivity.tolerances is not None
        least.append(answer.audit.sensitivity.tolerances)
    assert least[0].status == "violated"
    assert least[1].status == "clear"
    assert least[0].lower_m < 0 < least[1].lower_m
    assert drawn.notes == ()
    assert built.notes == ("the audit of the design with margin 0.0001 m is violated",)
    assert drawn.design.objective < built.design.objective < 1.03 * drawn.design.objective
