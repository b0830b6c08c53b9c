// dovetail.geo - root of a blade (part 1) and slot of the disc that holds it (part 2), symmetric about x = 0.
//
// The flanks lie on the lines y = -2 - 1.5 (|x| - 4); the blade's end at |x| = 4 and 8, those of the slot, wider by
// `play` elsewhere, at |x| = 4 + play and 8 + play: they overlap for 4 + play < |x| < 8.
// Numbers from outside: part, play and h, the element size at the flanks; five times that far from them.
// Labels of the blade (10 more for the disc): 1 left flank, 2 right flank, 3 top of the blade or rim of the disc,
// 4 free.
DefineConstant[ part = {1}, play = {0.6}, h = {0.4} ];
If (part == 1)
  Point(1) = {-4, 16, 0}; Point(2) = {-4, -2, 0}; Point(3) = {-8, -8, 0}; Point(4) = {-8, -11, 0};
  Point(5) = {8, -11, 0}; Point(6) = {8, -8, 0}; Point(7) = {4, -2, 0}; Point(8) = {4, 16, 0};
Else
  s = 1.5*play;
  Point(1) = {-4 - play, 2, 0}; Point(2) = {-4 - play, -2 - s, 0}; Point(3) = {-8 - play, -8 - s, 0};
  Point(4) = {-8 - play, -12 - s, 0};
  Point(5) = {8 + play, -12 - s, 0}; Point(6) = {8 + play, -8 - s, 0}; Point(7) = {4 + play, -2 - s, 0};
  Point(8) = {4 + play, 2, 0};
  Point(9) = {24, 2, 0}; Point(10) = {24, -28, 0}; Point(11) = {-24, -28, 0}; Point(12) = {-24, 2, 0};
EndIf
For i In {1:7}
  Line(i) = {i, i + 1};
EndFor
k = (part == 1) ? 0 : 10;
If (part == 1)
  Line(8) = {8, 1};
  Curve Loop(1) = {1:8};
  Physical Curve(k + 3) = {8};
  Physical Curve(k + 4) = {1, 3, 4, 5, 7};
Else
  For i In {8:11}
    Line(i) = {i, i + 1};
  EndFor
  Line(12) = {12, 1};
  Curve Loop(1) = {1:12};
  Physical Curve(k + 3) = {9, 10, 11};
  Physical Curve(k + 4) = {1, 3, 4, 5, 7, 8, 12};
EndIf
Physical Curve(k + 1) = {2};
Physical Curve(k + 2) = {6};
Plane Surface(1) = {1};
Physical Surface(part) = {1};
// elements grow with the distance from the flanks
Field[1] = Distance;
Field[1].CurvesList = {2, 6};
Field[1].NumPointsPerCurve = 100;
Field[2] = Threshold;
Field[2].InField = 1;
Field[2].SizeMin = h; Field[2].SizeMax = 5*h; Field[2].DistMin = 0; Field[2].DistMax = 12;
Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
