"""Candidate laws of the tension: factors of motion and of tension, terms, sums of terms, their names.

Belongs here: a term or a law that can be proposed, and its equation.
May import: `rom` and `discovery.criteria`.
"""
