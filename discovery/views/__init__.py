"""What people see of a closed loop and of a ranking: prose, tables, figures.

A module for each kind of result; it registers its functions with `rom.result_views`. May import all of
`discovery` and `rom`, and pandas and matplotlib inside functions; nothing in `discovery` imports it.
"""

from discovery.views import closure, ranking  # noqa: F401 - they register their views
