"""Every error source of a scenario, in the order of the page."""

from generators.scenario_reference.plots import Source
from generators.scenario_reference.sources.geometry import GEOMETRY
from generators.scenario_reference.sources.logs import CLOCKS, FORMS, LOADS, LOGGERS
from generators.scenario_reference.sources.plant import BAR, GEARS
from generators.scenario_reference.sources.sensors import ENCODERS, OUTLIERS, PAIRS, ROBOT_SENSORS

GROUPS: dict[str, tuple[Source, ...]] = {
    "Plant: gears and servo": GEARS,
    "Plant: ball-bar and offset plate": BAR,
    "Geometry": GEOMETRY,
    "Robot's angle sensors": ROBOT_SENSORS,
    "Ball-bar encoders": ENCODERS,
    "Clocks and stamps": CLOCKS,
    "Loggers: what stands in the file": (*LOGGERS, OUTLIERS),
    "Forms of the logs": FORMS,
    "Further logs": LOADS,
    "Paired samples": PAIRS,
}
SOURCES = tuple(source for group in GROUPS.values() for source in group)
