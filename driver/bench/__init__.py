"""make bench: costs beside the slides, a factorization, other programs, the machine's limits.

Each part is a module with `measure(bench)`, which adds rows to the report.
Ratios are medians of ratios of times taken in turn in one run.
"""
