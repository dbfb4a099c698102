"""Colours of all figures, safe for the colour-blind: M. Okabe and K. Ito, Color Universal Design (2008)."""

BLACK = "#000000"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
SKY = "#56B4E9"
GREY = "#8c8c8c"

MEASURED, MODEL, BACKGROUND = BLACK, VERMILLION, GREY
BEFORE, AFTER = VERMILLION, BLUE
