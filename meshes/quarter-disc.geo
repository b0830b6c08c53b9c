// quarter-disc.geo - quarter of a disc of radius R, x >= 0, whose lowest point is the origin: half a section of a hemisphere.
//
// Numbers from outside: R radius, b radius of the zone with fine elements, h their size; elements of h/4 around x = edge
// and x = stick, if these are given. Elements grow with the distance as in half-disc.geo.
// Labels: 1 the part of the arc that may touch (x < 2 b), 2 the rest of the arc, 3 the flat top, 4 the axis.
DefineConstant[ R = {1}, b = {0.05}, h = {0.01}, edge = {0}, stick = {0}, fine = {0.025} ];
growth = 0.1*Sqrt(h/(fine*b));
s = 2*b; c = Sqrt(R*R - s*s);
Point(1) = {0, R, 0}; Point(2) = {0, 0, 0}; Point(3) = {s, R - c, 0}; Point(4) = {R, R, 0};
Circle(1) = {2, 1, 3}; Circle(2) = {3, 1, 4};
Line(3) = {4, 1}; Line(4) = {1, 2};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("contact", 1) = {1};
Physical Curve("free", 2) = {2};
Physical Curve("top", 3) = {3};
Physical Curve("axis", 4) = {4};
Physical Surface("disc", 1) = {1};

// element size h where r = sqrt(x^2 + y^2) < b, then growing with the distance
Field[1] = MathEval;
Field[1].F = Sprintf("%g + %g*(Sqrt(x^2 + y^2) - %g + Abs(Sqrt(x^2 + y^2) - %g))", h, growth, b, b);
Background Field = 1;
If (edge > 0)
  place[] = {edge, stick};
  For k In {0:1}
    Field[2 + k] = MathEval;
    Field[2 + k].F = Sprintf("%g + %g*(Sqrt((Abs(x) - %g)^2 + y^2) - %g + Abs(Sqrt((Abs(x) - %g)^2 + y^2) - %g))",
                             h/4, growth, place[k], edge/20, place[k], edge/20);
  EndFor
  Field[4] = Min; Field[4].FieldsList = {1, 2, 3};
  Background Field = 4;
EndIf
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
