"""Names of what a run writes into its folder."""

from cell.files import DESCRIPTIONS

RECORDING = "recording"  # folder of the simulated recording
HELD_OUT = "held_out"  # likewise of the one on accept.held_out_file
CALIBRATION = "calibration.yaml"
IMPORT_REPORT = "import_report.json"
REPORT = "report.html"
REPLAY = "run.rrd"
OUTPUTS = {CALIBRATION, IMPORT_REPORT, REPORT, REPLAY, DESCRIPTIONS}  # of `run` and `identify`
