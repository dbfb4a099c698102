"""Every number that decides a verdict or a rank: a group per room, one frozen object of all groups.

Belongs here: a number whose change can change what is named, accepted, ranked or told apart, with its unit,
its meaning and where it was measured. A number that merely stops an iteration stays with its algorithm.
Those by which records are set aside are in `rom.criteria`. May import: nothing of `discovery`.
"""
