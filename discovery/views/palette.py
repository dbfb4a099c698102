"""Look of all figures; colours that the colour-blind tell apart: M. Okabe and K. Ito (2008)."""

from __future__ import annotations

from rom.criteria.number import Numerical

BLACK = "#000000"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
SKY = "#56B4E9"
PURPLE = "#CC79A7"
GREY = "#8c8c8c"

MEASURED, MODEL, BACKGROUND = BLACK, VERMILLION, GREY
BEFORE, AFTER = VERMILLION, BLUE

WIDTH: Numerical[float] = 6.0  # of a figure on a screen [inch]
# of its height: letters are larger there than in a column of print
INCH_PER_MM: Numerical[float] = 1.4 / 25.4
