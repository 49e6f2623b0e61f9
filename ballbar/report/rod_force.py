"""Force in the rod as text: its size, and the signal that it was determined from."""

from __future__ import annotations

from ballbar.report.numbers import fixed
from ident.result import RecordingEstimate

TENSION_SOURCES = {
    "sensor": "from the force sensor",
    "torque": "from the motor torques",
    "none": "from the geometry alone",
    "instrument": "from the length",
}
_METHODS = {
    "sensor": "biases and gains of the sensor fitted, its clock aligned with the load predicted",
    "torque": (
        "friction and gains of the motors fitted; near a reversal of its joint a torque is not "
        "used, for friction is discontinuous there"
    ),
    "none": (
        "no force was logged, or none was requested; the rod's force is what makes the loop close"
    ),
    "instrument": "fitted as a constant, the spring of the sensor and the friction of its slide",
}


def tension_sentence(estimate: RecordingEstimate) -> str:
    """Smallest and largest force, tension positive; empty where no loads were needed."""
    if estimate.tension is None:
        return ""
    least, most = (
        fixed(float(force), 0) for force in (estimate.tension.min(), estimate.tension.max())
    )
    source = estimate.tension_source
    return f"{least} to {most} N, {TENSION_SOURCES[source]} ({_METHODS[source]})."
