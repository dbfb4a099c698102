"""Look of all figures; colours that the colour-blind tell apart: M. Okabe and K. Ito (2008)."""

BLACK = "#000000"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
SKY = "#56B4E9"
GREY = "#8c8c8c"

MEASURED, MODEL, BACKGROUND = BLACK, VERMILLION, GREY
BEFORE, AFTER = VERMILLION, BLUE

WIDTH = 6.0  # of a figure on a screen [inch]
INCH_PER_MM = 1.4 / 25.4  # of its height: letters are larger there than in a column of print
