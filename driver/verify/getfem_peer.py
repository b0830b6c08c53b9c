"""A case in GetFEM, as a process: getfem_peer.py PROBLEM.npz OUT.npz

PROBLEM.npz holds nodes (n, 2), triangles (m, 3), order (1 or 2), E, nu, fixed (f, 3) rows [node,
component, displacement], contact (k,) nodes, normals (k, 2) and gap (k,); OUT.npz gets the nodal
contact forces (k,), positive when they press. Plane strain, no friction, nodal (basic) contact
brick, MUMPS.
"""

import sys

import getfem as gf
import numpy as np


def main(problem: str, out: str) -> None:
    """Solve the problem and write the contact forces."""
    gf.util_trace_level(0)
    given = np.load(problem)
    nodes, unit = given["nodes"], float(given["E"])  # forces over E: near one
    mesh = gf.Mesh("empty", 2)
    mesh.add_convex(gf.GeoTrans("GT_PK(2,1)"), nodes[given["triangles"]].transpose(2, 1, 0))
    space = gf.MeshFem(mesh, 2)
    space.set_fem(gf.Fem(f"FEM_PK(2,{int(given['order'])})"))
    place = space.basic_dof_nodes().T[::2]  # dofs go node by node
    where = [int(np.hypot(*(place - node).T).argmin()) for node in nodes]
    md, nu = gf.Model("real"), float(given["nu"])
    md.add_fem_variable("u", space)
    md.add_initialized_data("lambda", [nu / ((1 + nu) * (1 - 2 * nu))])
    md.add_initialized_data("mu", [1 / (2 * (1 + nu))])
    quadrature = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(6)"))
    md.add_isotropic_linearized_elasticity_brick(quadrature, "u", "lambda", "mu")
    fixed = given["fixed"]
    held = gf.Spmat("empty", len(fixed), space.nbdof())
    for row, (node, component, _) in enumerate(fixed):
        held.add(row, 2 * where[int(node)] + int(component), 1.0)
    md.add_variable("support", len(fixed))
    md.add_constraint_with_multipliers("u", "support", held, fixed[:, 2])
    contact = given["contact"]
    normal = gf.Spmat("empty", len(contact), space.nbdof())
    for row, (node, n) in enumerate(zip(contact, given["normals"])):
        for component in (0, 1):
            normal.add(row, 2 * where[int(node)] + component, float(n[component]))
    md.add_variable("force", len(contact))
    md.add_initialized_data("r", [1.0])
    md.add_initialized_data("gap", given["gap"])
    md.add_initialized_data("alpha", np.ones(len(contact)))
    md.add_basic_contact_brick("u", "force", "r", normal, "gap", "alpha", 1)
    md.solve("max_res", 1e-12, "max_iter", 200, "lsolver", "mumps", "lsearch", "simplest")
    np.savez(out, force=-unit * md.variable("force"))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
