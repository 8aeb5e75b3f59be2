"""Lines on reserves and failures, in the audit's text and on the page."""

import pytest
from report_cases import Reader, flight
from verify_cases import fan
from wording import says

from topo_search.cli.tables import audit_lines
from topo_search.export.audits import flight_lines
from topo_search.model import CaseFlight, RotorsOut
from topo_search.report.design_page import design_page
from topo_search.report.page import render
from verify import audit


def test_the_lines_are_rounded_to_the_side_on_which_they_are_proven() -> None:
    parts = [
        ("hovers", "0.119 N towards -y", "7 of 8"),
        ("torque", "0.25 N m about [0.60, 0.00, 0.80]"),
        ("load factor", "1.024", "load case 0"),
        ("hover", "survives 7 of 8, not rotor 3 of module 1"),
        ("all load cases", "survives 6 of 8, not rotor 3 of module 1", "undecided rotor 0 of module 0"),
        ("moment in a joint", "1.24 N m and 3.21 N", "modules 0 and 1", "load case 0"),
        ("50 %", "25 % more power"),
        ("spans 0.75 m",),
    ]
    for line, expected in zip(flight_lines(flight()), parts, strict=True):
        assert says(line, *expected), line


@pytest.mark.parametrize(
    ("hover", "out", "words"),
    [
        ({"possible": False}, {}, "cannot hover"),
        ({"possible": None}, {}, "leaves undecided whether it can hover"),
        ({}, {"undecided": ((0, 1),)}, "hovers; survives 7 of 8 single rotor failures, once known (1 undecided)"),
        ({}, {"hover_only": 1}, "hovers; survives 7 of 8 single rotor failures, once known; can only hover: 1"),
    ],
)
def test_what_is_not_proven_is_not_claimed(hover: dict, out: dict, words: str) -> None:
    case = CaseFlight(name="hover", **{"possible": True, **hover})
    found = flight(cases=(case,), rotors_out_hover=RotorsOut(survive=7, of=8, **out))
    assert found.weakest_point == words
    assert found.load_factor is None
    assert not any("load factor" in line for line in flight_lines(found))


def test_many_rotors_are_counted() -> None:
    lost = tuple((i, q) for i in range(3) for q in range(4))
    lines = list(flight_lines(flight(rotors_out_hover=RotorsOut(survive=0, of=12, lost=lost))))
    assert "hover with one rotor known to be dead: survives 0 of 12" in lines
    lines = list(flight_lines(flight(rotors_out_hover=RotorsOut(survive=0, of=12, undecided=lost))))
    assert any(line.endswith("survives 0 of 12, undecided 12 rotors") for line in lines)


def test_text_and_page_of_an_audit_tell_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    given = fan({"load_cases": [{"com": {"force": [0.0, 0.0, 1.2]}}]})
    found = audit(given)
    assert found.flight is not None
    lines = list(flight_lines(found.flight))
    print(*audit_lines("fan.json", found, details=True), sep="\n")
    text = capsys.readouterr().out.splitlines()
    page = Reader(render(design_page(given, found, "fan.json")))
    for line in lines:
        assert f"  {line}" in text
        assert f"{line[0].upper()}{line[1:]}." in page.text
    for cell in ("load case 0", "port +x of module 0 to module 1", "about the hinge", "side force"):
        assert cell in page.text


def test_an_audit_without_figures_says_nothing_of_them(capsys: pytest.CaptureFixture[str]) -> None:
    given = fan()
    found = audit(given).model_copy(update={"flight": None})
    print(*audit_lines("fan.json", found), sep="\n")
    assert "hover" not in capsys.readouterr().out
    assert "Beyond the task" not in Reader(render(design_page(given, found, "fan.json"))).text
