"""What people see of campaigns, models, identifications and responses: prose, tables, figures.

A module for each kind of result; it registers its functions with `rom.result_views`. May import all of `rom`,
and pandas and matplotlib inside functions; nothing in `rom` imports it.
"""

from rom.views import campaign, model, response  # noqa: F401 - they register their views
