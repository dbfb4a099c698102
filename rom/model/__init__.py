"""The reduced-order model: structure, laws, what an effect is, its simulation on the kernels, and its file.

`description` says what a model is; `assembly`, `batch` and `link_force` simulate it; `model` joins both. The
base classes of effects are here, the catalogue is not. May import `rom.campaign` (names of channels) and
`rom.kernels`.
"""
