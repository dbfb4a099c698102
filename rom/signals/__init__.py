"""From a record's samples to what is compared and fitted: filters, calibration, corrections, tension bins.

What works on the samples of one record, before any model is fitted to it, belongs here. May import
`rom.campaign`, `rom.model` and `rom.effects`.
"""
