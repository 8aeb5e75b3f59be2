"""Page on the capability of a vehicle with fixed rotors; one file that needs no other."""

from __future__ import annotations

from topo_search.model.flight import Capability
from topo_search.model.proven import lower_text
from topo_search.model.text import html_page, paragraph, table
from topo_search.report.design_part import flight_part

STYLE = """
body { font: 11pt/1.4 sans-serif; max-width: 260mm; margin: 10mm auto; color: #111; background: #fff }
table { border-collapse: collapse; font-size: 9.5pt } th, td { border: 0.3mm solid #999; padding: 1mm 2mm }
"""


def vehicle_page(name: str, rotors: int, capability: Capability) -> str:
    """Return the page.

    Args:
        name: the vehicle's file.
        rotors: how many it has.
        capability: what it can do.
    """
    shown = flight_part(capability.flight)
    verdict = {True: "meets every load case of the task.", False: "does not meet the task.", None: ""}[
        capability.met
    ]
    lines = [
        paragraph(f"{rotors} rotors, rank {capability.rank} of 6. {verdict and f'The vehicle {verdict}'}".strip()),
        paragraph(
            f"Without torque it exerts any force up to {lower_text(capability.zero_torque_ball_N, 5)} N; all such "
            f"forces have a volume of {lower_text(capability.zero_torque_volume_N3, 5)} N³."
        ),
        paragraph(shown["summary"].replace(" of module 0", "")),
        table(shown["cases"].columns, shown["cases"].rows),
        *(paragraph(sentence.replace(" of module 0", "")) for sentence in shown["sentences"]),
    ]
    return html_page(name, STYLE, lines)
