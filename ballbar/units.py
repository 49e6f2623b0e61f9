"""Units in which results are shown.

All values are in SI units until the line that shows them; there `error * MM` is a length in mm.
"""

MM = MRAD = MS = 1e3
UM = URAD = US = PPM = 1e6
