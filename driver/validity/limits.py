"""Limits of the assumptions of a run, and the words of its verdict.

Up to QUESTIONABLE errors of displacements and tractions from this stay within about a tenth
(strain 0.1: 5 %; rotation 0.1: 0.5 % of all lengths and as much again as strain; a surface that
is off by 1 % of the contact length is a load of about that strain; a normal off by 0.1 gives a
tenth of the pressure as shear; by a slide of a tenth as much of a boundary carries what it should
not, or lacks what it should); forces and displacements that finite rotations change within a
twentieth, as its estimate may be too small by as much. Beyond INVALID they may be anything.
"""

QUESTIONABLE = {"largest_strain": 0.1, "largest_rotation": 0.1, "largest_normal_error": 0.01,
                "normal_turn": 0.1, "largest_slide": 0.1, "largest_swelling": 0.1,
                "second_order": 0.05, "buckling": 0.5, "overlaps": 0.0, "gap": 0.5}
INVALID = {"largest_strain": 0.3, "largest_rotation": 0.35, "largest_normal_error": 0.1,
           "normal_turn": 0.35, "largest_slide": 1.0, "largest_swelling": 0.5,
           "second_order": 0.3, "buckling": 1.0, "overlaps": 0.02, "gap": 2.0}
SPOT = 1e-2
NEGLIGIBLE = 5e-3  # stretches beside strains, of which finite rotations change forces by little:
# what is displaced by as much feels a part of that size, by equal work
FELT = 2.0  # times the change of the forces on a body that its swelling counts for at most
TOUCH = 1e-3  # part of a body's size by which bodies may overlap unnoticed
UNPLACED = {"second_order", "buckling"}  # of the whole: what others say says where, too
VERDICTS = ("ok", "questionable", "invalid")
WORDS = {
    "largest_strain": ("the strain is {:.2g}", "strains are assumed small",
                       "apply smaller loads, or use a code for finite strains"),
    "largest_rotation": ("the body turns by {:.2g} rad", "rotations are assumed small",
                         "apply smaller loads, or use a code for large rotations"),
    "largest_normal_error": ("a node in contact is away from the opposite surface by {:.2g} of the "
                             "contact length", "contact is linear about the place before the load",
                             "{remedy}"),
    "normal_turn": ("a node in contact meets a surface that is turned by {:.2g} rad from the "
                    "normal used", "contact is linear about the place before the load",
                    "{remedy}"),
    "largest_slide": ("a node in contact slides along the other body by {:.2g} of the contact "
                      "length", "contact is linear about the place before the load", "{remedy}"),
    "largest_swelling": ("{:.2g} of the body's compression comes from turning by {turn:.2g} rad",
                         "rotations are assumed small",
                         "let it turn less, or use a code for large rotations"),
    "second_order": ("finite rotations change {what} by {:.2g} of it",
                     "rotations are assumed small",
                     "apply smaller loads, or use a code for large rotations"),
    "buckling": ("the loads are {:.2g} of those at which a body buckles",
                 "bodies are taken for stable",
                 "apply smaller loads, make it stouter, or use a code for large rotations"),
    "overlaps": ("{labels} overlap by {:.2g} of the body's size",
                 "contact is not declared there", "declare contact there, or apply smaller loads"),
    "gap": ("the {other} reaches through the body by {:.2g} of its size",
            "contact starts with this overlap", "check sign and unit of the gap")}
