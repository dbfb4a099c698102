"""What a campaign would have shown: the smallest strength of every effect of the catalogue that is found.

Belongs here: what an effect of a strength adds to a residual, and the probability that it passes the tests by
which a closed loop names an effect. The tests themselves are in `discovery.decide`, their numbers in
`discovery.criteria`.
May import: `discovery.explain` and what is below it, and `rom`.
"""
