"""The file formats of the field, one module each."""
