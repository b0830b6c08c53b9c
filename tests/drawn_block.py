"""A scene of a block that is pressed on another body and then drawn along it by its side."""

DRAWN = '''include "scene.idp"
quasistatic(1.);
real way = physical("way", 6.);
int[int] below = [1, 2, 3, 4], above = [5, 6, 7, 8];
addBody(square(20, 5, [40. * x, 10. * y], label=below))
addBody(square(11, 5, [10. + 20. * x, 10. + 10. * y], label=above))
macro young() 1e5 //
macro poisson() 0.3 //
macro support() on(1, u1 = 0., u2 = 0.) //
macro load1() pressure(7, 50.) //
macro amplitude1(t) min(1., 2.*t) //
macro displacement2() on(8, u1 = way) //
macro amplitude2(t) max(0., 2.*t - 1.) //
macro contactPair() 5, 3 //
macro friction() 0.3 //
include "export.idp"
'''
