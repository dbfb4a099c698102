"""How well a model does on records: simulation through the measurement's filters, and measures of error.

May import all of `rom` but `rom.views`.
"""
