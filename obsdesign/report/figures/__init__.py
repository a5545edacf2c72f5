"""One file per figure: a pure function from a study to an inline SVG, empty where there is nothing to draw."""
