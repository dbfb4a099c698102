"""The blind test: how often, and how well, a closed loop finds what a campaign of the virtual rig hides.

It is an experiment's file: its campaigns (trials), what is measured of each (measure) and could be reached
(oracle), a closure against the truth (scores), results of cells and as one table (results), tables for people
(tables). May import `discovery`, `rom` and `experiments.studies`.
"""
