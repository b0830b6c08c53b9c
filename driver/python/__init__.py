"""Runs from Python, in a script or a notebook, and their results as numpy arrays."""
