"""`ballbar rehearse`: a day at the cell on the bench, with the programs of the day itself."""
