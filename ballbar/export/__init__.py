"""The identified robot for other programs: models, tables, data of controllers, JSON."""
