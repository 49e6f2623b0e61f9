"""Recordings to clean angles and loads, dwells, and a coarse alignment of the clocks."""

from acquisition.alignment import CoarseAlignment as CoarseAlignment
from acquisition.alignment import coarse_alignment as coarse_alignment
from acquisition.dwells import Dwells as Dwells
from acquisition.dwells import find_dwells as find_dwells
from acquisition.explain import explain_lines as explain_lines
from acquisition.recording import Recording as Recording
from acquisition.recording import read_recording as read_recording
from acquisition.report import ImportReport as ImportReport
from acquisition.report import report_lines as report_lines
