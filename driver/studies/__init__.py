"""Studies made of many runs: effects, parameters, accuracy, the slides' table; documents."""
