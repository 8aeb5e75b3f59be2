"""Judge generated pairs of bodies, mostly difficult ones, and compare every verdict with an independent value.

    PYTHONPATH=tests python tests/benchmarks/pairs.py [--draws N] [--seed S]

Every family has three sizes, with pairs as drawn, and pairs moved until they nearly touch or just overlap, by 0.1
down to 1e-9 arm lengths. The independent value for two envelopes comes from nested golden-section searches; for
thin hulls, walls along an axis and coplanar discs from `verify_families`, for rotors and rods in airflow from
`verify_airflow_families`. The exit status is 1 if a verdict is wrong, inconsistent, or undecided above the floor.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np
from verify_airflow_families import BESIDE, SCALES_BESIDE
from verify_cases import FAMILIES, SCALES, brute_clearance, nearly_touching
from verify_families import JUDGED, SCALES_OF, Judged

from topo_search.model import Status
from verify.bodies import ConeSphere
from verify.certificate import FLOOR, RoundBody, certify_pairs


@dataclass
class Tally:
    """Verdicts on the pairs of one family and size; lengths in l_arm."""

    pairs: int = 0
    clear: int = 0
    violated: int = 0
    undecided: int = 0
    wrong: int = 0
    """Pairs judged clear that overlap, or judged violated that do not."""
    inconsistent: int = 0
    largest_undecided: float = 0.0
    largest_error: float = 0.0
    """Largest difference between the closed form and the independent value."""
    deepest_level: int = 0
    seconds: float = 0.0

    def add(self, pairs: list[tuple[ConeSphere, ConeSphere]]) -> None:
        """Judge pairs and count the verdicts."""
        started = time.perf_counter()
        certificates = certify_pairs([(RoundBody(A), RoundBody(B)) for A, B in pairs])
        self.seconds += time.perf_counter() - started
        for certificate, d in zip(certificates, brute_clearance(pairs).tolist(), strict=True):
            self.count(Judged(certificate, d))

    def count(self, judged: Judged) -> None:
        """Count one verdict."""
        certificate, d = judged.certificate, judged.d
        status = certificate.status
        self.pairs += 1
        self.clear += status == Status.CLEAR
        self.violated += status == Status.VIOLATED
        self.undecided += status == Status.UNDECIDED
        self.inconsistent += status == Status.INCONSISTENT
        self.wrong += (status == Status.CLEAR and d <= 0) or (status == Status.VIOLATED and d >= 0)
        if status == Status.UNDECIDED:
            self.largest_undecided = max(self.largest_undecided, abs(d))
        if judged.exact:
            self.largest_error = max(self.largest_error, abs(certificate.analytic - d))
        self.deepest_level = max(self.deepest_level, certificate.level)

    @property
    def faulty(self) -> bool:
        """True if any verdict is faulty."""
        return bool(self.wrong or self.inconsistent or self.largest_undecided > FLOOR)


def main() -> int:
    """Judge, print, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=31, help="pairs drawn for each family and size")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    print(
        f"{'family':26}{'size':>6}{'pairs':>7}{'clear':>7}{'violated':>9}{'undecided':>10}{'wrong':>6}"
        f"{'inconsistent':>13}{'largest undecided':>18}{'largest error':>14}{'level':>6}{'ms a pair':>10}"
    )
    total, faulty = 0, False
    sizes = {**dict.fromkeys(FAMILIES, SCALES), **SCALES_OF, **SCALES_BESIDE}
    judges = {**JUDGED, **BESIDE}
    for family, scales in sizes.items():
        for scale in scales:
            tally = Tally()
            for _ in range(arguments.draws):
                if family in FAMILIES:
                    tally.add(nearly_touching(family, scale, rng))
                    continue
                started = time.perf_counter()
                for judged in judges[family](scale, rng):
                    tally.count(judged)
                tally.seconds += time.perf_counter() - started
            print(
                f"{family:26}{scale:>6g}{tally.pairs:>7}{tally.clear:>7}{tally.violated:>9}{tally.undecided:>10}"
                f"{tally.wrong:>6}{tally.inconsistent:>13}{tally.largest_undecided:>18.1e}"
                f"{tally.largest_error:>14.1e}{tally.deepest_level:>6}{1e3 * tally.seconds / tally.pairs:>10.2f}",
                flush=True,
            )
            total += tally.pairs
            faulty |= tally.faulty
    print(f"{total} pairs: {'FAULTS' if faulty else 'no verdict is wrong, and none is missing above the floor'}")
    return int(faulty)


if __name__ == "__main__":
    sys.exit(main())
