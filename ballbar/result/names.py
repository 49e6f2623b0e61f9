"""Names of what a run writes into its folder."""

RECORDING = "recording"  # folder of the simulated recording
HELD_OUT = "held_out"  # likewise of the one on accept.held_out_file
CALIBRATION = "calibration.yaml"
IMPORT_REPORT = "import_report.json"
REPORT = "report.html"
REPLAY = "run.rrd"
DESCRIPTIONS = "descriptions"  # folder of robot, ball-bar and plate files that are not shipped
OUTPUTS = {CALIBRATION, IMPORT_REPORT, REPORT, REPLAY, DESCRIPTIONS}  # of `run` and `identify`
