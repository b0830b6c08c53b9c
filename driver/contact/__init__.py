"""The contact boundary: nodes, gaps and normals, mortar coupling, dual rows, states of nodes."""
