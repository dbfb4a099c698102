"""Compiled equations of motion and their integrators. Imports NumPy and Numba only.

Kernels are compiled once and cached on disk. They know a structure as integer tables and a law as
the address of its compiled function, so that neither a new coefficient nor a new law compiles them
again. Kernels trust their input: it is checked where a model is made or called.
"""
