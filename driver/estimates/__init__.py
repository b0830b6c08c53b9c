"""Error estimates: bound in the energy norm, budget of the quantities, indicator of refinement."""
