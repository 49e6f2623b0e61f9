"""Recordings to clean angles and loads: device tables, counts and motor angles to rad, stillness, coarse clock alignment."""

from acquisition.alignment import CoarseAlignment as CoarseAlignment
from acquisition.alignment import coarse_alignment as coarse_alignment
from acquisition.explain import explain_lines as explain_lines
from acquisition.recording import Recording as Recording
from acquisition.recording import read_recording as read_recording
from acquisition.report import ImportReport as ImportReport
from acquisition.report import report_lines as report_lines
from acquisition.stillness import Stillness as Stillness
from acquisition.stillness import stillness as stillness
