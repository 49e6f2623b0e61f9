"""Writes docs/effects.md: every error source of a scenario, one row each, with a small plot of what it does to the logs.

    python -m generators.effects_page           # page, plots and sizes, about half a minute
    python -m generators.effects_page --text    # the page only, from the plots and sizes that are there

What each source is, its parameters and their defaults come from the pydantic models (`parameters`), sizes per machine from the
description files; formulas, origins and remarks stand in `sources`. A plot shows a run with one source minus the same run without
it, unless its axes say otherwise.

    runs -> signals -> plots -> sources -> figures, sizes; sources, parameters -> page
"""
