"""Pure solvers, which know nothing of bodies: MPRGP, Newton's and Lemke's method, accelerations."""
