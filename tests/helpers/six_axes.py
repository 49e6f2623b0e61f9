"""The parameter table of the IRB 2400 and the NJ 220: six axes, the second and third parallel."""

from ballbar.cell.geometry import parameter_table
from ballbar.cell.load import load_robot
from ballbar.ident.estimator.priors import fixed_names, shared_names
from ballbar.ident.estimator.thesis_names import extra_parameters, thesis_parameters

TABLE = parameter_table(load_robot("irb2400"))
PARAMETERS, NAMES, INDEX = TABLE.parameters, TABLE.names, TABLE.index
PLATE, FIXED, SHARED = TABLE.plate, fixed_names(TABLE), shared_names(TABLE)
THESIS_PARAMETERS, EXTRA_PARAMETERS = thesis_parameters(TABLE), extra_parameters(TABLE)
