"""Errors in the energy norm: a bound by equilibrated stresses, smoothed ones, refined meshes."""
