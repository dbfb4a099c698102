"""Residuals: what a model leaves over of the measured records, in units of noise, and its free numbers.

Belongs here: a module for each kind of residual (output error of the motion, balance of forces, tension)
and the fits of a model's own numbers that it needs. A residual knows no effect but those of its model.
May import: `discovery.courses`, `discovery.laws`, criteria and options, and `rom`.
"""
