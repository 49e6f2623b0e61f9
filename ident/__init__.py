"""Angles on one clock to identified parameters, their uncertainty and a verdict."""

from ident.identify import identify as identify
from ident.identify import identify_together as identify_together
from ident.options import FitOptions as FitOptions
from ident.options import Listener as Listener
from ident.recording_fit import Logs as Logs
from ident.result import Identification as Identification
from ident.start.automatic import StartError as StartError
from ident.verdict import Verdict as Verdict
