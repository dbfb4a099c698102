"""The blind test: how often, and how well, a closed loop finds what a campaign of the virtual rig hides.

Campaigns (trials), what could be reached (oracle), a closure against the truth (scores), results as files and
as one table (results), tables for people (tables). May import `discovery`, `rom` and `experiments.studies`.
"""
