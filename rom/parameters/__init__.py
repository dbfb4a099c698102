"""Published parameter sets, a file per paper. May import `rom.model` and `rom.campaign`."""
