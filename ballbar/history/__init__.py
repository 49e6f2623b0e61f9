"""The results of one robot over months: what wears, what stepped, when to calibrate again."""
