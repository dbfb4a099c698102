"""From the records of a campaign to the numbers of a model, with their limits.

Estimators belong here: spectra, equation error, output error, the curves of the joint, the loosening law. May
import all of `rom` but `rom.evaluation` and `rom.views`.
"""
