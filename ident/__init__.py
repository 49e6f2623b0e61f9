"""Arrays to parameters: residuals, solver, start, identifiability, uncertainty. Knows neither the simulator nor the truth."""

from ident.identify import Identification as Identification
from ident.identify import Logs as Logs
from ident.identify import identify as identify
from ident.identify import identify_together as identify_together
