"""One run from scene to figures: request, private directory, ranks, search for an accuracy."""
