"""What to do about each kind of warning of an import, in a sentence."""

from __future__ import annotations

REMEDIES = {
    "angles jump": "Start the logger once for each recording.",
    "angles on a grid": "Log more decimals, if the controller has them.",
    "axis beyond its limits": "Name the robot that was recorded, or correct its limits.",
    "axis stands still": "Move every axis; what only that axis shows stays nominal.",
    "beyond axis limits": "Name the robot that was recorded, or correct its limits.",
    "column not used": "What is none of the signals needs nothing; name others as the dialect "
    "does.",
    "counter jumped": "Check the encoder's supply and coupling if nobody reset it.",
    "counter preset": "Preset counters before a recording, not during it.",
    "counter reset": "Leave the encoders powered from the first row to the last.",
    "end of export": "Export it again if rows at the end are missing.",
    "far from the nominal robot": "Name the robot that was measured, or correct the columns.",
    "gap": "Nothing, if they are few: the rows on either side are used. Else lower the load of the "
    "logging computer.",
    "irregular stamp": "Nothing, if the verdict is good. Else do not set clocks while recording.",
    "joints stand still": "Declare the columns of the joint angles in poses.yaml.",
    "length outside the range": "Leave these rows out, or correct the range in the instrument's "
    "file.",
    "long log": "Nothing; to use every row, make several recordings and identify them together.",
    "logger restarted": "Start the logger once for each recording.",
    "loose reference points": "Fasten them, or correct sigma_m of reference in poses.yaml.",
    "lost messages": "Nothing, if they are few. Else lower the load of the network.",
    "missing messages": "Nothing, if they are few. Else record to a faster disk.",
    "moving seat": "Nothing: the values are those of a seat at rest.",
    "no status word": "Log the status words too, to have faults of the encoders found.",
    "no test signals": "Define them in the controller (TestSignDefine) before EGM is started, if "
    "its RobotWare sends them; else record without --egm-torque.",
    "off the sample time": "Export it again if rows are missing.",
    "other joints": "Nothing, if they are of another device; else record a topic that has all.",
    "overrun": "Nothing: such rows are late, and used at their own time.",
    "pause or clock jump": "Nothing, after a pause. Else do not set clocks while recording.",
    "point out of reach": "Leave these rows out, or measure them again.",
    "reference point moved": "Fasten it. Where three or four points are read, it may be another "
    "one: leave out the rows on one side.",
    "repeated pose": "Measure other poses; repeated ones tell of noise only.",
    "rotations off the nominal robot": "State the convention of the rotations in poses.yaml.",
    "scaled channel": "Nothing, if it is in the declared unit; else record it unscaled.",
    "scaling unknown": "Check that no channel was scaled in the Scope.",
    "stale process data": "Nothing, if they are few. Else synchronise the encoders with the bus.",
    "sync error": "Nothing, if they are few. Else synchronise the encoders with the bus.",
    "time of sending": "Nothing: the clock is identified. A newer RobotWare has finer stamps.",
    "unusual period": "Declare the unit of the time column, if it is another.",
    "write-ahead log": "Do so before the recording is read.",
}
