"""Names of what a run writes into its folder."""

RECORDING = "recording"  # folder of the simulated recording
REPORT = "report.html"
IMPORT_REPORT = "import_report.json"
