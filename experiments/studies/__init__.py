"""One module for each command, and studies that are more than a command (the blind test).

May import every other folder of `experiments`; only `rig` here imports the virtual rig.
"""
