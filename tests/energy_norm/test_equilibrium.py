"""The stress of the bound is in equilibrium and in the friction cone, and what breaks it shows."""

import numpy as np
import pytest

from driver.energy_norm import equilibration
from driver.energy_norm.bound import EquilibratedBound
from driver.energy_norm.edge_mesh import full_tensor
from driver.march import shortcut
from driver.scene.elements import hat_gradients


def tractions(estimator, side):
    """(n_t, 2 ends, 2) forces per parameter of the stress on side k to k + 1, from inside."""
    across = estimator.body.mesh.outward[:, side]
    full = full_tensor(estimator.stress[:, (side + 2) % 3, :2])
    return np.einsum("tnij,tj->tni", full, across)


def check_equilibrium(estimator):
    """Body force, tractions between parts, between triangles and on the boundary, to rounding of
    the largest.
    """
    mesh, stress = estimator.body.mesh, estimator.stress
    scale = np.abs(stress).max() * mesh.length.max()
    # sums of some hundred products; inverses of triangles of condition below 1e3
    slack = 1e-11 * scale
    middle = mesh.corner.mean(axis=1)
    for j in range(3):  # between the parts on both sides of the line from corner j to the middle
        line = middle - mesh.corner[:, j]
        across = np.column_stack([line[:, 1], -line[:, 0]])
        for left, right in ((1, 0), (2, 2)):
            jump = stress[:, (j + 1) % 3, left] - stress[:, (j + 2) % 3, right]
            assert np.abs(np.einsum("tij,tj->ti", full_tensor(jump), across)).max() <= slack
    force = np.zeros((len(stress), 3, 2))
    for part in range(3):
        corner = np.stack([mesh.corner[:, (part + 1) % 3], mesh.corner[:, (part + 2) % 3], middle],
                          axis=1)
        gradient = hat_gradients(corner) * (mesh.area / 3)[:, None, None]
        total = -np.einsum("tnij,tnj->ti", full_tensor(stress[:, part]), gradient)
        for k in range(3):
            force[:, k] += (1 / 9 if k == part else 4 / 9) * total
    assert np.abs(force - (0 if estimator.force is None else estimator.force)).max() <= slack
    found = np.zeros((2 * len(mesh.edges), 2))
    for k in range(3):
        end = tractions(estimator, k)
        moments = np.stack([2 * end[:, 0] + end[:, 1], end[:, 0] + 2 * end[:, 1]], axis=1) / 6
        np.add.at(found, mesh.first[:, k], moments[:, 0])
        np.add.at(found, mesh.last[:, (k + 1) % 3], moments[:, 1])
    inside = ~np.repeat(mesh.boundary, 2)
    assert np.abs(found[inside]).max() <= slack  # what one triangle takes the other gives
    given = estimator.body.given
    assert np.abs((found - estimator.applied)[given]).max() <= slack
    return found


EQUILIBRATED = [("model", dict(cells=4, steps=2, loading="nonmonotone")),
                ("cantilever", dict(cells=3, subdomains="5")),
                ("patch", dict(cells=2, angle=30, subdomains="7")),
                ("thermal", dict(cells=2, steps=2)),
                ("bracket", dict(h=8, steps=2)), ("pressfit", dict(h=6)),
                ("tutorial", dict(h=4, steps=3)),
                ("zones", dict(cells=4, steps=1)), ("hertz-bodies", dict(h=0.016)),
                ("mindlin-bodies", dict(h=0.15, steps=1))]


@pytest.mark.parametrize("scene, parameters", EQUILIBRATED)
@pytest.mark.some(5)
def test_the_stress_is_in_equilibrium(estimated, scene, parameters):
    _, estimator, _ = estimated(scene, **parameters)
    found = check_equilibrium(estimator)
    assert np.abs(found[np.repeat(estimator.body.mesh.boundary, 2)]).max() > 0


@pytest.mark.parametrize("scene, parameters", EQUILIBRATED)
@pytest.mark.some(2)
def test_contact_tractions_are_in_the_cone(estimated, scene, parameters):
    """At both ends, so everywhere, of each contact edge; by as much as the normals of its ends
    differ it may fail.
    """
    _, estimator, _ = estimated(scene, **parameters)
    c = estimator.contact
    moments = c.moments
    value = np.stack([4 * moments[:, 0] - 2 * moments[:, 1],
                      4 * moments[:, 1] - 2 * moments[:, 0]], axis=1)
    value /= c.length[:, None, None]
    normal = np.einsum("nei,nei->ne", value, c.normal[c.node])
    tangential = np.einsum("nei,nei->ne", value, c.tangent[c.node])
    bend = np.abs(c.normal[c.node[:, 0]] - c.normal[c.node[:, 1]]).max(initial=0)
    slack = (1e-12 + bend**2) * np.abs(value).max(initial=0)
    assert (normal <= slack).all()
    assert (np.abs(tangential) <= c.bound[c.node] + slack).all()


@pytest.mark.parametrize("scene, parameters", [("patch", dict(cells=3)),
                                               ("patch", dict(cells=2, angle=30, subdomains="7")),
                                               ("patch-bodies", dict()),
                                               ("patch-bodies", dict(ratio=0.6, tilt=-12)),
                                               ("bar", dict(cells=2, steps=4)),
                                               ("thermal", dict(cells=2, steps=2))])
@pytest.mark.some(1)
def test_nothing_is_estimated_where_the_solution_is_exact(estimated, scene, parameters):
    _, _, found = estimated(scene, settings=(("rtol", 1e-12),), **parameters)
    # the square root of rounding in the energies
    assert found.total <= 1e-7 * found.norm or found.norm < 1e-12


@pytest.mark.parametrize("name, change", [
    ("uneven", ("macro young() E //", "macro young() (E*(1 + x*x + 2*y)) //")),
    ("warmed",
     ('include "export.idp"', 'macro thermal1() (1e-4*x*y*(1 + y)) //\ninclude "export.idp"'))])
def test_what_varies_inside_triangles_leaves_vertices_in_balance(variant, estimated, name, change,
                                                                 monkeypatch):
    """Elasticity and thermal stress are the means that the assembled forces have seen: the solver's
    part is the solver's.
    """
    monkeypatch.setattr(shortcut, "AT_ONCE", 0)  # Newton's method has no part at all
    scene = variant(name, change)
    loose, tight = (estimated(scene, settings=(("rtol", tol), ("primal_rtol", 1.0)), cells=3,
                              steps=1)[2]
                    for tol in (1e-5, 1e-9))
    assert tight.solver < 1e-2 * loose.solver and tight.solver < 1e-5 * tight.mesh


def test_a_wrong_sign_is_noticed(estimated, monkeypatch):
    """Contact tractions of the wrong sign leave vertices out of balance, which the solver's part
    shows.
    """
    sound = estimated(cells=4, steps=1)[2]
    plain = EquilibratedBound._applied

    def turned(self, weights, contact, pairs):
        contact.moments = -contact.moments
        return plain(self, weights, contact, pairs)

    monkeypatch.setattr(EquilibratedBound, "_applied", turned)
    broken = estimated(cells=4, steps=1, settings=(("max_fixed_point", 99),))[2]
    assert broken.solver > sound.mesh > 1e3 * sound.solver


def test_unbalanced_vertices_are_reported_and_spread(estimated):
    """An extra force on one vertex is the solver's: the stress stays in equilibrium on every
    triangle.
    """
    _, estimator, _ = estimated(cells=4, steps=1)
    body = estimator.body
    load = equilibration.prolongation(body.mesh, estimator.base, None)
    load[0] += [[3.0, 0.0], [0.0, 5.0], [0.0, 0.0]]
    target = equilibration.averaged_moments(body.mesh, estimator.base)
    moments, imbalance = equilibration.edge_moments(body.mesh, body.chains, load, target,
                                                    estimator.applied, body.given)
    inner = ~body.constrained[body.mesh.triangles[0]].any(axis=1)
    vertex = body.mesh.triangles.ravel()[body.chains.order[0]]
    for k in range(2):
        if inner[k]:
            at = np.flatnonzero(vertex == body.mesh.triangles[0, k])[0]
            around = body.mesh.triangles == body.mesh.triangles[0, k]
            left = (moments[body.mesh.first] - moments[body.mesh.last] - load)[around]
            np.testing.assert_allclose(left,
                                       np.tile(imbalance[at] / around.sum(), (around.sum(), 1)),
                                       atol=1e-9 * np.abs(load).max())
            np.testing.assert_allclose(imbalance[at], -np.array([[3.0, 0.0], [0.0, 5.0]])[k],
                                       atol=1e-6 * np.abs(load).max())


def test_a_reaction_in_a_single_point_has_no_estimate(estimated):
    _, estimator, _ = estimated(cells=4, steps=1)
    vertex = estimator.body.mesh.triangles.ravel()[estimator.body.chains.order[0]]
    imbalance = np.zeros((len(vertex), 2))
    free = np.flatnonzero(~estimator.body.constrained[vertex].any(axis=1))[0]
    imbalance[free] = 1.0
    size, reason = estimator._unbalanced(imbalance, 10.0)
    assert not reason and size > 0
    imbalance[free], imbalance[np.flatnonzero(
        estimator.body.constrained[vertex].all(axis=1))[0]] = 0.0, 1.0
    assert "single point" in estimator._unbalanced(imbalance, 10.0)[1]
