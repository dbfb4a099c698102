"""Numbers that decide what is doubted, suspected, set aside or warned of, each with unit, meaning and origin.

A number that merely stops an iteration stays with its algorithm. May import: nothing of `rom`.
"""
