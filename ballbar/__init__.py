"""The application: command line, scenarios, comparison, report and replay."""
