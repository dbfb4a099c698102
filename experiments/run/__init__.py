"""How commands run: processes, a cluster, memory, results that are published whole or not at all.

May import `rom` and `discovery`; of `experiments` nothing.
"""
