"""FETI-DP: corners, subdomains, local reductions, coarse problem, dual operator, preconditioner."""
