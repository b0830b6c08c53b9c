// lap-joint.geo - one plate of a lap joint (part 1 above, part 2 below), finest along the lap.
//
// The plates overlap on 0 < x < a at y = 0; plate 1 goes on to x = a + b, plate 2 to x = -b. Thickness t. A bolt
// clamps c0 < x < c1 from outside. Numbers from outside: part, a, b, t, c0, c1 and h, the element size at the lap.
// Elsewhere elements grow with the distance, by less with the root of h: finer ones at the lap alone would not converge.
// Labels of plate 1 (10 more for plate 2): 1 lap, 2 far end, 3 clamped from outside, 4 free.
DefineConstant[ part = {1}, a = {40}, b = {30}, t = {8}, c0 = {14}, c1 = {26}, h = {1} ];
// plate 2 is plate 1 turned by 180 degrees about the middle of the lap
s = (part == 1) ? 1 : -1;
m = (part == 1) ? 0 : a;
Point(1) = {m, 0, 0}; Point(2) = {m + s*a, 0, 0}; Point(3) = {m + s*(a + b), 0, 0};
Point(4) = {m + s*(a + b), s*t, 0};
Point(5) = {(part == 1) ? c1 : c0, s*t, 0}; Point(6) = {(part == 1) ? c0 : c1, s*t, 0}; Point(7) = {m, s*t, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6}; Line(6) = {6, 7}; Line(7) = {7, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6, 7};
Plane Surface(1) = {1};
k = (part == 1) ? 0 : 10;
Physical Curve(k + 1) = {1};
Physical Curve(k + 2) = {3};
Physical Curve(k + 3) = {5};
Physical Curve(k + 4) = {2, 4, 6, 7};
Physical Surface(part) = {1};
Field[1] = MathEval;
growth = Sqrt(h/(0.02*a));
Field[1].F = Sprintf("%g + %g*(0.25*Abs(y) + 0.15*(Abs(x - %g) - %g + Abs(Abs(x - %g) - %g)))",
                     h, growth, a/2, a/2, a/2, a/2);
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
