// half-disc.geo - half-disc of radius R whose lowest point is the origin, graded towards it.
//
// Numbers from outside: R radius, b half-width of the zone with fine elements, h their size; elements of h/4 around
// x = +-edge and x = +-stick, if these are given. Elements grow by a fifth of the distance from there where h is the part
// `fine` of b, and by less with the root of h: finer elements at the contact alone would not converge.
// Labels: 1 the part of the arc that may touch (|x| < 2 b), 2 the rest of the arc, 3 the flat top.
DefineConstant[ R = {1}, b = {0.05}, h = {0.01}, edge = {0}, stick = {0}, fine = {0.025} ];
growth = 0.1*Sqrt(h/(fine*b));
s = 2*b; c = Sqrt(R*R - s*s);
Point(1) = {0, R, 0};
Point(2) = {-R, R, 0}; Point(3) = {-s, R - c, 0}; Point(4) = {0, 0, 0}; Point(5) = {s, R - c, 0}; Point(6) = {R, R, 0};
Circle(1) = {2, 1, 3}; Circle(2) = {3, 1, 4}; Circle(3) = {4, 1, 5}; Circle(4) = {5, 1, 6};
Line(5) = {6, 1}; Line(6) = {1, 2};
Curve Loop(1) = {1, 2, 3, 4, 5, 6};
Plane Surface(1) = {1};
Physical Curve("contact", 1) = {2, 3};
Physical Curve("free", 2) = {1, 4};
Physical Curve("top", 3) = {5, 6};
Physical Surface("disc", 1) = {1};

// element size h where r = sqrt(x^2 + y^2) < b, then growing with the distance
Field[1] = MathEval;
Field[1].F = Sprintf("%g + %g*(Sqrt(x^2 + y^2) - %g + Abs(Sqrt(x^2 + y^2) - %g))", h, growth, b, b);
Background Field = 1;
If (edge > 0)
  // h/4 where r = sqrt((|x| - place)^2 + y^2) < edge/20, then growing with the distance
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
