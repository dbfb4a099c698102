"""Result files in plain words, equations and tables; every number comes from a file.

A module for each kind of result file. May import `discovery.views`, `discovery` and `rom`; of
`experiments` nothing.
"""
