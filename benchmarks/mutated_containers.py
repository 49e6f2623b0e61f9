"""Files of every container damaged at random, and what the reader makes of them.

    python -m benchmarks.mutated_containers [FILES]

Every outcome is one of
    equal      all rows as they were written, or fewer, where the format has no mark of its end
    reported   read, with a repair or a warning in the report
    refused    an error that names the file
    below      wrong values without a finding, within the smallest deviation looked for, 50 urad
    silent     wrong values beyond that; of a force sensor, wrong values of any size
    crash      an exception that is no refusal; hang: longer than LIMIT_S
largest_silent is in the unit of the log: rad, of a force sensor N and N m, inf for other rows.
peak_MB is the peak of the resident memory up to the end of the family, so no file takes more.
Judged are the angles and times that the recording's reader gives, behind all its checks. Writes
docs/studies/mutated_containers.csv.
"""

from __future__ import annotations

import csv
import resource
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.helpers.damaged_files import OUTCOMES, campaign, families

FILES = 20_000  # of each family
RESULT = Path(__file__).parent.parent / "docs/studies/mutated_containers.csv"


def main(files: int, only: list[str]) -> None:
    """Runs the campaigns of all families, or of some, prints their table and writes it."""
    measured = ("largest_below_rad", "largest_silent", "slowest_s", "peak_MB")
    head = ["family", "files", *OUTCOMES, *measured]
    rows = {}
    if RESULT.is_file():
        with RESULT.open(newline="") as file:
            rows = {row[0]: row for row in csv.reader(file) if row[0] != "family"}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for number, (family, (written, mutations)) in enumerate(families(folder).items()):
            if only and family not in only:
                continue
            tally = campaign(
                written, mutations, files, folder, np.random.default_rng([2026, number])
            )
            outcomes = [str(tally.counts[name]) for name in OUTCOMES]
            sizes = [f"{tally.largest:.1e}", f"{tally.largest_silent:.1e}"]
            slowest = f"{tally.slowest:.2f}"
            peak = str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000)
            rows[family] = [family, str(files), *outcomes, *sizes, slowest, peak]
            print(
                *rows[family], *tally.examples, sep="\n    " if tally.examples else "  ", flush=True
            )
            with RESULT.open("w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([head, *rows.values()])


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else FILES, sys.argv[2:])
