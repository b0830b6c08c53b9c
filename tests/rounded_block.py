"""The body of a block whose lower corners are rounded: 4 is its flat sole, 3 are the roundings."""

ROUNDED_BODY = """border sole(t = -3, 3) { x = t; y = 0; label = 4; }
border right(t = -pi/2, 0) { x = 3 + cos(t); y = 1 + sin(t); label = 3; }
border up(t = 1, 3) { x = 4; y = t; label = 2; }
border top(t = 4, -4) { x = t; y = 3; label = 1; }
border down(t = 3, 1) { x = -4; y = t; label = 2; }
border left(t = -pi, -pi/2) { x = -3 + cos(t); y = 1 + sin(t); label = 3; }
body = buildmesh(sole(9) + right(6) + up(4) + top(8) + down(4) + left(6));"""
