"""Identify a robot from one or several recording folders and write its calibration.

    ballbar simulate irb2400 --out logs
    python examples/from_recording.py calibration.yaml logs

A recording folder holds recording.yaml and the device logs; `ballbar new` makes one of your files.
"""

import sys
from pathlib import Path

from ballbar import identify_recordings, load_calibration, write_calibration

output, *folders = map(Path, sys.argv[1:])
data = identify_recordings(folders)

for name, _, recording in data.read:
    for finding in recording.report.findings:  # what the reader repaired or left out
        print(f"{name}, {finding.file}: {finding.kind} ({finding.count} rows)")
print(data.identification.verdict.sentence)

write_calibration(output, data)
calibrated = load_calibration(output).geometry
print(f"{output}: joint 2 to joint 3 is {calibrated['ra2'] * 1e3:.3f} mm long")
