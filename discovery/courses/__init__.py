"""Tension histories of many tests along frozen motion, and fits of laws to them.

Belongs here: what predicts a history, its likelihood, and the fit of one law.
May import: `discovery.laws`, criteria and options, and `rom`.
"""
