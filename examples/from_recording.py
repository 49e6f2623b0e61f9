"""Identify a robot from one or several recording folders and write calibration and report.

    ballbar simulate irb2400 --out logs
    python examples/from_recording.py identified logs

A recording folder holds recording.yaml and the device logs; `ballbar new` makes one of your files.
"""

import sys

import ballbar

output, *folders = sys.argv[1:]
recordings = [ballbar.read(folder) for folder in folders]
for folder, recording in zip(folders, recordings, strict=True):
    for finding in recording.report.findings:  # what the reader repaired or left out
        print(f"{folder}, {finding.file}: {finding.kind} ({finding.count} rows)")

result = ballbar.identify(*recordings)
print(result.sentence)
result.save(output)

length = ballbar.load(output).to_frame().loc[("", "ra2"), "value"]
print(f"{output}: joint 2 to joint 3 is {length * 1e3:.3f} mm long")
