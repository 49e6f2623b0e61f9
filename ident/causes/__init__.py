"""Why the logs of a recording do not fit together: tests of wrong columns, scales and files."""

from ballbar.ident.causes.suspects import Causes as Causes
from ballbar.ident.causes.suspects import Suspect as Suspect
from ballbar.ident.causes.suspects import beside_fit as beside_fit
from ballbar.ident.causes.suspects import suspects as suspects
