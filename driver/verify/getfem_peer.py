"""A case in GetFEM, as a process: getfem_peer.py PROBLEM.npz OUT.npz

PROBLEM.npz holds nodes (n, 2), triangles (m, 3), or (m, 6) with middles where sides are curved, in
VTK's order, the element's order (1 or 2), E, nu, fixed (f, 2) rows [node,
component] with displacements (f, steps), contact (k,) nodes, normals (k, 2), gap (k,), friction
(the coefficient; not used if `rough` is 0) and preload (1: the first step has no friction, and
what follows slides from there). OUT.npz gets the nodal contact forces after the last step: force
(k,), positive when they press, and shear (k,) along t, n turned by 90 degrees. Plane strain, nodal
(basic) contact brick, MUMPS.
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
    triangles, curved = given["triangles"], given["triangles"].shape[1] == 6
    if curved:
        triangles = triangles[:, [0, 3, 1, 5, 4, 2]]  # line by line
    mesh.add_convex(gf.GeoTrans(f"GT_PK(2,{1 + curved})"), nodes[triangles].transpose(2, 1, 0))
    space = gf.MeshFem(mesh, 2)
    space.set_fem(gf.Fem(f"FEM_PK(2,{int(given['order'])})"))
    place = space.basic_dof_nodes().T[::2]  # dofs go node by node
    where = [int(np.hypot(*(place - node).T).argmin()) for node in nodes]
    md, nu = gf.Model("real"), float(given["nu"])
    md.add_fem_variable("u", space)
    md.add_initialized_data("lambda", [nu / ((1 + nu) * (1 - 2 * nu))])
    md.add_initialized_data("mu", [1 / (2 * (1 + nu))])
    # on curved triangles no rule is exact: FreeFEM's own
    quadrature = gf.MeshIm(mesh, gf.Integ(f"IM_TRIANGLE({5 if curved else 6})"))
    md.add_isotropic_linearized_elasticity_brick(quadrature, "u", "lambda", "mu")
    fixed, moved = given["fixed"], given["displacements"]
    held = gf.Spmat("empty", len(fixed), space.nbdof())
    for row, (node, component) in enumerate(fixed):
        held.add(row, 2 * where[int(node)] + int(component), 1.0)
    md.add_variable("support", len(fixed))
    support = md.add_constraint_with_multipliers("u", "support", held, moved[:, 0])
    contact, normals = given["contact"], given["normals"]
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    for name, value in (("r", [1.0]), ("gamma", [1.0]), ("before", np.zeros(space.nbdof())),
                        ("friction", [0.0])):
        md.add_initialized_data(name, value)
    # a support that takes up tangential forces leaves none to friction
    rough = ~np.isin(contact, fixed[:, 0]) & bool(given["rough"])
    for kind, nodes in (("rough", rough), ("smooth", ~rough)):
        if not nodes.any():
            continue
        normal, tangential = (_rows(contact[nodes], directions[nodes], where, space.nbdof())
                              for directions in (normals, tangents))
        count = int(nodes.sum())
        md.add_variable(f"force_{kind}", count)
        md.add_initialized_data(f"gap_{kind}", given["gap"][nodes])
        md.add_initialized_data(f"alpha_{kind}", np.ones(count))
        if kind == "rough":
            md.add_variable("shear_rough", count)
            md.add_basic_contact_brick("u", "force_rough", "shear_rough", "r", normal, tangential,
                                       "friction", "gap_rough", "alpha_rough", 1, "gamma",
                                       "before")
        else:
            md.add_basic_contact_brick("u", "force_smooth", "r", normal, "gap_smooth",
                                       "alpha_smooth", 1)
    for step in range(moved.shape[1]):
        if step or not given["preload"]:
            md.set_variable("friction", [float(given["friction"])])
        md.set_private_rhs(support, moved[:, step])
        md.solve("max_res", 1e-12, "max_iter", 200, "lsolver", "mumps", "lsearch", "simplest")
        # the brick slides by u_t + gamma before_t
        md.set_variable("before", -md.variable("u"))
    force, shear = np.zeros((2, len(contact)))
    if rough.any():
        force[rough], shear[rough] = -md.variable("force_rough"), md.variable("shear_rough")
    if not rough.all():
        force[~rough] = -md.variable("force_smooth")
    np.savez(out, force=unit * force, shear=unit * shear)


def _rows(contact, directions, where, dofs: int):
    """Sparse matrix that takes displacements to those of contact nodes along their directions."""
    rows = gf.Spmat("empty", len(contact), dofs)
    for row, (node, direction) in enumerate(zip(contact, directions)):
        for component in (0, 1):
            rows.add(row, 2 * where[int(node)] + component, float(direction[component]))
    return rows


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
