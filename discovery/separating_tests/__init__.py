"""Tests that would distinguish two laws or two effects.

Belongs here: a proposer of tests.
May import: `discovery.explain`, `discovery.residual`, `discovery.courses`, `discovery.laws`, criteria and
options, and `rom`; nothing of `discovery.ranking` or `discovery.loop`.
"""
