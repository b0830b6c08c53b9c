// bracket.geo - an L-shaped bracket with a bolt hole and a stiff foot; millimetre.
//
// h: element size far from the contact and the hole (from outside: -setnumber h 4)
// Physical curves: 1 foot on the base plate, 2 back against the wall, 3 bolt hole, 4 top of the arm, 5 everything else
// Physical surfaces: 1 aluminium arm, 2 steel foot
DefineConstant[ h = {4} ];

thickness = 20; height = 80; width = 90; foot = 8; fillet = 15; hole = 6;
fine = h/3;

Point(1) = {0, 0, 0, fine};            Point(2) = {width, 0, 0, fine};
Point(3) = {width, foot, 0, h/2};      Point(4) = {0, foot, 0, fine};
Point(5) = {width, foot + thickness, 0, h};
Point(6) = {thickness + fillet, foot + thickness, 0, h/2};
Point(7) = {thickness + fillet, foot + thickness + fillet, 0, h/2};   // centre of the fillet
Point(8) = {thickness, foot + thickness + fillet, 0, h/2};
Point(9) = {thickness, height, 0, h};  Point(10) = {0, height, 0, h/2};

Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Line(5) = {3, 5}; Line(6) = {5, 6}; Circle(7) = {6, 7, 8}; Line(8) = {8, 9}; Line(9) = {9, 10}; Line(10) = {10, 4};

cx = 65; cy = foot + thickness/2;
Point(11) = {cx, cy, 0, fine};
Point(12) = {cx + hole, cy, 0, fine}; Point(13) = {cx, cy + hole, 0, fine};
Point(14) = {cx - hole, cy, 0, fine}; Point(15) = {cx, cy - hole, 0, fine};
Circle(11) = {12, 11, 13}; Circle(12) = {13, 11, 14}; Circle(13) = {14, 11, 15}; Circle(14) = {15, 11, 12};

Curve Loop(1) = {1, 2, 3, 4};                    Plane Surface(1) = {1};
Curve Loop(2) = {5, 6, 7, 8, 9, 10, -3};
Curve Loop(3) = {11, 12, 13, 14};                Plane Surface(2) = {2, 3};

Physical Curve(1) = {1};   Physical Curve(2) = {10};   Physical Curve(3) = {11, 12, 13, 14};
Physical Curve(4) = {9};   Physical Curve(5) = {2, 4, 5, 6, 7, 8};
Physical Surface(1) = {2}; Physical Surface(2) = {1};
