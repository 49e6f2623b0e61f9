"""Names of what a run writes into its folder."""

from ballbar.cell.files import DESCRIPTIONS

RECORDING = "recording"  # folder of the simulated recording
HELD_OUT = "held_out"  # folder of the recording on accept.held_out_file
CALIBRATION = "calibration.yaml"
REFUSED = "calibration.refused.yaml"  # in its place, where the reader of results refuses it
IMPORT_REPORT = "import_report.json"
REPORT = "report.html"
REPLAY = "run.rrd"
# of the process that writes a replay: Arrow looks for pandas at Rerun's first array
REPLAY_MODULES = ("rerun", "ballbar.replay.write", "pandas")
# Of `run` and `identify`, from logs and from still poses
OUTPUTS = {CALIBRATION, REFUSED, IMPORT_REPORT, REPORT, REPLAY, DESCRIPTIONS}
