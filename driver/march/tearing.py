"""The torn body: interfaces, supports and contact boundary of all subdomains, and their rows."""

import numpy as np

from ..contact import shared_labels
from ..contact.found_nodes import contact_boundary
from ..contact.corner_pairs import corner_pairs
from ..effects import Effects
from ..feti.numbering import number
from ..feti.skeleton import Skeleton
from ..feti.structure import Substructure
from ..feti.support_ends import SupportEnds
from ..feti.supports import fixed_dofs
from ..scene.loader import Subdomain
from ..scene.manifest import Manifest


def build(manifest: Manifest, subdomains: list[Subdomain], first: int, comm,
          moved: list | None = None) -> Substructure:
    """Derive corners, rows and numbering; collective over `comm`.

    `moved`: displacements (dofs,) of the subdomains about which contact between bodies is
    linearized, if not about none. Raises InputError for interfaces that do not conform, bodies
    that are not connected and contact labels without nodes.
    """
    effects, skeleton = Effects(manifest), Skeleton(manifest, subdomains, comm)
    skeleton.check_conformity()
    skeleton.check_connected()
    skeleton.check_overlap(np.unique([*manifest.contact_pairs,
                                      *([joint.first, joint.second] for joint in effects.joints)]))
    fixed, jumps = fixed_dofs(manifest, subdomains, comm), []
    if fixed[1].any():
        ends = SupportEnds(fixed, skeleton, manifest)
        fixed, jumps = ends.fixed, ends.jumps
    sides = effects.paired_sides(subdomains, fixed, comm, moved)
    periods = None
    if joints := effects.joints:  # few scenes have some
        from ..contact.joints import joined_edges, with_joints
        from ..contact.periods import Periods

        edges = joined_edges(joints, manifest, subdomains, comm)
        periods = Periods.of(joints, edges, manifest)
    if sides is not None:
        sides.periods = periods
    with shared_labels.explained(manifest, subdomains, skeleton, comm):
        contact = contact_boundary(manifest, effects, subdomains, skeleton, fixed, comm, sides,
                                   periods)
        if joints:
            contact = with_joints(contact, joints, edges, manifest, fixed)
    structure = number(manifest, subdomains, first, skeleton, fixed, contact, comm,
                       effects.frictional, effects.compliance(contact))
    structure.support_jumps = jumps
    contact.corners = corner_pairs(contact, fixed[0], effects.yields(contact))
    return structure
