"""Writes docs/scenario_reference.md: every key of a scenario, every error source with a small plot.

    python -m generators.scenario_reference           # page, plots and sizes, about half a minute
    python -m generators.scenario_reference --text    # the page, plots as they are

Keys, their limits, defaults and meaning come from the pydantic models (`keys`), sizes per machine
from the description files; formulas, origins and remarks stand in `sources`. A plot shows a run
with one source minus the same run without it, unless its axes say otherwise.

    runs -> signals -> plots -> sources -> figures; sources, keys -> page
"""
