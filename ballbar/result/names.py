"""Names of what a run writes into its folder."""

RECORDING = "recording"  # folder of the simulated recording
CALIBRATION = "calibration.yaml"
IMPORT_REPORT = "import_report.json"
REPORT = "report.html"
REPLAY = "run.rrd"
OUTPUTS = {CALIBRATION, IMPORT_REPORT, REPORT, REPLAY}  # of `run` and `identify`
