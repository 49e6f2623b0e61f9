"""The identified robot in the forms of other programs."""
