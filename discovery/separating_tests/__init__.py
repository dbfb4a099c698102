"""Tests that would tell two laws or two effects apart.

Belongs here: a proposer of tests.
May import: `discovery.courses` and what that may; its module on effects the residuals as well.
"""
