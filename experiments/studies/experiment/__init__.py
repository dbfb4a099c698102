"""Experiments as files: every cell of a table of campaigns, laws, searches, criteria and seeds, run once.

What a file says (settings), its cells (cells), how one is run (cell), all of them (run), their numbers as a
table (table), the command (command). May import `discovery`, `rom` and `experiments.studies`.
"""
