"""The scene of a thin rail, whose loads alone would bend it far."""

# heated by 15 K, held at one end: more than friction of all its length could hold
RAIL = """include "scene.idp"
units("m", "Pa");
real length = physical("length", 2.), thick = physical("thick", 0.01);
rectangle(0., length, 0., thick);
quasistatic(1.);
macro young() 210e9 //
macro poisson() 0. //
macro planeStress() 1 //
macro support() on(4, u1 = 0.) //
macro contact() 1 //
macro friction() 0.4 //
macro bodyForce1() [0., -1e7] //
macro thermal2() 1.8e-4 //
macro amplitude2(t) t //
include "export.idp"
"""
