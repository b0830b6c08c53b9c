"""make accuracy: which part of the error of a scene comes from which knob, and what each digit takes.

`sweeps` plans and runs, `reference` says what the quantities are, `bargains` judges the runs, `work_precision` draws.
"""
