"""Errors of the quantities of interest by companions and adjoint problems, and their prices."""
