"""The model example in GetFEM, as a process: getfem_model.py MESH.npz OUT.npz STEPS LOADING

Settings suit GetFEM best here: nodal (basic) contact brick in small sliding, augmented version 1
with r = 50 in units of 1e8 Pa, sliding direction gamma = -1 from the previous displacement, MUMPS,
the plainest line search, supports by multipliers, the clamped corner left out of the contact nodes.

MESH.npz holds xy (n, 2) and triangles (m, 3); OUT.npz gets x (k,) of the contact nodes and the
nodal forces normal, tangential (k,) in N/m, positive when they press and push along +x.
"""

import sys

import getfem as gf
import numpy as np

UNIT = 1e8  # Pa
E, NU, FRICTION = 21.19e10 / UNIT, 0.277, 0.3
TOP, RIGHT = (0.0, -10e7 / UNIT), (3e7 / UNIT, 5e7 / UNIT)
AUGMENTATION = 50.0
HISTORIES = {"monotone": lambda t: t, "nonmonotone": lambda t: -4 * t**2 + 5 * t}


def build(xy: np.ndarray, triangles: np.ndarray):
    """Mesh with regions 1 to 4 (bottom, right, top, left) and the vector P1 space."""
    mesh = gf.Mesh("empty", 2)
    mesh.add_convex(gf.GeoTrans("GT_PK(2,1)"), xy[triangles].transpose(2, 1, 0))
    outer = mesh.outer_faces()
    normals = mesh.normal_of_faces(outer)
    for region, direction in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0)), 1):
        mesh.set_region(region, outer[:, normals.T @ direction > 0.9])
    space = gf.MeshFem(mesh, 2)
    space.set_fem(gf.Fem("FEM_PK(2,1)"))
    return mesh, space


def contact_rows(space):
    """Normal and tangential rows of the bottom nodes that are not clamped, and their x."""
    place = space.basic_dof_nodes()
    bottom = np.flatnonzero((place[1] == 0) & (place[0] > 0))[::2]  # dofs go node by node
    bottom = bottom[np.argsort(place[0, bottom])]
    normal, tangential = (gf.Spmat("empty", len(bottom), space.nbdof()) for _ in range(2))
    for row, dof in enumerate(bottom):
        normal.add(row, int(dof) + 1, -1.0)
        tangential.add(row, int(dof), 1.0)
    return normal, tangential, place[0, bottom]


def model(quadrature, space):
    """GetFEM's model and the x of the contact nodes; mesh, quadrature and space must outlive it."""
    md = gf.Model("real")
    md.add_fem_variable("u", space)
    md.add_initialized_data("lambda", [E * NU / ((1 + NU) * (1 - 2 * NU))])
    md.add_initialized_data("mu", [E / (2 * (1 + NU))])
    md.add_isotropic_linearized_elasticity_brick(quadrature, "u", "lambda", "mu")
    md.add_Dirichlet_condition_with_multipliers(quadrature, "u", space, 4)
    for name, region in (("top", 3), ("right", 2)):
        md.add_initialized_data(name, [0.0, 0.0])
        md.add_source_term_brick(quadrature, "u", name, region)
    normal, tangential, x = contact_rows(space)
    for name in ("force_n", "force_t"):
        md.add_variable(name, len(x))
    md.add_initialized_data("r", [AUGMENTATION])
    md.add_initialized_data("friction", [FRICTION])
    md.add_initialized_data("gap", np.zeros(len(x)))
    md.add_initialized_data("alpha", np.ones(len(x)))
    md.add_initialized_data("gamma", [-1.0])
    md.add_initialized_data("before", np.zeros(space.nbdof()))
    md.add_basic_contact_brick("u", "force_n", "force_t", "r", normal, tangential, "friction",
                               "gap", "alpha", 1, "gamma", "before")
    return md, x


def main(mesh_file: str, out_file: str, steps: int, loading: str) -> None:
    """March through the steps and write the last contact forces."""
    gf.util_trace_level(0)
    given = np.load(mesh_file)
    mesh, space = build(given["xy"], given["triangles"])
    quadrature = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(2)"))
    md, x = model(quadrature, space)
    for step in range(1, steps + 1):
        phi = HISTORIES[loading](step / steps)
        md.set_variable("top", np.multiply(phi, TOP))
        md.set_variable("right", np.multiply(phi, RIGHT))
        md.solve("max_res", 1e-8, "max_iter", 200, "lsolver", "mumps", "lsearch", "simplest")
        md.set_variable("before", md.variable("u"))
    np.savez(out_file, x=x, normal=-UNIT * md.variable("force_n"),
             tangential=UNIT * md.variable("force_t"))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4])
