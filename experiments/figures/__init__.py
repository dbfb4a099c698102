"""Figures of result files and of records: data in, figure out, one style.

May import `experiments.text`, `discovery.views` and `rom`.
"""
