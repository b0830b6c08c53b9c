"""FETI-DP / MPRGP driver for 2D quasistatic contact with local Coulomb friction."""
