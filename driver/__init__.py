"""FETI-DP / MPRGP driver for 2D quasistatic contact with local Coulomb friction."""

# in the order of the data: a package imports from those before it only
PACKAGES = ("scene", "feti", "contact", "qp", "effects", "march", "results", "estimates", "figures",
            "runs", "studies", "hard", "bench")
