"""Whether the assumptions of a run hold: small strains and rotations, linear contact, elements."""
