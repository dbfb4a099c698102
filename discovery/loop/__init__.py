"""The closed loop: residual, localisation, explanation, decision, refit, until nothing more is accepted.

Belongs here: a stage of the loop, the refits of a kind of campaign (`Refits`), history and result.
May import: all of `discovery` but `discovery.ranking` and `discovery.views`.
"""
