"""Where a residual lives: by channel, frequency, amplitude, time, place, and as a force over motion.

Belongs here: mean squares of residuals along a view, and maps of the force that is left unbalanced.
Nothing here decides whether an effect is accepted.
May import: `discovery.residual`, `discovery.courses`, criteria; nothing of `discovery.explain` or
`discovery.loop`.
"""
