"""Identify a robot from a recording folder and write its calibration.

    ballbar simulate irb2400 --out logs
    python examples/from_recording.py logs calibration.yaml

A recording folder holds recording.yaml and the device logs; `ballbar new` makes one from your files.
"""

import sys
from pathlib import Path

from ballbar import identify, load_calibration, load_cell, read_recording, write_calibration

folder, output = Path(sys.argv[1]), Path(sys.argv[2])

recording = read_recording(folder)
for finding in recording.report.findings:  # what the reader repaired or left out
    print(f"{finding.file}: {finding.kind} ({finding.count} rows)")

names = {key: getattr(recording.description, key) for key in ("robot", "ballbar", "plate")}
cell = load_cell(**names, relative_to=folder)
result = identify(cell, recording.robot_log, recording.ballbar_log, recording.force_log)
print(result.verdict.sentence)

write_calibration(output, result, **names)
calibrated = load_calibration(output).geometry
print(f"{output}: joint 2 to joint 3 is {calibrated['ra2'] * 1e3:.3f} mm long")
